// Stores the samples in the order of the leaves.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Points tree_points;
  Words tree_ids;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  const uint id = order.at[i];
  tree_points.at[i] = points.at[id];
  tree_ids.at[i] = id;
}
