// Counts the samples of the leaves from number `first_leaf` on. An invocation takes a run of samples.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"
#include "cell_lists.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives grid_primitives;
  Points grid_points;
  CellPrimitives primitives;
  LongWords nodes;
  Words counts;
  uint primitive_count;
  uint sample_count;
  uint first_leaf;
  uint run_length;
};

uint primitiveOf(uint sample_number) {
  uint low = 0;
  uint high = primitive_count;
  while (high - low > 1) {
    const uint middle = (low + high) / 2;
    if (grid_primitives.at[middle].first <= sample_number) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

void main() {
  const uint first = invocation() * run_length;
  if (first >= sample_count) return;
  uint i = primitiveOf(first);
  uint primitive_end = grid_primitives.at[i].first + grid_primitives.at[i].count;
  CellPrimitive p = primitives.at[i];
  for (uint at = first; at < min(first + run_length, sample_count); ++at) {
    if (at == primitive_end) {
      ++i;
      primitive_end = at + grid_primitives.at[i].count;
      p = primitives.at[i];
    }
    uint leaf;
    leafOf(nodes, p.origin, p.cells_per_unit, uvec2(p.columns, p.rows), p.first_node, grid_points.at[at], leaf);
    if (leaf >= first_leaf) atomicAdd(counts.at[leaf], 1);
  }
}
