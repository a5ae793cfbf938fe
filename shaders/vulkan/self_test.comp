#version 460
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require

// A loop of as many turns as asked for: some drivers silently end loops after 65,535 turns.
// values[i] = the `turns`-th member of a linear congruential sequence that starts with i.
// The twin is selfTestValue() in core/vulkan/device.cpp.

layout(local_size_x = 64, local_size_x_id = 0) in;

layout(buffer_reference, scalar) buffer Values { uint at[]; };

layout(push_constant, scalar) uniform Arguments {
  Values values;
  uint count;
  uint turns;
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint i = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  if (i >= count) return;
  uint value = i;
  for (uint turn = 0; turn < turns; ++turn) value = value * 1664525u + 1013904223u;
  values.at[i] = value;
}
