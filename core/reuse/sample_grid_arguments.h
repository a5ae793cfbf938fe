// Arguments of the kernels that both build and refine grids.
#pragma once

#include <cstdint>

namespace encore {

struct ExtentsArguments {  // of sample_grid_extents.comp
  uint64_t points, order, heads, ranges;
  uint32_t count, run_length;
};
struct ShapeArguments {  // of sample_grid_shape.comp
  uint64_t ranges, primitives, cell_counts;
  uint32_t primitive_count;
  float cells_per_sample;
  uint32_t spare_cells;
};
struct LayoutArguments {  // of sample_grid_layout.comp
  uint64_t first_cells, primitives;
  uint32_t primitive_count, offset;
};
struct CellsArguments {  // of sample_grid_cells.comp
  uint64_t points, order, heads, primitives, cells;
  uint32_t count;
};

}  // namespace encore
