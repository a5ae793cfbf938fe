// Stores the samples in the order of their cells, and counts those of each cell. An invocation takes a run of samples,
// so that few atomics meet.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Words cells;  // by sample id
  Points grid_points;
  Words grid_ids;
  Words cell_counts;  // must start as 0
  uint count;
  uint run_length;
};

void main() {
  const uint first = invocation() * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  uint run_first = first;
  uint cell = cells.at[order.at[first]];
  for (uint i = first; i < end; ++i) {
    const uint id = order.at[i];
    grid_points.at[i] = points.at[id];
    grid_ids.at[i] = id;
    const uint next = cells.at[id];
    if (next != cell) {
      atomicAdd(cell_counts.at[cell], i - run_first);
      cell = next;
      run_first = i;
    }
  }
  atomicAdd(cell_counts.at[cell], end - run_first);
}
