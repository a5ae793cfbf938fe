#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

// Splats values of one to four components, whatever they are.

#include "records.h"
#include "film/filter.glsl"
layout(constant_id = 5) const uint kChannels = 4;
const uint kWeightChannel = 4;  // none
const uint kPairValues = 8;
#include "film/splat.glsl"

layout(push_constant, scalar) uniform Arguments {
  SplatArguments common_arguments;
  Pairs values;  // kChannels floats per slot
};

void loadPair(uint pair, bvec2 valid, out float value[kPairValues], inout uint non_finite, inout uint bad_shade) {
  [[unroll]] for (uint i = 0; i < kChannels; ++i) {
    const vec2 two = floatPair(values, kChannels * pair + i);
    value[2 * i] = two.x;
    value[2 * i + 1] = two.y;
  }
  [[unroll]] for (uint s = 0; s < 2; ++s) {
    bool finite = true;
    [[unroll]] for (uint c = 0; c < kChannels; ++c) finite = finite && isFiniteValue(value[s * kChannels + c]);
    non_finite += valid[s] && !finite ? 1 : 0;
    [[unroll]] for (uint c = 0; c < kChannels; ++c) {
      value[s * kChannels + c] = finite ? value[s * kChannels + c] : 0;
    }
  }
}

void main() { splat(common_arguments); }
