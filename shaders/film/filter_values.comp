#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

// weights[i] = filterWeight(distances[i]): what the film's kernels use, for the test against the C++ twin.

#include "film/filter.glsl"

layout(local_size_x = 64) in;

layout(buffer_reference, scalar) readonly buffer Distances { float at[]; };
layout(buffer_reference, scalar) writeonly buffer Weights { float at[]; };

layout(push_constant, scalar) uniform Arguments {
  Distances distances;  // pixels
  Weights weights;
  uint count;
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint i = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  if (i < count) weights.at[i] = filterWeight(distances.at[i]);
}
