// Part one of filtering: every pixel adds its own samples, weighted, into the (2 kPad + 1)² pixels around it.
// Gathering by sum_taps.comp follows.
//
// An invocation goes down one column of a block's pixels, and keeps the sums of the rows that the current
// pixel reaches and of kTapColumns columns around it ("taps"): a row is written once nothing can be added to
// it any more. Wide filters have more sums than an invocation should keep, so they take one invocation per
// column of taps. The including kernel defines kChannels, of them kWeightChannel for the filter weight itself (or
// one beyond them), kPairValues (at least 2 kChannels, and no specialization constant: arrays whose sizes are
// expressions of those are of different types to glslang), and loadPair().
//
// Samples are read in pairs, 64 bits at a time: loads that differ between invocations cost a software device
// more than all of the arithmetic, whatever their width.
//
// Single-precision sums: right for a few hundred samples per pixel. `precise`, and in the order of samples:
// the twin adds the same to the last bit.

layout(constant_id = 4) const uint kTapColumns = 1;  // kTaps or 1

const uint kTaps = 2 * kPad + 1;
const uint kColumnGroups = kTaps / kTapColumns;
const uint kPaddedRows = kBlockPixels + 2 * kPad;

layout(local_size_x = 64) in;

// Scalars of two slots, at an even slot: buffers and blocks begin at multiples of 8 bytes.
layout(buffer_reference, scalar) readonly buffer Pairs { uint64_t at[]; };
layout(buffer_reference, scalar) readonly buffer Origins { uvec2 at[]; };
layout(buffer_reference, scalar) writeonly buffer Taps { float at[]; };
layout(buffer_reference, scalar) buffer Counters {
  uint non_finite;  // samples that count as 0
  uint bad_shade;   // samples whose shade index is out of range
};

struct SplatArguments {
  Origins origins;  // of the blocks, in pixels of the image
  Pairs positions;  // per slot, records.h
  Taps taps;        // [block][tap column][channel][row, from kPad above the block][column]
  Counters counters;
  uint blocks;
  uint width;  // of the image
  uint height;
  uint samples_per_pixel;
};

// By exponent: comparisons with infinity and NaN may be optimised away.
bool isFiniteValue(float v) { return (floatBitsToUint(v) & 0x7f800000u) != 0x7f800000u; }
bool isFiniteValue(vec3 v) { return isFiniteValue(v.x) && isFiniteValue(v.y) && isFiniteValue(v.z); }

// Sample position within its pixel, in [0, 1)²; exact.
vec2 unpackPosition(uint packed) { return vec2(packed & 0xffffu, packed >> 16) * (1.0 / 65536.0); }

vec2 floatPair(Pairs from, uint pair) { return uintBitsToFloat(unpack32(from.at[pair])); }
// Three components of both slots.
void vec3Pair(Pairs from, uint pair, out vec3 value[2]) {
  const vec2 a = floatPair(from, 3 * pair), b = floatPair(from, 3 * pair + 1), c = floatPair(from, 3 * pair + 2);
  value[0] = vec3(a.x, a.y, b.x);
  value[1] = vec3(b.y, c.x, c.y);
}

// Finite values of slots 2 * pair and 2 * pair + 1; adds to the counters where they are valid.
void loadPair(uint pair, bvec2 valid, out float value[kPairValues], inout uint non_finite, inout uint bad_shade);

void splat(SplatArguments a) {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint invocation = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  const uint column = invocation % kBlockPixels;
  const uint column_group = invocation / kBlockPixels % kColumnGroups;
  const uint block = invocation / kBlockPixels / kColumnGroups;
  if (block >= a.blocks) return;
  const uvec2 origin = a.origins.at[block];
  const uint rows = origin.x + column < a.width ? min(kBlockPixels, a.height - origin.y) : 0;

  float sums[kTaps * kTapColumns * kChannels];  // [row][column][channel]
  // Loops of at most 32 turns, so that drivers unroll them, and the sums become registers and not an array.
  [[unroll]] for (uint i = 0; i < kTaps * kTapColumns; ++i) {
    [[unroll]] for (uint c = 0; c < kChannels; ++c) sums[i * kChannels + c] = 0;
  }
  uint non_finite = 0, bad_shade = 0;
  uint slot = (block * kBlockArea + column) * a.samples_per_pixel;
  uint out_row = (block * kTaps + column_group * kTapColumns) * kChannels * kPaddedRows * kBlockPixels + column;
  // Loops test at their ends: a software device goes through the rest of a loop's body once more after its exit.
  uint y = 0;
  do {
    const uint end_slot = slot + a.samples_per_pixel;
    uint pair = slot / 2;
    if (y < rows) do {
      // With an odd number of samples, a pair may hold one of the pixel before or after.
      const bvec2 valid = bvec2(2 * pair >= slot, 2 * pair + 1 < end_slot);
      float value[kPairValues];
      loadPair(pair, valid, value, non_finite, bad_shade);
      const uvec2 positions = unpack32(a.positions.at[pair]);
      [[unroll]] for (uint s = 0; s < 2; ++s) {
        const vec2 position = unpackPosition(positions[s]);
        float weight_x[kTapColumns];
        [[unroll]] for (uint i = 0; i < kTapColumns; ++i) {
          weight_x[i] = filterWeight(float(int(column_group * kTapColumns + i) - int(kPad)) + 0.5 - position.x);
        }
        [[unroll]] for (uint j = 0; j < kTaps; ++j) {
          const float any_y = filterWeight(float(int(j) - int(kPad)) + 0.5 - position.y);
          const float weight_y = valid[s] ? any_y : 0;
          [[unroll]] for (uint i = 0; i < kTapColumns; ++i) {
            precise float weight = weight_x[i] * weight_y;
            [[unroll]] for (uint c = 0; c < kChannels; ++c) {
              const uint at = (j * kTapColumns + i) * kChannels + c;
              precise float sum = sums[at] + (c == kWeightChannel ? weight : weight * value[s * kChannels + c]);
              sums[at] = sum;
            }
          }
        }
      }
    } while (2 * ++pair < end_slot);
    slot += kBlockPixels * a.samples_per_pixel;
    // The first row is complete: the next pixel is one further down.
    [[unroll]] for (uint i = 0; i < kTapColumns; ++i) {
      [[unroll]] for (uint c = 0; c < kChannels; ++c) {
        a.taps.at[out_row + (i * kChannels + c) * kPaddedRows * kBlockPixels] = sums[i * kChannels + c];
      }
    }
    out_row += kBlockPixels;
    [[unroll]] for (uint i = 0; i < (kTaps - 1) * kTapColumns; ++i) {
      [[unroll]] for (uint c = 0; c < kChannels; ++c) {
        sums[i * kChannels + c] = sums[(i + kTapColumns) * kChannels + c];
      }
    }
    [[unroll]] for (uint i = (kTaps - 1) * kTapColumns; i < kTaps * kTapColumns; ++i) {
      [[unroll]] for (uint c = 0; c < kChannels; ++c) sums[i * kChannels + c] = 0;
    }
  } while (++y < kPaddedRows);
  if (column_group == 0 && non_finite > 0) atomicAdd(a.counters.non_finite, non_finite);
  if (column_group == 0 && bad_shade > 0) atomicAdd(a.counters.bad_shade, bad_shade);
}
