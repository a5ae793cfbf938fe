#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

// Splats the radiance of one layer.

#include "records.h"
#include "film/filter.glsl"
const uint kChannels = 3;
const uint kWeightChannel = 3;  // none
const uint kPairValues = 2 * kChannels;
#include "film/splat.glsl"
#include "film/radiance.glsl"

layout(push_constant, scalar) uniform Arguments {
  SplatArguments common_arguments;
  RadianceArguments radiance_arguments;
};

void loadPair(uint pair, bvec2 valid, out float value[kPairValues], inout uint non_finite, inout uint bad_shade) {
  vec3 color[2];
  loadRadiancePair(radiance_arguments, pair, valid, color, non_finite, bad_shade);
  [[unroll]] for (uint i = 0; i < 2 * kChannels; ++i) value[i] = color[i / kChannels][i % kChannels];
}

void main() { splat(common_arguments); }
