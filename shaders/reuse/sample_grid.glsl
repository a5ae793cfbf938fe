// Layout and arithmetic of the grids (core/reuse/sample_grid.h explains both).
#include "unit_square.glsl"

// Written by sample_grid_primitives, sample_grid_shape and sample_grid_layout; read by everything after them.
struct GridPrimitive {
  SurfaceKey key;
  uint first;       // its samples are first .. first + count
  uint count;       // at least 1
  uint first_cell;  // its cell (i, j) is first_cell + j * columns + i
  uint columns;
  uint rows;
  vec2 low;             // corner of the grid
  vec2 cells_per_unit;  // 0 along an axis that has one cell
};

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Primitives {
  GridPrimitive at[];
};

// Column (or row) of a coordinate. Rounding is monotone in every operation, so that this function is too: whatever
// lies between x and y is in a column from columnOf(x) to columnOf(y). Search must use that, and no borders of
// cells, which are known only to some rounding.
uint columnOf(float x, float low, float cells_per_unit, uint columns) {
  precise const float offset = x - low;
  precise const float column = offset * cells_per_unit;
  return min(uint(clamp(column, 0.0, 2147483520.0)), columns - 1);
}
uvec2 cellOf(GridPrimitive p, vec2 at) {
  return uvec2(columnOf(at.x, p.low.x, p.cells_per_unit.x, p.columns),
               columnOf(at.y, p.low.y, p.cells_per_unit.y, p.rows));
}
uint cellNumber(GridPrimitive p, uvec2 cell) { return p.first_cell + cell.y * p.columns + cell.x; }

// Child of a cell that has none.
const uint kNoChild = 0xffffffffu;
// Instead of a child: all samples of the cell are equally far from everything, so that only the first of them, whose
// id is the lowest, can be found.
const uint kOnePlace = 0xfffffffeu;
