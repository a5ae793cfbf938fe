// The cell of each sample: cells of all primitives are numbered through, in order of the primitives.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Words heads;  // as in sample_grid_primitives
  Primitives primitives;
  Words cells;  // by sample id
  uint count;
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  const uint id = order.at[i];
  const GridPrimitive p = primitives.at[heads.at[i + 1] - 1];
  cells.at[id] = cellNumber(p, cellOf(p, points.at[id]));
}
