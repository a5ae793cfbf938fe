#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

// Splats what all layers share: normal (channels 0 to 2), coverage (3), and the filter weight itself (4).

#include "records.h"
#include "film/filter.glsl"
const uint kChannels = 5;
#include "film/splat.glsl"

layout(buffer_reference, scalar) readonly buffer Normals { vec3 at[]; };
layout(buffer_reference, scalar) readonly buffer Coverages { float at[]; };

layout(push_constant, scalar) uniform Arguments {
  SplatArguments common_arguments;
  Normals normal;      // per slot
  Coverages coverage;  // per slot
};

void loadSample(uint slot, out float value[kChannels], out bool finite, out bool bad) {
  const vec3 n = normal.at[slot];
  const float alpha = coverage.at[slot];
  finite = isFiniteValue(n.x) && isFiniteValue(n.y) && isFiniteValue(n.z) && isFiniteValue(alpha);
  value[0] = finite ? n.x : 0;
  value[1] = finite ? n.y : 0;
  value[2] = finite ? n.z : 0;
  value[3] = finite ? alpha : 0;
  value[4] = 1;
  bad = false;
}

void main() { splat(common_arguments); }
