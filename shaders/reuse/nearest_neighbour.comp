// The nearest shading sample of the same primitive for each antialiasing sample (§2.2), exactly: the lowest id
// of several equally near. One walk of the tree per sample, without a stack: nodes are numbered as in a heap,
// and `trail` holds for each level whether its far child has been entered.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;
  Boxes boxes;
  Words lowest_ids;
  Points tree_points;
  Words tree_ids;
  SurfaceKeys keys;
  Points uv;
  Words shade;
  uint count;
  uint capacity;
};

float squaredDistance(vec2 a, vec2 b) {
  precise const vec2 d = a - b;
  precise const float squared = d.x * d.x + d.y * d.y;
  return squared;
}

// Never above squaredDistance() to any point in the box: every operation rounds monotonically.
float squaredDistanceToBox(vec2 q, vec4 box) {
  precise const vec2 d = max(max(box.xy - q, q - box.zw), 0.0);
  precise const float squared = d.x * d.x + d.y * d.y;
  return squared;
}

uint findNearest(TreePrimitive p, vec2 q) {
  const uint depth = depthOf(p);
  const uint u_levels = uLevelsOf(p);
  float best = uintBitsToFloat(0x7f800000u);  // infinity
  uint best_at = p.first;
  uint node = 1;
  uint level = 0;
  uint trail = 0;
  for (;;) {
    for (; level < depth; ++level) {
      const uint right = 2 * node + 1;
      const vec2 split = boxes.at[p.first_node + right].xy;
      const bool go_right = level < u_levels ? q.x >= split.x : q.y >= split.y;
      node = go_right ? right : right - 1;
    }
    const uint leaf = node - (1u << depth);
    const uint end = p.first + firstRank(p.count, leaf + 1, depth);
    for (uint k = p.first + firstRank(p.count, leaf, depth); k < end; ++k) {
      const float squared = squaredDistance(q, tree_points.at[k]);
      if (squared < best || (squared == best && tree_ids.at[k] < tree_ids.at[best_at])) {
        best = squared;
        best_at = k;
      }
    }
    bool enter = false;
    while (level > 0 && !enter) {
      const uint bit = 1u << level;
      if ((trail & bit) == 0) {
        const uint sibling = p.first_node + (node ^ 1);
        const float bound = squaredDistanceToBox(q, boxes.at[sibling]);
        enter = bound < best || (bound == best && lowest_ids.at[sibling] < tree_ids.at[best_at]);
      }
      if (enter) {
        trail |= bit;
        node ^= 1;
      } else {
        trail &= ~bit;
        node >>= 1;
        --level;
      }
    }
    if (level == 0) break;
  }
  return tree_ids.at[best_at];
}

void main() {
  const uint slot = invocation();
  if (slot >= count) return;
  const SurfaceKey key = keys.at[slot];
  if (key.instance == kNoInstance) {
    shade.at[slot] = kShadeNone;
    return;
  }
  const uint primitive = findPrimitive(slots, capacity, primitives, key);
  shade.at[slot] = primitive == kNoPrimitive ? kShadeNotFound
                                             : findNearest(primitives.at[primitive], inUnitSquare(uv.at[slot]));
}
