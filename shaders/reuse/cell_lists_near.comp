// Lists of leaves, found in the sample grid around each. Leaves with too many samples around them, or too few, stay
// what they are: kHardLeaf.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "cell_lists.glsl"
#include "cell_lists_leaf.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives grid_primitives;
  Words cell_starts;
  FloatPairs grid_points;
  Words grid_ids;
  CellPrimitives primitives;
  CellPlaces places;
  LongWords nodes;
  Words lists;   // kListLimit words per leaf of this dispatch
  Words counts;  // per leaf, and one more for the scan
  uint first;    // leaves first .. end
  uint end;
  uint small_primitive;
};

// Samples that are looked at for one leaf, in each of the two passes.
const uint kScanLimit = 512;
const float kWidestStart = 8.0;  // root cells around the centre in which a near sample is looked for

// Limits from the sample nearest to the centre among those of the cells around it; false when there is none.
bool findLimits(GridPrimitive p) {
  for (float reach = 0.5; reach <= kWidestStart; reach *= 2.0) {
    const uvec2 from = cellOf(p, centre - reach * cell_size);
    const uvec2 to = cellOf(p, centre + reach * cell_size);
    uint scanned = 0;
    for (uint row = from.y; row <= to.y; ++row) {
      const uint row_first = cell_starts.at[cellNumber(p, uvec2(from.x, row))];
      const uint row_end = cell_starts.at[cellNumber(p, uvec2(to.x, row)) + 1];
      scanned += row_end - row_first;
      if (scanned > kScanLimit) return false;
      for (uint at = row_first; at < row_end; ++at) limitBy(pairAt(grid_points, at));
    }
    if (scanned > 0) return true;
  }
  return false;
}

// The part of a row of cells, by u, that lies in any of the discs around the corners: x to y, empty where x > y.
vec2 reachInRow(GridPrimitive p, uint row) {
  vec2 span = vec2(2.0, -1.0);
  float low = -1.0;
  float high = 2.0;
  if (p.rows > 1) {
    const float size = 1.0 / p.cells_per_unit.y;
    const float margin = size * (0.01 + float(row) * 9.5367431640625e-7) + p.low.y * 4.76837158203125e-7;
    if (row > 0) low = p.low.y + float(row) * size - margin;
    if (row + 1 < p.rows) high = p.low.y + float(row + 1) * size + margin;
  }
  for (uint i = 0; i < 4; ++i) {
    const vec2 corner = cornerOf(i);
    const float beyond = max(max(low - corner.y, corner.y - high), 0.0);
    const float left = limits[i] - beyond * beyond;
    if (left < 0.0) continue;
    const float half_width = sqrt(left) * 1.001 + sqrt(limits[i]) * 1e-3;
    span = vec2(min(span.x, corner.x - half_width), max(span.y, corner.x + half_width));
  }
  return span;
}

// False when there is too much to look at.
bool findCandidates(GridPrimitive p) {
  float low = 2.0;
  float high = -1.0;
  for (uint i = 0; i < 4; ++i) {
    const float reach = sqrt(limits[i]) * 1.001;
    low = min(low, cornerOf(i).y - reach);
    high = max(high, cornerOf(i).y + reach);
  }
  const uint last_row = cellOf(p, vec2(0.0, high)).y;
  uint scanned = 0;
  for (uint row = cellOf(p, vec2(0.0, low)).y; row <= last_row; ++row) {
    const vec2 span = reachInRow(p, row);
    if (span.x > span.y) continue;
    const uint row_first = cell_starts.at[cellNumber(p, uvec2(cellOf(p, span.xx).x, row))];
    const uint row_end = cell_starts.at[cellNumber(p, uvec2(cellOf(p, span.yy).x, row)) + 1];
    scanned += row_end - row_first;
    if (scanned > kScanLimit) return false;
    for (uint at = row_first; at < row_end; ++at) offer(at, pairAt(grid_points, at));
  }
  return true;
}

bool findList(CellPlace place) {
  const GridPrimitive p = grid_primitives.at[place.primitive];
  placeLeaf(place, primitives.at[place.primitive]);
  list_count = 0;
  near_squared = 8.0;
  limits = vec4(8.0);
  if (p.count <= small_primitive) {
    for (uint at = p.first; at < p.first + p.count; ++at) offer(at, pairAt(grid_points, at));
  } else if (!findLimits(p) || !findCandidates(p)) {
    return false;
  }
  if (list_count > kListLimit) return false;
  thinList(grid_points, grid_ids);
  return true;
}

void main() {
  const uint i = invocation();
  if (first + i > end) return;
  if (first + i == end) {
    counts.at[i] = 0;
    return;
  }
  uint count = 0;
  const uint node = first + i;
  if (unpackUint2x32(nodes.at[node]).y == kHardLeaf && findList(places.at[node])) {
    count = list_count;
    writeList(grid_ids, lists, i * kListLimit);
  }
  counts.at[i] = count;
}
