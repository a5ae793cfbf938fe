// What the reuse kernels share: arrays by device address, the number of an invocation.
// The #extension lines must precede every declaration, so each kernel includes this file first.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

#include "records.h"

layout(local_size_x = 64) in;

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words {
  uint at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Pairs {
  uvec2 at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Points {
  vec2 at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfaceKeys {
  SurfaceKey at[];
};

// Number of this invocation in the dispatch; the last workgroups may lie beyond the range.
uint invocation() {
  return (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
}
