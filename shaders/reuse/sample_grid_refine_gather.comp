// Copies the samples that are to be sorted anew, and notes the grid of each.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "sample_grid_refine.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points grid_points;
  Words grid_ids;
  Grids grids;
  Words first_items;
  Points points;
  Words ids;
  Words heads;  // item i is of grid heads[i + 1] - 1
  uint item_count;
  uint grid_count;
};

void main() {
  const uint i = invocation();
  if (i >= item_count) return;
  const uint grid = ownerOf(first_items, grid_count, i);
  const uint from = grids.at[grid].first + (i - first_items.at[grid]);
  points.at[i] = grid_points.at[from];
  ids.at[i] = grid_ids.at[from];
  heads.at[i + 1] = grid + 1;
}
