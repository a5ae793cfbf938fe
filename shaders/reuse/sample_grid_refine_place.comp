// Stores the samples in the order of their new cells, and counts those of each cell.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "sample_grid_refine.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words ids;
  Words order;
  Words cells;  // by item
  Words heads;  // as in sample_grid_refine_gather
  Grids grids;
  Words first_items;
  Points grid_points;
  Words grid_ids;
  Words cell_counts;  // of this level; must start as 0
  uint item_count;
  uint first_cell;
};

void main() {
  const uint i = invocation();
  if (i >= item_count) return;
  const uint item = order.at[i];
  const uint grid = heads.at[i + 1] - 1;  // grids keep their items' places
  const uint to = grids.at[grid].first + (i - first_items.at[grid]);
  grid_points.at[to] = points.at[item];
  grid_ids.at[to] = ids.at[item];
  atomicAdd(cell_counts.at[cells.at[item] - first_cell], 1);
}
