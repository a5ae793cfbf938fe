// Bounds of each leaf of the trees that have inner nodes, of its samples and of their footprints.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "footprint.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points tree_points;
  Words tree_ids;
  Primitives primitives;
  Words node_starts;
  Boxes boxes;
  Words lowest_ids;
  Words leaf_primitive;  // leaf i of all trees together
  Footprints tree_footprints;  // null: no metric
  FootprintRanges footprint_ranges;
  uint primitive_count;
  uint leaf_count;
};

vec4 footprintRange(uint first, uint end) {
  const Footprint start = tree_footprints.at[first];
  vec4 range = vec4(start.log2_radius, start.log2_radius, start.squared_radius, 0.0);
  for (uint k = first + 1; k < end; ++k) {
    const Footprint footprint = tree_footprints.at[k];
    range.x = min(range.x, footprint.log2_radius);
    range.y = max(range.y, footprint.log2_radius);
    range.z = min(range.z, footprint.squared_radius);
  }
  return range;
}

void main() {
  const uint i = invocation();
  if (i >= leaf_count) return;
  const uint primitive = ownerOf(node_starts, primitive_count, 2 * i);
  leaf_primitive.at[i] = primitive;
  const TreePrimitive p = primitives.at[primitive];
  const uint depth = depthOf(p);
  const uint leaf = i - p.first_node / 2;
  const uint end = p.first + firstRank(p.count, leaf + 1, depth);
  vec2 low = vec2(1.0);
  vec2 high = vec2(0.0);
  uint lowest_id = 0xffffffffu;
  for (uint k = p.first + firstRank(p.count, leaf, depth); k < end; ++k) {
    low = min(low, tree_points.at[k]);
    high = max(high, tree_points.at[k]);
    lowest_id = min(lowest_id, tree_ids.at[k]);
  }
  const uint node = p.first_node + (1u << depth) + leaf;
  boxes.at[node] = vec4(low, high);
  lowest_ids.at[node] = lowest_id;
  if (uint64_t(tree_footprints) != 0) {
    footprint_ranges.at[node] = footprintRange(p.first + firstRank(p.count, leaf, depth), end);
  }
}
