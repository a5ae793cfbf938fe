// Depth of each tree, and how many of its levels split u: as many as make its cells about square.
// Also what it needs of nodes and slabs, and the largest depth.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Words ranges;  // as in trees_extents
  Primitives primitives;
  Words node_counts;  // one more than primitives, for the scan
  Words slab_counts;  // likewise
  Words totals;       // [2]: largest depth, which must start as 0
  uint primitive_count;
};

const uint kBucketSize = 8;

// 2^exponent, exactly. 0 <= exponent < 32.
float powerOfTwo(uint exponent) { return uintBitsToFloat((127 + exponent) << 23); }

void main() {
  const uint i = invocation();
  if (i > primitive_count) return;
  if (i == primitive_count) {
    node_counts.at[i] = 0;
    slab_counts.at[i] = 0;
    return;
  }
  const uint first = primitives.at[i].first;
  const uint count = primitives.at[i].count - first;
  uint depth = 0;
  while (((count - 1) >> depth) >= kBucketSize) ++depth;  // largest leaf: count / 2^depth, rounded up
  // The samples stand in order of u.
  precise const float width = points.at[order.at[first + count - 1]].x - points.at[order.at[first]].x;
  precise const float height = uintBitsToFloat(~ranges.at[2 * i + 1]) - uintBitsToFloat(ranges.at[2 * i]);
  uint u_levels = 0;
  while (u_levels < depth && width * powerOfTwo(depth - u_levels) > height * powerOfTwo(u_levels)) ++u_levels;
  primitives.at[i].count = count;
  primitives.at[i].levels = depth | (u_levels << 8);
  node_counts.at[i] = depth == 0 ? 0 : 2u << depth;
  slab_counts.at[i] = 1u << u_levels;
  atomicMax(totals.at[2], depth);
}
