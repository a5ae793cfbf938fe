// Notes which grids are crowded and cannot be refined: those whose samples are all at one place.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "sample_grid_refine.glsl"

layout(push_constant, scalar) uniform Arguments {
  Grids grids;
  Words children;  // of this level's cells, and one more: whether there is such a grid; must start as kNoChild
  uint grid_count;
  uint first_cell;  // of this level
  uint cell_count;  // of this level
  uint max_cell;
};

void main() {
  const uint i = invocation();
  if (i >= grid_count) return;
  const GridPrimitive grid = grids.at[i];
  if (grid.count > max_cell && grid.columns * grid.rows == 1) {
    children.at[grid.first_cell - first_cell] = kOnePlace;
    children.at[cell_count] = kOnePlace;
  }
}
