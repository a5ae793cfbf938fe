#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require

// Part two of filtering: the sums of a block's columns become the block's partial image, padded by kPad
// pixels on each side. One invocation per value of it; columns are added from left to right.

#include "records.h"

layout(constant_id = 0) const uint kPad = 0;
layout(constant_id = 1) const uint kChannels = 3;

const uint kTaps = 2 * kPad + 1;
const uint kPadded = kBlockPixels + 2 * kPad;

layout(local_size_x = 64) in;

layout(buffer_reference, scalar) readonly buffer Taps { float at[]; };
layout(buffer_reference, scalar) writeonly buffer Partials { float at[]; };

layout(push_constant, scalar) uniform Arguments {
  Taps taps;          // [block][tap column][channel][row][column], from splat.glsl
  Partials partials;  // [block][channel][row][column]
  uint blocks;
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint invocation = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  const uint x = invocation % kPadded;
  const uint row = invocation / kPadded % (kPadded * kChannels);  // [channel][row]
  const uint block = invocation / (kPadded * kPadded * kChannels);
  if (block >= blocks) return;
  // From the left: the leftmost pixel that reaches x does so with its last column of taps.
  float sum = 0;
  [[unroll]] for (uint i = kTaps; i-- > 0;) {
    const uint from_x = x - i;  // unsigned: left of the block is far beyond it
    const uint tap = ((block * kTaps + i) * kPadded * kChannels + row) * kBlockPixels + from_x;
    if (from_x < kBlockPixels) {
      precise float next = sum + taps.at[tap];
      sum = next;
    }
  }
  partials.at[invocation] = sum;
}
