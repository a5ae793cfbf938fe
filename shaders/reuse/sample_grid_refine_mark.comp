// Marks the cells that are to be refined, and counts their samples. One more than cells, for the scans.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "sample_grid_refine.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words starts;
  Words children;
  Words marks;
  Words items;
  uint cell_count;
  uint max_cell;
};

void main() {
  const uint cell = invocation();
  if (cell > cell_count) return;
  uint samples = 0;
  if (cell < cell_count) samples = starts.at[cell + 1] - starts.at[cell];
  const bool crowded = samples > max_cell && children.at[cell] != kOnePlace;
  marks.at[cell] = crowded ? 1 : 0;
  items.at[cell] = crowded ? samples : 0;
}
