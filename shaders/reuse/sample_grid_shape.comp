// The grid of each primitive: as many cells as asked for, about square, over the bounds of its samples.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words ranges;  // as in sample_grid_extents
  Primitives primitives;
  Words cell_counts;  // one more than primitives, for the scan
  uint primitive_count;
  float cells_per_sample;
  uint spare_cells;  // after each primitive's
};

// Closer together than this, points are equally far from every point: squares below 1e-45 are 0, and of larger
// coordinates such differences are below rounding.
const float kNoExtent = 1e-30;

void main() {
  const uint i = invocation();
  if (i > primitive_count) return;
  if (i == primitive_count) {
    cell_counts.at[i] = 0;
    return;
  }
  const uint count = primitives.at[i].count - primitives.at[i].first;
  const vec2 low = uintBitsToFloat(uvec2(ranges.at[4 * i], ranges.at[4 * i + 1]));
  const vec2 high = uintBitsToFloat(~uvec2(ranges.at[4 * i + 2], ranges.at[4 * i + 3]));
  const vec2 size = high - low;
  const bool wide = size.x > kNoExtent;
  const bool tall = size.y > kNoExtent;
  const uint wanted = clamp(uint(min(float(count) * cells_per_sample, 2147483520.0)), 1, count);
  uint columns = 1;
  if (wide) {
    columns = wanted;
    if (tall) columns = clamp(uint(min(sqrt(float(wanted) * (size.x / size.y)), 2147483520.0) + 0.5), 1, wanted);
  }
  const uint rows = tall ? wanted / columns : 1;
  primitives.at[i].count = count;
  primitives.at[i].columns = columns;
  primitives.at[i].rows = rows;
  primitives.at[i].low = low;
  primitives.at[i].cells_per_unit =
      vec2(columns > 1 ? float(columns) / size.x : 0.0, rows > 1 ? float(rows) / size.y : 0.0);
  cell_counts.at[i] = columns * rows + spare_cells;
}
