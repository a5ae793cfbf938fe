// Marks the first sample of each primitive, in the order (key, id). One mark more than samples, for the scan.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  SurfaceKeys keys;
  Words order;
  Words marks;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i > count) return;
  if (i == 0 || i == count) {
    marks.at[i] = i == 0 ? 1 : 0;
    return;
  }
  const SurfaceKey key = keys.at[order.at[i]];
  const SurfaceKey last = keys.at[order.at[i - 1]];
  marks.at[i] = key.instance != last.instance || key.primitive_side != last.primitive_side ? 1 : 0;
}
