// Writes where each tree's nodes start, and how many nodes and slabs there are in all.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words node_starts;
  Words slab_starts;
  Primitives primitives;
  Words totals;  // [0]: nodes, [1]: slabs
  uint primitive_count;
};

void main() {
  const uint i = invocation();
  if (i < primitive_count) primitives.at[i].first_node = node_starts.at[i];
  if (i == primitive_count) {
    totals.at[0] = node_starts.at[i];
    totals.at[1] = slab_starts.at[i];
  }
}
