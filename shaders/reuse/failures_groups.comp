// Lists the heads by group, and their slots in ascending order.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words failed;
  Words order;
  Words groups;  // heads before i in sorted order: sample i is of group groups[i + 1] - 1
  Words ranks;   // heads before i in order of slots
  Words group_ranks;
  Words head_slots;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  const uint group = groups.at[i];
  if (groups.at[i + 1] == group) return;
  const uint head = order.at[i];
  group_ranks.at[group] = ranks.at[head];
  head_slots.at[ranks.at[head]] = failed.at[head];
}
