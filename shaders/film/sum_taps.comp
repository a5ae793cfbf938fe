#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

// Part two of filtering: the sums of a block's pixels become the block's partial image, padded by kPad
// pixels on each side. One invocation per value of it; taps are added in rows, top row first.

#include "records.h"

layout(constant_id = 0) const uint kPad = 0;
layout(constant_id = 1) const uint kChannels = 3;

const uint kTaps = 2 * kPad + 1;
const uint kPadded = kBlockPixels + 2 * kPad;

layout(local_size_x = 64) in;

layout(buffer_reference, scalar) readonly buffer Taps { float at[]; };
layout(buffer_reference, scalar) writeonly buffer Partials { float at[]; };

layout(push_constant, scalar) uniform Arguments {
  Taps taps;          // [block][tap row][tap column][channel][pixel], from splat.glsl
  Partials partials;  // [block][channel][row][column]
  uint blocks;
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint invocation = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  const uint x = invocation % kPadded;
  const uint y = invocation / kPadded % kPadded;
  const uint channel = invocation / (kPadded * kPadded) % kChannels;
  const uint block = invocation / (kPadded * kPadded * kChannels);
  if (block >= blocks) return;
  float sum = 0;
  for (uint j = 0; j < kTaps; ++j) {
    for (uint i = 0; i < kTaps; ++i) {
      // The pixel whose tap (i, j) falls here. Unsigned: left of or above the block is far beyond it.
      const uint from_x = x - i, from_y = y - j;
      if (from_x < kBlockPixels && from_y < kBlockPixels) {
        const uint tap = (block * kTaps + j) * kTaps + i;
        sum += taps.at[(tap * kChannels + channel) * kBlockArea + from_y * kBlockPixels + from_x];
      }
    }
  }
  partials.at[invocation] = sum;
}
