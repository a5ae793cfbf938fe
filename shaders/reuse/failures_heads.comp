// Marks the first sample of each group of failures, those of one key and one pixel (§2.3), both in sorted order
// and in order of slots. Samples of equal key stand in order of slots, so a pixel's are side by side.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  SurfaceKeys failed_keys;
  Words failed;  // slots, ascending
  Words order;   // numbers in `failed`, sorted by key
  Words sorted_marks;  // one more than samples, for the scan
  Words slot_marks;    // likewise
  uint count;
  uint samples_per_pixel;
};

bool startsGroup(uint i) {
  if (i == 0) return true;
  const uint a = order.at[i - 1];
  const uint b = order.at[i];
  const SurfaceKey x = failed_keys.at[a];
  const SurfaceKey y = failed_keys.at[b];
  return x.instance != y.instance || x.primitive_side != y.primitive_side ||
         failed.at[a] / samples_per_pixel != failed.at[b] / samples_per_pixel;
}

void main() {
  const uint i = invocation();
  if (i > count) return;
  if (i == count) {
    sorted_marks.at[i] = 0;
    slot_marks.at[i] = 0;
    return;
  }
  const uint mark = startsGroup(i) ? 1 : 0;
  sorted_marks.at[i] = mark;
  slot_marks.at[order.at[i]] = mark;
}
