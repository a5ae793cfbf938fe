// Bounds of the nodes of one height (1: parents of leaves) from those of their children.
// Each node is made by the invocation of its leftmost leaf.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "footprint.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Boxes boxes;
  Words lowest_ids;
  Words leaf_primitive;
  FootprintRanges footprint_ranges;  // null: no metric
  uint leaf_count;
  uint height;
};

void main() {
  const uint i = invocation();
  if (i >= leaf_count) return;
  const TreePrimitive p = primitives.at[leaf_primitive.at[i]];
  const uint leaf = i - p.first_node / 2;
  const uint depth = depthOf(p);
  if (height > depth || (leaf & ((1u << height) - 1)) != 0) return;
  const uint node = p.first_node + (((1u << depth) + leaf) >> height);
  const uint child = p.first_node + 2 * (node - p.first_node);
  const vec4 left = boxes.at[child];
  const vec4 right = boxes.at[child + 1];
  boxes.at[node] = vec4(min(left.xy, right.xy), max(left.zw, right.zw));
  lowest_ids.at[node] = min(lowest_ids.at[child], lowest_ids.at[child + 1]);
  if (uint64_t(footprint_ranges) != 0) {
    const vec4 a = footprint_ranges.at[child];
    const vec4 b = footprint_ranges.at[child + 1];
    footprint_ranges.at[node] = vec4(min(a.x, b.x), max(a.y, b.y), min(a.z, b.z), 0.0);
  }
}
