// Writes where each primitive's cells start.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words first_cells;
  Primitives primitives;
  uint primitive_count;
  uint offset;
};

void main() {
  const uint i = invocation();
  if (i < primitive_count) primitives.at[i].first_cell = offset + first_cells.at[i];
}
