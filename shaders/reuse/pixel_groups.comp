// Nearest neighbours by groups: the samples of a few pixels that lie on one primitive look at the same candidates,
// which are those that can be nearest anywhere in the group's box. Groups for which that does not pay are
// searched sample by sample.
//
// Let t be any sample. Where another one, c, is nearer than t is a half-plane; so if c is farther than t from all
// corners of the box, it is farther everywhere in it.
//
// A subgroup takes a pixel, some pixels, or a part of one; everything but the lanes' own samples is uniform over it.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "pixel_groups.glsl"
#include "pixel_groups_single.glsl"

layout(constant_id = 0) const uint kRounds = 8;  // samples of a lane

// Primitives of up to so many samples are not searched: all of them are candidates.
const uint kFewSamples = 16;
// A group looks at no more samples than kMinLooks + members * kLooksPerMember.
const uint kMinLooks = 64;
const uint kLooksPerMember = 4;
const int kMaxHalfWidth = 4;  // cells around the box's centre, in which a near sample is looked for
// Fewer samples than this search faster one by one; after kMaxSmallGroups of them, all that is left does.
const uint kMinGroup = 4;
const uint kMaxSmallGroups = 6;
// A group that looks at too many samples is halved. So often at most, in all of a unit's groups together.
const uint kMaxHalvings = 16;

SurfaceKey key[kRounds];  // kNoInstance once served
vec2 q[kRounds];
// Of the samples of the current group; best is -1 for all others, so that nothing is nearer.
float best[kRounds];
uint best_id[kRounds];  // what was found for samples that have been served
// Corners of the box around the current group, and how far t is from each.
vec2 low, high;
vec4 limit;

// Ranges of samples that the current group is offered: lane i's is the i-th.
uint offered_ranges, offered_first, offered_end;
bool pending;   // whether any sample is left to be searched alone
uint halvings;  // that are still allowed

uint laneCount() { return min(gl_SubgroupSize, gl_WorkGroupSize.x); }

// A key that is left, or kNoInstance.
SurfaceKey nextKey() {
  SurfaceKey mine = key[0];
  [[unroll]] for (uint r = 1; r < kRounds; ++r) {
    const bool none = mine.instance == kNoInstance;
    mine.instance = none ? key[r].instance : mine.instance;
    mine.primitive_side = none ? key[r].primitive_side : mine.primitive_side;
  }
  const uvec4 ballot = subgroupBallot(mine.instance != kNoInstance);
  if (ballot == uvec4(0)) return SurfaceKey(kNoInstance, 0);
  const uint lane = subgroupBallotFindLSB(ballot);
  return SurfaceKey(subgroupBroadcast(mine.instance, lane), subgroupBroadcast(mine.primitive_side, lane));
}

// Makes the samples with this key the current group and takes them out of `key`; returns how many they are.
uint startGroup(SurfaceKey of) {
  uint members = 0;
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const bool mine = key[r].instance == of.instance && key[r].primitive_side == of.primitive_side;
    members += mine ? 1 : 0;
    best[r] = mine ? kFar : -1.0;
    key[r].instance = mine ? kNoInstance : key[r].instance;
  }
  return subgroupAdd(members);
}

void endGroup(uint result) {
  [[unroll]] for (uint r = 0; r < kRounds; ++r) best_id[r] = best[r] >= 0.0 ? result : best_id[r];
}

void boundGroup() {
  vec2 my_low = vec2(1.0);
  vec2 my_high = vec2(0.0);
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    my_low = best[r] >= 0.0 ? min(my_low, q[r]) : my_low;
    my_high = best[r] >= 0.0 ? max(my_high, q[r]) : my_high;
  }
  low = subgroupMin(my_low);
  high = subgroupMax(my_high);
}

vec4 squaredDistancesOfCorners(vec2 p) {
  const vec2 a = (low - p) * (low - p);
  const vec2 b = (high - p) * (high - p);
  return vec4(a.x + a.y, b.x + a.y, a.x + b.y, b.x + b.y);
}

void consider(uint r, float squared, uint id) {
  const bool better = squared < best[r] || (squared == best[r] && id < best_id[r]);
  best[r] = better ? squared : best[r];
  best_id[r] = better ? id : best_id[r];
}

void offerAll(uint first, uint end) {
  const uint size = laneCount();
  for (uint base = first; base < end; base += size) {
    const uint mine = min(base + gl_SubgroupInvocationID, end - 1);
    const vec2 my_point = pairAt(points, mine);
    const uint my_id = ids.at[mine];
    const uint lanes = min(end - base, size);
    for (uint lane = 0; lane < lanes; ++lane) {
      const vec2 point = vec2(subgroupBroadcast(my_point.x, lane), subgroupBroadcast(my_point.y, lane));
      const uint id = subgroupBroadcast(my_id, lane);
      [[unroll]] for (uint r = 0; r < kRounds; ++r) consider(r, squaredDistance(q[r], point), id);
    }
  }
}

struct Candidate {
  vec2 point;
  uint id;
};
// Candidates wait until there are four, because what a lane keeps of its samples is best read and written seldom.
Candidate queue[4];
uint queued;

void sortById(inout Candidate a, inout Candidate b) {
  const bool right = a.id < b.id;
  const Candidate first = Candidate(right ? a.point : b.point, min(a.id, b.id));
  b = Candidate(right ? b.point : a.point, max(a.id, b.id));
  a = first;
}

// What of the queue has been offered before does no harm.
void offerQueue() {
  queued = 0;
  sortById(queue[0], queue[1]);
  sortById(queue[2], queue[3]);
  sortById(queue[0], queue[2]);
  sortById(queue[1], queue[3]);
  sortById(queue[1], queue[2]);
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const float a = squaredDistance(q[r], queue[0].point);
    const float b = squaredDistance(q[r], queue[1].point);
    const float c = squaredDistance(q[r], queue[2].point);
    const float d = squaredDistance(q[r], queue[3].point);
    // In order of ids, so that the lowest of equally near ones stays.
    const float ab = b < a ? b : a;
    const uint ab_id = b < a ? queue[1].id : queue[0].id;
    const float cd = d < c ? d : c;
    const uint cd_id = d < c ? queue[3].id : queue[2].id;
    consider(r, cd < ab ? cd : ab, cd < ab ? cd_id : ab_id);
  }
}

// Offers what can win of some ranges of samples: lane i's is the i-th.
void offerCandidates(uint ranges, uint my_first, uint my_end) {
  const uint size = laneCount();
  [[unroll]] for (uint i = 0; i < 4; ++i) queue[i] = Candidate(vec2(8.0), 0xffffffffu);  // farther than kFar
  queued = 0;
  for (uint range = 0; range < ranges; ++range) {
    const uint end = subgroupBroadcast(my_end, range);
    for (uint base = subgroupBroadcast(my_first, range); base < end; base += size) {
      const uint mine = min(base + gl_SubgroupInvocationID, end - 1);
      const vec2 point = pairAt(points, mine);
      const vec4 squared = squaredDistancesOfCorners(point);
      const bool near = !(isCertainlyFarther(squared.x, limit.x) && isCertainlyFarther(squared.y, limit.y) &&
                          isCertainlyFarther(squared.z, limit.z) && isCertainlyFarther(squared.w, limit.w));
      const uint id = ids.at[mine];
      const uvec4 ballot = subgroupBallot(near && base + gl_SubgroupInvocationID < end);
      for (uint word = 0; 32 * word < size; ++word) {
        for (uint bits = ballot[word]; bits != 0; bits &= bits - 1) {
          const uint lane = 32 * word + findLSB(bits);
          queue[3] = queue[2];
          queue[2] = queue[1];
          queue[1] = queue[0];
          queue[0] = Candidate(vec2(subgroupBroadcast(point.x, lane), subgroupBroadcast(point.y, lane)),
                               subgroupBroadcast(id, lane));
          if (++queued == 4) offerQueue();
        }
      }
    }
  }
  if (queued != 0) offerQueue();
}

// A sample near the centre of the box becomes t. Each lane looks at one of a row of cells; any will do.
bool findNearSample(GridPrimitive grid) {
  const vec2 centre = 0.5 * (low + high);
  const ivec2 cell = ivec2(cellOf(grid, centre));
  const ivec2 last = ivec2(grid.columns, grid.rows) - 1;
  for (int half_width = 1; half_width <= kMaxHalfWidth; half_width *= 2) {
    const ivec2 block = ivec2(half_width, half_width / 2);
    const uvec2 from = uvec2(max(cell - block, 0));
    const uvec2 to = uvec2(min(cell + block, last));
    float nearest = kFar;
    vec2 nearest_point = vec2(0.0);
    for (uint row = from.y; row <= to.y; ++row) {
      const uint row_cell = grid.first_cell + row * grid.columns;
      const uint i = cell_starts.at[row_cell + from.x] + gl_SubgroupInvocationID;
      if (i < cell_starts.at[row_cell + to.x + 1]) {
        const vec2 point = pairAt(points, i);
        const float squared = squaredDistance(centre, point);
        nearest_point = squared < nearest ? point : nearest_point;
        nearest = squared < nearest ? squared : nearest;
      }
    }
    const float least = subgroupMin(nearest);
    if (least < kFar) {
      const uint lane = subgroupBallotFindLSB(subgroupBallot(nearest == least));
      limit = squaredDistancesOfCorners(
          vec2(subgroupBroadcast(nearest_point.x, lane), subgroupBroadcast(nearest_point.y, lane)));
      return true;
    }
  }
  return false;
}

// Puts back the samples in the far half of the box, along its longer side, and returns how many remain.
uint halveGroup(SurfaceKey of) {
  const uint axis = high.x - low.x >= high.y - low.y ? 0 : 1;
  const float middle = 0.5 * (low[axis] + high[axis]);
  uint members = 0;
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const bool back = best[r] >= 0.0 && q[r][axis] > middle;
    key[r].instance = back ? of.instance : key[r].instance;
    best[r] = back ? -1.0 : best[r];
    members += best[r] >= 0.0 ? 1 : 0;
  }
  return subgroupAdd(members);
}

// Finds what the group is to be offered. False when that is too many samples.
bool findRows(GridPrimitive primitive, uint members) {
  boundGroup();
  const vec2 centre = 0.5 * (low + high);
  if (!findNearSample(gridAround(primitive, centre, centre))) return false;
  const vec4 reach = vec4(reachOf(limit.x), reachOf(limit.y), reachOf(limit.z), reachOf(limit.w));
  const vec2 from_corner = vec2(min(low.x - max(reach.x, reach.z), high.x - max(reach.y, reach.w)),
                                min(low.y - max(reach.x, reach.y), high.y - max(reach.z, reach.w)));
  const vec2 to_corner = vec2(max(low.x + max(reach.x, reach.z), high.x + max(reach.y, reach.w)),
                              max(low.y + max(reach.x, reach.y), high.y + max(reach.z, reach.w)));
  const GridPrimitive grid = gridAround(primitive, from_corner, to_corner);
  const uvec2 from = cellOf(grid, from_corner);
  const uvec2 to = cellOf(grid, to_corner);
  const uint size = laneCount();
  if (to.y - from.y >= size) return false;
  const uint row = min(from.y + gl_SubgroupInvocationID, to.y);
  const uint row_cell = grid.first_cell + row * grid.columns;
  const uint my_first = cell_starts.at[row_cell + from.x];
  const uint my_end = cell_starts.at[row_cell + to.x + 1];
  const uint looks = subgroupAdd(from.y + gl_SubgroupInvocationID <= to.y ? my_end - my_first : 0);
  if (looks > kMinLooks + members * kLooksPerMember) return false;
  offered_ranges = to.y - from.y + 1;
  offered_first = my_first;
  offered_end = my_end;
  return true;
}

// Consecutive slots from `first` on: a pixel's, or those of some whole pixels, or a part of one pixel's.
void serve(uint first, uint end) {
  const uint size = laneCount();
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const uint slot = first + r * size + gl_SubgroupInvocationID;
    key[r] = SurfaceKey(kNoInstance, 0);
    q[r] = vec2(0.0);
    if (slot < end) {
      key[r] = keyAt(slot);
      q[r] = normalInUnitSquare(pairAt(uv, slot));
    }
    best_id[r] = kShadeNone;
  }
  pending = false;
  halvings = kMaxHalvings;
  for (uint small = 0;;) {
    const SurfaceKey current = nextKey();
    if (current.instance == kNoInstance) break;
    if (small == kMaxSmallGroups) {
      pending = true;
      break;
    }
    uint members = startGroup(current);
    if (members < kMinGroup) ++small;
    const uint number = findPrimitive(slots, capacity, primitives, current);
    if (number == kNoPrimitive) {
      endGroup(kShadeNotFound);
      continue;
    }
    const GridPrimitive primitive = primitives.at[number];
    if (primitive.count <= kFewSamples) {
      offerAll(primitive.first, primitive.first + primitive.count);
      continue;
    }
    bool found = false;
    while (members >= kMinGroup && !found) {
      found = findRows(primitive, members);
      if (found || halvings == 0) break;
      --halvings;
      members = halveGroup(current);
    }
    if (found) {
      offerCandidates(offered_ranges, offered_first, offered_end);
    } else {
      endGroup(kShadePending);
      pending = true;
    }
  }
  [[unroll]] for (uint r = 0; r < kRounds; ++r) {
    const uint slot = first + r * size + gl_SubgroupInvocationID;
    if (slot < end) shade.at[slot] = key[r].instance == kNoInstance ? best_id[r] : kShadePending;
  }
  if (!pending) return;
  for (uint slot = first + gl_SubgroupInvocationID; slot < end; slot += size) {
    if (shade.at[slot] != kShadePending) continue;
    const uint number = findPrimitive(slots, capacity, primitives, keyAt(slot));
    shade.at[slot] = number == kNoPrimitive ? kShadeNotFound
                                            : findAlone(primitives.at[number], normalInUnitSquare(pairAt(uv, slot)));
  }
}

void main() {
  const uint most = kRounds * laneCount();
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint subgroups = gl_NumWorkGroups.x * gl_NumWorkGroups.y * gl_NumSubgroups;
  const uint subgroup = group * gl_NumSubgroups + gl_SubgroupID;
  // A unit is some pixels, or a part of one.
  const uint parts = (samples_per_pixel + most - 1) / most;
  const uint pixels = max(most / samples_per_pixel, 1);
  const uint part = (samples_per_pixel + parts - 1) / parts;
  const uint step = pixels * samples_per_pixel;  // slots of `parts` units
  const uint units = (count + step - 1) / step * parts;
  for (uint unit = subgroup; unit < units; unit += subgroups) {
    const uint base = unit / parts * step;
    const uint first = base + unit % parts * part;
    const uint last = min(base + step, count);
    if (first < last) serve(first, parts == 1 ? last : min(first + part, last));
  }
}
