// Makes the grids of the next level, one per marked cell: their samples, not yet their cells.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "sample_grid_refine.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words cell_starts;  // of the cells of this level, in the grid
  Words marks;        // exclusive scan of sample_grid_refine_mark's
  Words items;        // likewise
  Words children;
  Grids grids;
  Words first_items;
  uint cell_count;
  uint first_grid;  // number of the first of them among all refined grids
};

void main() {
  const uint cell = invocation();
  if (cell >= cell_count) return;
  const uint i = marks.at[cell];
  if (marks.at[cell + 1] == i) return;
  children.at[cell] = first_grid + i;
  const uint first = cell_starts.at[cell];
  grids.at[i].key = SurfaceKey(kNoInstance, 0);
  grids.at[i].first = first;
  grids.at[i].count = first + (items.at[cell + 1] - items.at[cell]);  // the end until sample_grid_shape
  first_items.at[i] = items.at[cell];
}
