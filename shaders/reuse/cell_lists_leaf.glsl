// The list of one leaf: all samples that can be the nearest to any point of it.
//
// f(q) = |s - q|² - |t - q|² is affine in q, and with a relative margin on both terms, (1 - e) |s - q|² -
// (1 + e) |t - q|², concave: if s is farther than t at the four corners of a rectangle, by the margin, it is so
// everywhere in it. Squared distances of numbers of 24 bits are computed to within 2^-22 of themselves, at the
// corners and again at the point that is asked about, and what is below 2^-126 may count as 0. So kMargin, which is
// 20 times what that takes, and kTiny make sure that s never has the least computed distance, nor an equal one.
// "Farther" is transitive, so that of what excludes a sample something always stays.

layout(constant_id = 0) const uint kListLimit = 64;  // samples that a list can hold

const float kMargin = 1.00001;
const float kTiny = 1e-35;

vec2 rect_low;
vec2 rect_high;
vec2 centre;     // of the part of the leaf that lies between samples
vec2 cell_size;  // of a root cell
vec4 limits;     // squared distances from the corners beyond which a sample is out
float near_squared;  // of the sample that gave them, from the centre
uint list[kListLimit];
uint list_count;  // of those offered: above kListLimit, some found no room

vec2 cornerOf(uint i) {
  return vec2((i & 1) == 0 ? rect_low.x : rect_high.x, (i & 2) == 0 ? rect_low.y : rect_high.y);
}
vec4 squaredFromCorners(vec2 point) {
  const vec2 a = point - rect_low;
  const vec2 b = point - rect_high;
  const vec2 a2 = a * a;
  const vec2 b2 = b * b;
  return vec4(a2.x + a2.y, b2.x + a2.y, a2.x + b2.y, b2.x + b2.y);
}

// A rectangle that holds every point whose leaf this is. leafOf() rounds three times on the way to t, each time by
// at most 2^-24 of the result, and here as many steps and a division (within 2.5 units in the last place) follow.
// That is below 2^-20 of the distance from the origin, and 2^-23 of the coordinates themselves.
void placeLeaf(CellPlace place, CellPrimitive p) {
  if (p.cells_per_unit.x == 0.0) {
    rect_low = vec2(0.0);
    rect_high = vec2(1.0);
    centre = vec2(0.5);
    cell_size = vec2(1.0);
    return;
  }
  const vec2 size = uintBitsToFloat((uvec2(127) - uvec2(place.bits & 0xffff, place.bits >> 16)) << 23);
  const vec2 end = place.corner + size;
  cell_size = 1.0 / p.cells_per_unit;
  const vec2 margin = end * cell_size * 9.5367431640625e-7 + abs(p.origin) * 1.1920928955078125e-7;
  rect_low = p.origin + place.corner * cell_size - margin;
  rect_high = p.origin + end * cell_size + margin;
  centre = 0.5 * (rect_low + rect_high);
  // Whatever lies beyond the root cells belongs to those at the border.
  if (place.corner.x == 0.0) rect_low.x = 0.0;
  if (place.corner.y == 0.0) rect_low.y = 0.0;
  if (end.x >= float(p.columns)) rect_high.x = 1.0;
  if (end.y >= float(p.rows)) rect_high.y = 1.0;
  rect_low = clamp(rect_low, 0.0, 1.0);
  rect_high = clamp(rect_high, 0.0, 1.0);
}

// Takes over the limits from this sample, if it is nearer to the centre than the one that gave them.
void limitBy(vec2 point) {
  const vec2 d = point - centre;
  const float squared = dot(d, d);
  if (squared < near_squared) {
    near_squared = squared;
    limits = squaredFromCorners(point) * kMargin + kTiny;
  }
}

// Adds the sample at this index of its array to the list if it may be nearest somewhere. Short, and without inner
// loops: a CPU device runs both sides of branches.
void offer(uint at, vec2 point) {
  if (any(lessThanEqual(squaredFromCorners(point), limits))) {
    if (list_count < kListLimit) list[list_count] = at;
    ++list_count;
  }
}

// Lists longer than this are worth being thinned. (Thinning all shortens them by a quarter; what that saves in queries
// is less than it takes.)
const uint kLongList = 12;

// Takes out of a long list what another of it excludes, and of equal points all but the one with the lowest id.
void thinList(FloatPairs points, Words ids) {
  if (list_count <= kLongList) return;
  uint kept = 0;  // in front; what is excluded by something that is taken out is excluded by something that stays
  for (uint i = 0; i < list_count; ++i) {
    const vec2 point = pairAt(points, list[i]);
    const vec4 squared = squaredFromCorners(point);
    bool excluded = all(greaterThan(squared, limits));
    for (uint k = 0; k < kept + list_count - i - 1 && !excluded; ++k) {
      const uint j = k < kept ? k : k - kept + i + 1;
      const vec2 other = pairAt(points, list[j]);
      excluded = all(greaterThan(squared, squaredFromCorners(other) * kMargin + kTiny));
      if (other == point) excluded = ids.at[list[j]] < ids.at[list[i]];
    }
    if (!excluded) list[kept++] = list[i];
  }
  list_count = kept;
}

// In order of ids, so that the first of several equally near is the lowest.
void writeList(Words ids, Words target, uint first) {
  for (uint i = 0; i < list_count; ++i) {
    const uint id = ids.at[list[i]];
    uint rank = 0;
    for (uint j = 0; j < list_count; ++j) rank += ids.at[list[j]] < id ? 1 : 0;
    target.at[first + rank] = list[i];
  }
}
