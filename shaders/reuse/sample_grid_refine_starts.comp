// From numbers of items to places in the grid.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "sample_grid_refine.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words item_starts;   // of the cells of this level
  Words first_cells;   // of its grids, counted within the level
  Grids grids;
  Words first_items;
  Words cell_starts;
  uint cell_count;
  uint grid_count;
};

void main() {
  const uint cell = invocation();
  if (cell >= cell_count) return;
  const uint grid = ownerOf(first_cells, grid_count, cell);
  cell_starts.at[cell] = grids.at[grid].first + (item_starts.at[cell] - first_items.at[grid]);
}
