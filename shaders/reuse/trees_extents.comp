// Smallest and largest v of each primitive. An invocation takes a run of samples, so that few atomics meet.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Words heads;   // as in trees_primitives
  Words ranges;  // per primitive: smallest v, complement of the largest, as bits; must start as all ones
  uint count;
  uint run_length;
};

void add(uint primitive, uint low, uint high) {
  atomicMin(ranges.at[2 * primitive], low);
  atomicMin(ranges.at[2 * primitive + 1], ~high);
}

void main() {
  const uint first = invocation() * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  uint primitive = heads.at[first + 1] - 1;
  uint low = 0xffffffffu;
  uint high = 0;
  for (uint i = first; i < end; ++i) {
    const uint next = heads.at[i + 1] - 1;
    if (next != primitive) {
      add(primitive, low, high);
      primitive = next;
      low = 0xffffffffu;
      high = 0;
    }
    const uint v = floatBitsToUint(points.at[order.at[i]].y);
    low = min(low, v);
    high = max(high, v);
  }
  add(primitive, low, high);
}
