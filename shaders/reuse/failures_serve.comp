// Gives every failed sample the shade of its head (§2.3): nothing is read that another invocation writes.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words failed;
  Words order;
  Words groups;  // as in failures_groups
  Words group_ranks;
  Words shade;
  uint count;
  uint first_shade;
};

void main() {
  const uint i = invocation();
  if (i < count) shade.at[failed.at[order.at[i]]] = first_shade + group_ranks.at[groups.at[i + 1] - 1];
}
