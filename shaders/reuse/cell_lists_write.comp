// Stores the lists of some leaves behind those that are stored already. What finds no room is left to the trees.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "cell_lists.glsl"

layout(push_constant, scalar) uniform Arguments {
  FloatPairs points;  // what the lists index
  Words ids;
  LongWords nodes;
  Words lists;    // list_limit words per leaf
  Words starts;   // of their lists, from 0, and the end
  FloatPairs entry_points;
  Words entry_ids;
  Words totals;  // [1]: entries stored before; [2]: leaves without a list
  uint first;    // leaves first .. end
  uint end;
  uint list_limit;
  uint capacity;
};

void main() {
  const uint i = invocation();
  if (first + i >= end) return;
  const uint count = starts.at[i + 1] - starts.at[i];
  const uint start = totals.at[1] + starts.at[i];
  if (count == 0 || start + count > capacity) {
    if (unpackUint2x32(nodes.at[first + i]).y == kHardLeaf) atomicAdd(totals.at[2], 1);
    return;
  }
  for (uint k = 0; k < count; ++k) {
    const uint at = lists.at[i * list_limit + k];
    entry_points.at[start + k] = points.at[at];
    entry_ids.at[start + k] = ids.at[at];
  }
  nodes.at[first + i] = packUint2x32(uvec2(start, count));
}
