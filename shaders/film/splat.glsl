// Part one of filtering: every pixel adds its own samples, weighted, into the sums that it contributes
// to the (2 kPad + 1)² pixels around it ("taps"). Gathering by sum_taps.comp follows.
//
// The including kernel defines kChannels and loadSample(), and declares the arguments `common_arguments`
// (type SplatArguments). An invocation is a pixel of a block and kTapRows rows of its taps: wide
// filters have more sums than an invocation should keep.
//
// A single-precision sum over a pixel's samples: right for a few hundred samples per pixel.

layout(constant_id = 4) const uint kTapRows = 1;  // divides kTaps

const uint kTaps = 2 * kPad + 1;
const uint kRowGroups = kTaps / kTapRows;

layout(local_size_x = 64) in;

layout(buffer_reference, scalar) readonly buffer Positions { uint at[]; };
layout(buffer_reference, scalar) readonly buffer Origins { uvec2 at[]; };
layout(buffer_reference, scalar) writeonly buffer Taps { float at[]; };
layout(buffer_reference, scalar) buffer Counters {
  uint non_finite;  // samples that count as 0
  uint bad_shade;   // samples whose shade index is out of range
};

struct SplatArguments {
  Origins origins;      // of the blocks, in pixels of the image
  Positions positions;  // per slot, records.h
  Taps taps;            // [block][tap row][tap column][channel][pixel]
  Counters counters;
  uint blocks;
  uint width;  // of the image
  uint height;
  uint samples_per_pixel;
};

// By exponent: comparisons with infinity and NaN may be optimised away.
bool isFiniteValue(float v) { return (floatBitsToUint(v) & 0x7f800000u) != 0x7f800000u; }

// Sample position within its pixel, in [0, 1)²; exact.
vec2 unpackPosition(uint packed) { return vec2(packed & 0xffffu, packed >> 16) * (1.0 / 65536.0); }

// Value of a sample. finite, bad: see Counters.
void loadSample(uint slot, out float value[kChannels], out bool finite, out bool bad);

void splat(SplatArguments a) {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint invocation = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  const uint pixel = invocation % kBlockArea;
  const uint row_group = invocation / kBlockArea % kRowGroups;
  const uint block = invocation / kBlockArea / kRowGroups;
  if (block >= a.blocks) return;
  const uvec2 at = a.origins.at[block] + uvec2(pixel % kBlockPixels, pixel / kBlockPixels);
  const bool inside = at.x < a.width && at.y < a.height;

  float sums[kTapRows * kTaps * kChannels];
  for (uint i = 0; i < kTapRows * kTaps * kChannels; ++i) sums[i] = 0;
  uint non_finite = 0, bad_shades = 0;
  const uint first_slot = (block * kBlockArea + pixel) * a.samples_per_pixel;
  const uint end_slot = first_slot + (inside ? a.samples_per_pixel : 0);
  for (uint slot = first_slot; slot < end_slot; ++slot) {
    const vec2 position = unpackPosition(a.positions.at[slot]);
    float value[kChannels];
    bool finite, bad;
    loadSample(slot, value, finite, bad);
    non_finite += finite ? 0 : 1;
    bad_shades += bad ? 1 : 0;
    float weight_x[kTaps];
    for (uint i = 0; i < kTaps; ++i) weight_x[i] = filterWeight(float(int(i) - int(kPad)) + 0.5 - position.x);
    for (uint j = 0; j < kTapRows; ++j) {
      const float row = float(int(row_group * kTapRows + j) - int(kPad));
      const float weight_y = filterWeight(row + 0.5 - position.y);
      for (uint i = 0; i < kTaps; ++i) {
        for (uint c = 0; c < kChannels; ++c) {
          sums[(j * kTaps + i) * kChannels + c] += weight_x[i] * (weight_y * value[c]);
        }
      }
    }
  }

  const uint first_sum = (block * kTaps + row_group * kTapRows) * kTaps * kChannels;
  for (uint i = 0; i < kTapRows * kTaps * kChannels; ++i) {
    a.taps.at[(first_sum + i) * kBlockArea + pixel] = sums[i];
  }
  if (row_group == 0 && non_finite > 0) atomicAdd(a.counters.non_finite, non_finite);
  if (row_group == 0 && bad_shades > 0) atomicAdd(a.counters.bad_shade, bad_shades);
}
