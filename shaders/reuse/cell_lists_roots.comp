// Places of the root cells, and how many samples the grid has in each.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "cell_lists.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives grid_primitives;
  Words cell_starts;
  Words first_nodes;  // per primitive, and the end
  CellPrimitives primitives;
  CellPlaces places;
  Words counts;
  uint primitive_count;
  uint node_count;
  uint run_length;
};

uint primitiveOf(uint node) {
  uint low = 0;
  uint high = primitive_count;
  while (high - low > 1) {
    const uint middle = (low + high) / 2;
    if (first_nodes.at[middle] <= node) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

void main() {
  const uint first = invocation() * run_length;
  if (first >= node_count) return;
  uint i = primitiveOf(first);
  for (uint node = first; node < min(first + run_length, node_count); ++node) {
    while (node >= first_nodes.at[i + 1]) ++i;
    const uint number = node - first_nodes.at[i];
    const uint columns = primitives.at[i].columns;
    if (number == 0) primitives.at[i].first_node = node;
    const uvec2 cell = uvec2(number % columns, number / columns);
    uint count = 0;
    if (columns > 1) {
      const GridPrimitive p = grid_primitives.at[i];
      const uvec2 in_grid = cell - 1;  // beyond the grid also where it wraps
      if (in_grid.x < p.columns && in_grid.y < p.rows) {
        const uint at = cellNumber(p, in_grid);
        count = cell_starts.at[at + 1] - cell_starts.at[at];
      }
    }
    places.at[node] = CellPlace(vec2(cell), i, 0);
    counts.at[node] = count;
  }
}
