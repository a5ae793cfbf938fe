// The nearest shading sample of the same primitive for each antialiasing sample (§2.2), exactly: one walk of the
// tree per sample. There is no stack: nodes are numbered as in a heap, and `trail` holds for each level
// whether the far child has been entered.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"
#include "nearest_neighbour.glsl"

// Whether footprints count, and further coordinates.
layout(constant_id = 0) const bool kMetric = false;
layout(constant_id = 1) const bool kAspects = false;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Aspects { vec4 at[]; };

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;
  Floats boxes;  // four per node: low u, low v, high u, high v
  Words lowest_ids;
  FloatPairs tree_points;
  Words tree_ids;
  SurfaceKeys keys;
  Points uv;
  Words shade;
  Floats radii;  // these three only with kMetric
  FloatPairs tree_footprints;
  FloatPairs footprint_ranges;
  uint count;
  uint capacity;
  uint only_pending;  // 1: only samples whose shade is kShadePending
  float weight;       // c of the metric
  Aspects aspects;    // these two only with kAspects: by slot
  Aspects sample_aspects;  // and by sample id
};

// What is not a number counts as 0, and nothing as more than 2^40.
// Comparisons on bits, as in footprint.glsl.
float cleanAspect(float a) {
  const uint bits = floatBitsToUint(a) & 0x7fffffffu;
  return bits > 0x7f800000u ? 0.0 : clamp(a, -1099511627776.0, 1099511627776.0);
}
vec4 cleanAspect(vec4 a) {
  return vec4(cleanAspect(a.x), cleanAspect(a.y), cleanAspect(a.z), cleanAspect(a.w));
}

// The further coordinates' part of the squared distance.
float aspectPart(vec4 a, uint id) {
  precise const vec4 d = a - cleanAspect(sample_aspects.at[id]);
  precise const float part = (d.x * d.x + d.y * d.y) + (d.z * d.z + d.w * d.w);
  return part;
}

struct Nearest {
  float squared;
  uint id;
};

// A leaf's samples stand in order of their ids, so that the first of several equally near has the lowest id.
Nearest searchLeaf(uint first, uint end, vec2 q, Footprint footprint, vec4 aspect) {
  float best = kFar;
  uint best_at = first;
  for (uint k = first; k < end; ++k) {
    float squared = squaredDistance(q, pairAt(tree_points, k));
    if (kMetric) squared = withPart(squared, footprintPart(footprint, footprintAt(tree_footprints, k), weight));
    if (kAspects) squared = withPart(squared, aspectPart(aspect, tree_ids.at[k]));
    if (squared < best) {
      best = squared;
      best_at = k;
    }
  }
  return Nearest(best, tree_ids.at[best_at]);
}

// Squared distance to the sibling's near border in the coordinate that separates them: a bound for one load.
float squaredDistanceToBorder(float q, uint sibling, uint axis, bool is_right) {
  const float border = boxes.at[4 * sibling + axis + (is_right ? 0 : 2)];
  precise const float d = max(is_right ? border - q : q - border, 0.0);
  precise const float squared = d * d;
  return squared;
}

float squaredDistanceToNode(vec2 q, Footprint footprint, uint node) {
  FloatPairs corners = FloatPairs(uint64_t(boxes));
  const float squared = squaredDistanceOfBoxes(q, q, pairAt(corners, 2 * node), pairAt(corners, 2 * node + 1));
  if (!kMetric) return squared;
  return withPart(squared, footprintBound(footprint, footprintRangeAt(footprint_ranges, node), weight));
}

// Bounds of nodes leave aspects out, so that they are none too high.
uint findNearest(TreePrimitive p, vec2 q, Footprint footprint, vec4 aspect) {
  const uint depth = depthOf(p);
  const uint u_levels = uLevelsOf(p);
  Nearest nearest = Nearest(kFar, 0);
  uint node = 1;
  uint level = 0;
  uint trail = 0;
  bool tie = false;  // below can only be a sample as near, of a lower id
  for (;;) {
    // Down to a leaf: to the lowest id, or to where q would be.
    while (tie && level < depth) {
      node *= 2;
      if (lowest_ids.at[p.first_node + node + 1] < lowest_ids.at[p.first_node + node]) ++node;
      ++level;
    }
    while (level < depth) {
      const bool in_u = level < u_levels;
      const uint right = 2 * node + 1;
      const float split = boxes.at[4 * (p.first_node + right) + (in_u ? 0 : 1)];
      node = (in_u ? q.x : q.y) >= split ? right : right - 1;
      ++level;
    }
    const uint leaf = node - (1u << depth);
    const Nearest here =
        searchLeaf(p.first + firstRank(p.count, leaf, depth), p.first + firstRank(p.count, leaf + 1, depth), q, footprint,
                   aspect);
    if (here.squared < nearest.squared || (here.squared == nearest.squared && here.id < nearest.id)) nearest = here;
    // Up to the first sibling that may hold something nearer, or as near and of a lower id.
    bool enter = false;
    while (level > 0 && !enter) {
      const uint bit = 1u << level;
      const uint sibling = p.first_node + (node ^ 1);
      const bool in_u = level <= u_levels;
      if ((trail & bit) == 0 && squaredDistanceToBorder(in_u ? q.x : q.y, sibling, in_u ? 0 : 1, (node & 1) == 0) <=
                                    nearest.squared) {
        const float bound = squaredDistanceToNode(q, footprint, sibling);
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
  if (only_pending != 0 && shade.at[slot] != kShadePending) return;
  const SurfaceKey key = keys.at[slot];
  uint found = kShadeNone;
  if (key.instance != kNoInstance) {
    const uint primitive = findPrimitive(slots, capacity, primitives, key);
    found = kShadeNotFound;
    if (primitive != kNoPrimitive) {
      Footprint footprint = Footprint(0.0, 0.0);
      if (kMetric) footprint = footprintOf(radii.at[slot]);
      vec4 aspect = vec4(0.0);
      if (kAspects) aspect = cleanAspect(aspects.at[slot]);
      found = findNearest(primitives.at[primitive], inUnitSquare(uv.at[slot]), footprint, aspect);
    }
  }
  shade.at[slot] = found;
}
