#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

// Splats the radiance of one layer: throughput * radiance[shade], or throughput alone.

#include "records.h"
#include "film/filter.glsl"
const uint kChannels = 3;
#include "film/splat.glsl"

layout(buffer_reference, scalar) readonly buffer Colors { vec3 at[]; };
layout(buffer_reference, scalar) readonly buffer Shades { uint at[]; };

layout(push_constant, scalar) uniform Arguments {
  SplatArguments common_arguments;
  Colors throughput;  // per slot
  Shades shade;       // per slot
  Colors radiance;
  uint radiance_count;
};

void loadSample(uint slot, out float value[kChannels], out bool finite, out bool bad) {
  const uint index = shade.at[slot];
  bad = index != kShadeNone && index >= radiance_count;
  vec3 color = bad ? vec3(0) : throughput.at[slot];
  if (index != kShadeNone && !bad) color *= radiance.at[index];
  finite = isFiniteValue(color.x) && isFiniteValue(color.y) && isFiniteValue(color.z);
  value[0] = finite ? color.x : 0;
  value[1] = finite ? color.y : 0;
  value[2] = finite ? color.z : 0;
}

void main() { splat(common_arguments); }
