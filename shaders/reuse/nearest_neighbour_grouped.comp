// Nearest neighbours of antialiasing samples by groups: those of one subgroup that lie on the same primitive
// walk its tree together, so that the lanes can share what they load. A pixel's samples mostly need the same
// few leaves. Groups that are small or far apart are left, as kShadePending, to nearest_neighbour.comp.
//
// Everything but the lanes' own samples is uniform over the subgroup. Right for any subgroup size, if
// subgroups are full; each lane takes kRounds samples.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"
#include "nearest_neighbour.glsl"

// Whether footprints count.
layout(constant_id = 0) const bool kMetric = false;

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
  uint unused;
  float weight;  // c of the metric
};

const uint kRounds = 4;
// Fewer samples than this walk faster one by one; after kMaxSmallGroups of them, all that is left does.
const uint kMinGroup = 5;
const uint kMaxSmallGroups = 4;
// Leaves that a group of n samples may visit: kMinLeaves + n / kSamplesPerLeaf. More in the metric, where leaves hold
// samples of other footprints too.
const uint kMinLeaves = kMetric ? 16 : 4;
const uint kSamplesPerLeaf = kMetric ? 1 : 4;
const float kGroupOctaves = 1.0;  // by how much the footprints of a group differ at most

SurfaceKey key[kRounds];  // kNoInstance once served
vec2 q[kRounds];
Footprint footprint[kRounds];  // only with kMetric
// Of the samples of the current group; best is -1 for all others, so that nothing is nearer.
float best[kRounds];
uint best_id[kRounds];
// Box around the current group.
vec2 group_low;
vec2 group_high;

// The lowest key left, or kNoInstance.
SurfaceKey nextKey() {
  SurfaceKey next = SurfaceKey(kNoInstance, 0xffffffffu);
  [[unroll]] for (uint r = 0; r < kRounds; ++r) next.instance = min(next.instance, key[r].instance);
  next.instance = subgroupMin(next.instance);
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    if (key[r].instance == next.instance) next.primitive_side = min(next.primitive_side, key[r].primitive_side);
  }
  next.primitive_side = subgroupMin(next.primitive_side);
  return next;
}

// Makes the samples with this key the current group and takes them out of `key`; returns how many they are.
// In the metric only those of like footprints: of others the neighbours are others.
uint startGroup(SurfaceKey of) {
  bool mine[kRounds];
  float largest_log2 = kLargestPart;
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    mine[r] = key[r].instance == of.instance && key[r].primitive_side == of.primitive_side;
    if (kMetric && mine[r]) largest_log2 = min(largest_log2, footprint[r].log2_radius);
  }
  if (kMetric) largest_log2 = subgroupMin(largest_log2) + kGroupOctaves;
  uint members = 0;
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    if (kMetric) mine[r] = mine[r] && footprint[r].log2_radius <= largest_log2;
    members += mine[r] ? 1 : 0;
    best[r] = mine[r] ? kFar : -1.0;
    key[r].instance = mine[r] ? kNoInstance : key[r].instance;
  }
  return subgroupAdd(members);
}

void boundGroup() {
  vec2 low = vec2(1.0);
  vec2 high = vec2(0.0);
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    low = best[r] >= 0.0 ? min(low, q[r]) : low;
    high = best[r] >= 0.0 ? max(high, q[r]) : high;
  }
  group_low = subgroupMin(low);
  group_high = subgroupMax(high);
}

// The leaf below `node` of `level` that holds `to`. Levels of one coordinate have sorted borders, of which the
// lanes look at up to seven at once, and so step down up to three levels.
uint descend(TreePrimitive p, vec2 to, uint node, uint level) {
  const uint depth = depthOf(p);
  const uint u_levels = uLevelsOf(p);
  const uint widest = min(3, findMSB(gl_SubgroupSize + 1));
  while (level < depth) {
    const bool in_u = level < u_levels;
    const uint step = min(widest, (in_u ? u_levels : depth) - level);
    const uint child = gl_SubgroupInvocationID + 1;
    const bool has_border = child < (1u << step);
    node <<= step;
    const float border = boxes.at[4 * (p.first_node + node + (has_border ? child : 0)) + (in_u ? 0 : 1)];
    node += subgroupBallotBitCount(subgroupBallot(has_border && (in_u ? to.x : to.y) >= border));
    level += step;
  }
  return node;
}

void searchLeaf(uint first, uint end) {
  for (uint base = first; base < end; base += gl_SubgroupSize) {
    const uint mine = min(base + gl_SubgroupInvocationID, end - 1);
    const vec2 my_point = pairAt(tree_points, mine);
    const uint my_id = tree_ids.at[mine];
    Footprint my_footprint = Footprint(0.0, 0.0);
    if (kMetric) my_footprint = footprintAt(tree_footprints, mine);
    const uint lanes = min(gl_SubgroupSize, end - base);
    for (uint lane = 0; lane < lanes; ++lane) {
      const vec2 point = subgroupBroadcast(my_point, lane);
      const uint id = subgroupBroadcast(my_id, lane);
      Footprint other = my_footprint;
      if (kMetric) {
        other.log2_radius = subgroupBroadcast(my_footprint.log2_radius, lane);
        other.squared_radius = subgroupBroadcast(my_footprint.squared_radius, lane);
      }
      [[unroll]] for (uint r = 0; r < kRounds; ++r) {
        float squared = squaredDistance(q[r], point);
        if (kMetric) squared = withPart(squared, footprintPart(footprint[r], other, weight));
        const bool better = squared < best[r] || (squared == best[r] && id < best_id[r]);
        best[r] = better ? squared : best[r];
        best_id[r] = better ? id : best_id[r];
      }
    }
  }
}

// Bit l: on the way from level `above` down to the leaf `node`, the sibling at level l is near enough to the
// group's box to matter. Each lane looks at one level.
uint nearSiblings(TreePrimitive p, uint node, uint above) {
  float farthest = best[0];
  [[unroll]] for (uint r = 1; r < kRounds; ++r) farthest = max(farthest, best[r]);
  farthest = subgroupMax(farthest);
  FloatPairs corners = FloatPairs(uint64_t(boxes));
  const uint depth = depthOf(p);
  uint near_levels = 0;
  for (uint top = depth; top > above;) {
    const uint lanes = min(min(gl_SubgroupSize, 32), top - above);
    const uint level = top - min(gl_SubgroupInvocationID, lanes - 1);
    const uint sibling = p.first_node + ((node >> (depth - level)) ^ 1);
    const float bound = squaredDistanceOfBoxes(group_low, group_high, pairAt(corners, 2 * sibling),
                                               pairAt(corners, 2 * sibling + 1));
    const uint hits = subgroupBallot(gl_SubgroupInvocationID < lanes && bound <= farthest).x;
    near_levels |= bitfieldReverse(hits) >> (31 - top);  // lane i looked at level top - i
    top -= lanes;
  }
  return near_levels;
}

// Whether anything below the node can be nearer to a sample than its best, or as near and of a lower id.
bool matters(uint node) {
  const vec2 low = vec2(boxes.at[4 * node], boxes.at[4 * node + 1]);
  const vec2 high = vec2(boxes.at[4 * node + 2], boxes.at[4 * node + 3]);
  const uint lowest_id = lowest_ids.at[node];
  FootprintRange range = FootprintRange(0.0, 0.0, 0.0);
  if (kMetric) range = footprintRangeAt(footprint_ranges, node);
  bool any = false;
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    float bound = squaredDistanceOfBoxes(q[r], q[r], low, high);
    if (kMetric) bound = withPart(bound, footprintBound(footprint[r], range, weight));
    any = any || bound < best[r] || (bound == best[r] && lowest_id < best_id[r]);
  }
  return subgroupAny(any);
}

// False when the group gave up.
bool findNearest(TreePrimitive p, uint members) {
  boundGroup();
  const uint depth = depthOf(p);
  const vec2 centre = 0.5 * (group_low + group_high);
  uint leaves = kMinLeaves + members / kSamplesPerLeaf;
  uint node = 1;
  uint level = 0;
  uint pending = 0;  // bit l: the sibling at level l of the current path is to be looked at
  for (;;) {
    node = descend(p, centre, node, level);
    const uint leaf = node - (1u << depth);
    searchLeaf(p.first + firstRank(p.count, leaf, depth), p.first + firstRank(p.count, leaf + 1, depth));
    pending |= nearSiblings(p, node, level);
    bool enter = false;
    uint next = node;
    while (pending != 0 && !enter) {
      level = findMSB(pending);
      pending &= ~(1u << level);
      next = (node >> (depth - level)) ^ 1;
      enter = matters(p.first_node + next);
    }
    if (!enter) return true;
    if (--leaves == 0) return false;
    node = next;
  }
}

void main() {
  // A subgroup takes kRounds * size consecutive slots.
  const uint size = min(gl_SubgroupSize, gl_WorkGroupSize.x);
  const uint number = invocation();
  const uint first = (number / size * kRounds) * size + number % size;
  uint found[kRounds];
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const uint slot = first + r * size;
    key[r] = SurfaceKey(kNoInstance, 0);
    q[r] = vec2(0.0);
    footprint[r] = Footprint(0.0, 0.0);
    if (slot < count) {
      key[r] = keys.at[slot];
      q[r] = inUnitSquare(uv.at[slot]);
      if (kMetric) footprint[r] = footprintOf(radii.at[slot]);
    }
    found[r] = kShadeNone;
  }
  for (uint small = 0; small < kMaxSmallGroups;) {
    const SurfaceKey current = nextKey();
    if (current.instance == kNoInstance) break;
    const uint members = startGroup(current);
    uint unfound = kShadePending;
    bool done = false;
    if (members < kMinGroup) {
      ++small;
    } else {
      const uint primitive = findPrimitive(slots, capacity, primitives, current);
      if (primitive == kNoPrimitive) {
        unfound = kShadeNotFound;
      } else {
        done = findNearest(primitives.at[primitive], members);
      }
    }
    [[unroll]] for (uint r = 0; r < kRounds; ++r) {
      if (best[r] >= 0.0) found[r] = done ? best_id[r] : unfound;
    }
  }
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const uint slot = first + r * size;
    if (slot < count) shade.at[slot] = key[r].instance == kNoInstance ? found[r] : kShadePending;
  }
}
