// Stores the samples in the order of the leaves, and within a leaf in order of their ids; and what the metric
// needs of their footprints, where it is in force.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "footprint.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Words heads;  // as in trees_primitives
  Primitives primitives;
  Points tree_points;
  Words tree_ids;
  Floats radii;  // null: no metric
  Footprints tree_footprints;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  const TreePrimitive p = primitives.at[heads.at[i + 1] - 1];
  const uint depth = depthOf(p);
  const uint leaf = nodeOfRank(p.count, i - p.first, depth);
  const uint first = p.first + firstRank(p.count, leaf, depth);
  const uint end = p.first + firstRank(p.count, leaf + 1, depth);
  const uint id = order.at[i];
  uint place = first;
  for (uint k = first; k < end; ++k) place += order.at[k] < id ? 1 : 0;
  tree_points.at[place] = points.at[id];
  tree_ids.at[place] = id;
  if (uint64_t(radii) != 0) tree_footprints.at[place] = footprintOf(radii.at[id]);
}
