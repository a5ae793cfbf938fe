// How many runs of failed samples start in each stretch of slots.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"
#include "failures.glsl"

layout(push_constant, scalar) uniform Arguments {
  Grouping by;
  Words shade;
  Words counts;  // one per stretch, and one more for the scan
  uint count;
};

void main() {
  const uint stretch = invocation();
  const uint stretches = (count + kStretch - 1) / kStretch;
  if (stretch > stretches) return;
  const uint end = min((stretch + 1) * kStretch, count);
  Run run = kNoRun;
  uint starts = 0;
  for (uint slot = stretch * kStretch; slot < end; ++slot) {
    if (shade.at[slot] == kShadeNotFound && startsRun(run, by, slot)) ++starts;
  }
  counts.at[stretch] = starts;
}
