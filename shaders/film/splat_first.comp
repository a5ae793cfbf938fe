#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

// Splats the radiance of the first layer (channels 0 to 2), and with it what all layers share: normal
// (3 to 5), coverage (6), and the filter weight itself (7).

#include "records.h"
#include "film/filter.glsl"
const uint kChannels = 8;
const uint kWeightChannel = 7;
const uint kPairValues = 2 * kChannels;
#include "film/splat.glsl"
#include "film/radiance.glsl"

layout(push_constant, scalar) uniform Arguments {
  SplatArguments common_arguments;
  RadianceArguments radiance_arguments;
  Pairs normal;    // per slot
  Pairs coverage;  // per slot
};

void loadPair(uint pair, bvec2 valid, out float value[kPairValues], inout uint non_finite, inout uint bad_shade) {
  vec3 color[2], normals[2];
  loadRadiancePair(radiance_arguments, pair, valid, color, non_finite, bad_shade);
  vec3Pair(normal, pair, normals);
  const vec2 coverages = floatPair(coverage, pair);
  [[unroll]] for (uint s = 0; s < 2; ++s) {
    const bool finite = isFiniteValue(normals[s]) && isFiniteValue(coverages[s]);
    non_finite += valid[s] && !finite ? 1 : 0;
    [[unroll]] for (uint c = 0; c < 3; ++c) {
      value[s * kChannels + c] = color[s][c];
      value[s * kChannels + 3 + c] = finite ? normals[s][c] : 0;
    }
    value[s * kChannels + 6] = finite ? coverages[s] : 0;
  }
}

void main() { splat(common_arguments); }
