// The root cells of each primitive: those of its sample grid and one more on each side, so that cells that reach
// to the border of the unit square hold no samples and are seldom asked. A few samples get one cell.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "cell_lists.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives grid_primitives;
  Points grid_points;
  CellPrimitives primitives;
  Words cell_counts;  // one more than primitives, for the scan
  uint primitive_count;
  uint small_primitive;  // samples of a primitive that gets one cell
};

// Bounds of the samples: only where the grid does not tell the size of a cell.
vec2 extentOf(GridPrimitive p) {
  vec2 high = p.low;
  for (uint i = p.first; i < p.first + p.count; ++i) high = max(high, grid_points.at[i]);
  return high - p.low;
}

void main() {
  const uint i = invocation();
  if (i > primitive_count) return;
  if (i == primitive_count) {
    cell_counts.at[i] = 0;
    return;
  }
  const GridPrimitive p = grid_primitives.at[i];
  CellPrimitive made = CellPrimitive(p.key, vec2(0.0), vec2(0.0), 1, 1, 0, 0);
  if (p.count > small_primitive) {
    vec2 size = vec2(0.0);
    if (p.columns > 1) size.x = 1.0 / p.cells_per_unit.x;
    if (p.rows > 1) size.y = 1.0 / p.cells_per_unit.y;
    if (p.columns == 1 || p.rows == 1) {
      const vec2 extent = extentOf(p);
      if (p.columns == 1) size.x = max(extent.x, size.y);
      if (p.rows == 1) size.y = max(extent.y, size.x);
      if (p.columns == 1) size.x = max(size.x, size.y);
    }
    // Closer together than this, points are equally far from every point.
    if (size.x > 1e-30 && size.y > 1e-30) {
      made.origin = p.low - size;
      made.cells_per_unit = 1.0 / size;
      made.columns = p.columns + 2;
      made.rows = p.rows + 2;
    }
  }
  primitives.at[i] = made;
  cell_counts.at[i] = made.columns * made.rows;
}
