// Nearest neighbours of the samples that cell_lists_find left, each by a walk of the tree.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "unit_square.glsl"
#include "key_table.glsl"
#include "nearest_neighbour.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;
  FloatPairs corners;  // two per node: low, high
  Words lowest_ids;
  FloatPairs tree_points;
  Words tree_ids;
  SurfaceKeys keys;
  FloatPairs uv;
  Words shade;
  uint count;
  uint capacity;
};
#include "cell_lists_tree.glsl"

float best;
uint best_id;

void searchLeaf(uvec2 range, vec2 q) {
  for (uint at = range.x; at < range.y; ++at) {
    const float squared = squaredDistance(q, pairAt(tree_points, at));
    if (squared > best) continue;
    const uint id = tree_ids.at[at];
    if (squared < best || id < best_id) {
      best = squared;
      best_id = id;
    }
  }
}

uint findNearest(TreePrimitive p, vec2 q) {
  const uint leaves = 1u << depthOf(p);
  best = kFar;
  best_id = 0xffffffffu;
  const uint home = leafAround(p, q);
  searchLeaf(samplesOfLeaf(p, home), q);
  for (uint node = leaves == 1 ? 0 : 2; node != 0;) {
    const uint at = p.first_node + node;
    const float bound = squaredDistanceOfBoxes(q, q, pairAt(corners, 2 * at), pairAt(corners, 2 * at + 1));
    const bool enter = bound < best || (bound == best && lowest_ids.at[at] < best_id);
    if (enter && node >= leaves && node - leaves != home) searchLeaf(samplesOfLeaf(p, node - leaves), q);
    node = enter && node < leaves ? 2 * node : nodeAfter(node);
  }
  return best_id;
}

void main() {
  const uint slot = invocation();
  if (slot >= count || shade.at[slot] != kShadePending) return;
  const TreePrimitive p = primitives.at[findPrimitive(slots, capacity, primitives, keys.at[slot])];
  shade.at[slot] = findNearest(p, normalInUnitSquare(pairAt(uv, slot)));
}
