// The nearest shading sample of the same primitive for each antialiasing sample (§2.2), exactly: the lowest id
// of several equally near. One walk of the tree per sample, without a stack: nodes are numbered as in a heap,
// and `trail` holds for each level whether its far child has been entered.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"

// Two floats in one load: on CPU devices a load by address costs the same for 32 and 64 bits.
layout(buffer_reference, scalar, buffer_reference_align = 8) buffer FloatPairs {
  uint64_t at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats {
  float at[];
};

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;
  FloatPairs boxes;  // two per node: low, high
  Words lowest_ids;
  FloatPairs tree_points;
  Words tree_ids;
  SurfaceKeys keys;
  Points uv;
  Words shade;
  uint count;
  uint capacity;
};

// Found so far; id is kNotAnId until the first leaf.
struct Nearest {
  float squared;
  uint id;
};

const uint kNotAnId = 0xffffffffu;

vec2 pairAt(FloatPairs pairs, uint i) { return uintBitsToFloat(unpackUint2x32(pairs.at[i])); }

float squaredDistance(vec2 a, vec2 b) {
  precise const vec2 d = a - b;
  precise const float squared = d.x * d.x + d.y * d.y;
  return squared;
}

// Never above squaredDistance() to any point in the box, since every operation rounds monotonically.
float squaredDistanceToBox(vec2 q, uint node) {
  const vec2 low = pairAt(boxes, 2 * node);
  const vec2 high = pairAt(boxes, 2 * node + 1);
  precise const vec2 d = max(max(low - q, q - high), 0.0);
  precise const float squared = d.x * d.x + d.y * d.y;
  return squared;
}

// squaredDistanceToBox() in one coordinate, across the border to the node's sibling: one load.
float squaredDistanceToBorder(float q, uint node, uint axis, bool right) {
  const float border = Floats(uint64_t(boxes)).at[4 * node + axis + (right ? 0 : 2)];
  precise const float d = max(right ? border - q : q - border, 0.0);
  precise const float squared = d * d;
  return squared;
}

// Ids are read once per leaf, or once more where distances tie.
Nearest searchLeaf(uint first, uint end, vec2 q, Nearest nearest) {
  float best = nearest.squared;
  uint best_at = end;
  bool tie = false;
  for (uint k = first; k < end; ++k) {
    const float squared = squaredDistance(q, pairAt(tree_points, k));
    const bool better = squared < best;
    tie = !better && (tie || squared == best);
    best = better ? squared : best;
    best_at = better ? k : best_at;
  }
  uint id = best < nearest.squared ? kNotAnId : nearest.id;
  if (best_at < end) id = tree_ids.at[best_at];
  for (uint k = first; tie && k < end; ++k) {
    if (squaredDistance(q, pairAt(tree_points, k)) == best) id = min(id, tree_ids.at[k]);
  }
  return Nearest(best, id);
}

uint findNearest(TreePrimitive p, vec2 q) {
  const uint depth = depthOf(p);
  const uint u_levels = uLevelsOf(p);
  Nearest nearest = Nearest(uintBitsToFloat(0x7f800000u), kNotAnId);  // infinitely far
  uint node = 1;
  uint level = 0;
  uint trail = 0;
  bool tie = false;  // only an equally near sample of a lower id can be below
  for (;;) {
    // Down to a leaf: to the lowest id, or to where q would be.
    while (tie && level < depth) {
      node = 2 * node;
      if (lowest_ids.at[p.first_node + node + 1] < lowest_ids.at[p.first_node + node]) ++node;
      ++level;
    }
    while (level < depth) {
      const bool in_u = level < u_levels;
      const uint right = 2 * node + 1;
      const float split = Floats(uint64_t(boxes)).at[4 * (p.first_node + right) + (in_u ? 0 : 1)];
      node = (in_u ? q.x : q.y) >= split ? right : right - 1;
      ++level;
    }
    const uint leaf = node - (1u << depth);
    nearest = searchLeaf(p.first + firstRank(p.count, leaf, depth), p.first + firstRank(p.count, leaf + 1, depth), q,
                         nearest);
    // Up to the first sibling that can hold something nearer, or as near with a lower id.
    bool enter = false;
    while (level > 0 && !enter) {
      const uint bit = 1u << level;
      const uint sibling = p.first_node + (node ^ 1);
      const bool in_u = level <= u_levels;
      if ((trail & bit) == 0 && squaredDistanceToBorder(in_u ? q.x : q.y, sibling, in_u ? 0 : 1, (node & 1) == 0) <=
                                    nearest.squared) {
        const float bound = squaredDistanceToBox(q, sibling);
        tie = bound == nearest.squared;
        enter = bound < nearest.squared || (tie && lowest_ids.at[sibling] < nearest.id);
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
    if (level == 0) return nearest.id;
  }
}

void main() {
  const uint slot = invocation();
  if (slot >= count) return;
  const SurfaceKey key = keys.at[slot];
  uint found = kShadeNone;
  if (key.instance != kNoInstance) {
    const uint primitive = findPrimitive(slots, capacity, primitives, key);
    found = kShadeNotFound;
    if (primitive != kNoPrimitive) found = findNearest(primitives.at[primitive], inUnitSquare(uv.at[slot]));
  }
  shade.at[slot] = found;
}
