// Bounds of the samples of each primitive. An invocation takes a run of samples, so that few atomics meet.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Words order;
  Words heads;   // as in sample_grid_primitives
  Words ranges;  // per primitive: smallest u and v, complements of the largest, as bits; must start as all ones
  uint count;
  uint run_length;
};

void add(uint primitive, uvec2 low, uvec2 high) {
  atomicMin(ranges.at[4 * primitive], low.x);
  atomicMin(ranges.at[4 * primitive + 1], low.y);
  atomicMin(ranges.at[4 * primitive + 2], ~high.x);
  atomicMin(ranges.at[4 * primitive + 3], ~high.y);
}

void main() {
  const uint first = invocation() * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  uint primitive = heads.at[first + 1] - 1;
  uvec2 low = uvec2(0xffffffffu);
  uvec2 high = uvec2(0);
  for (uint i = first; i < end; ++i) {
    const uint next = heads.at[i + 1] - 1;
    if (next != primitive) {
      add(primitive, low, high);
      primitive = next;
      low = uvec2(0xffffffffu);
      high = uvec2(0);
    }
    const uvec2 bits = floatBitsToUint(points.at[order.at[i]]);
    low = min(low, bits);
    high = max(high, bits);
  }
  add(primitive, low, high);
}
