// Gives every failed sample the shade of its group (§2.3).
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"
#include "failures.glsl"

layout(push_constant, scalar) uniform Arguments {
  Grouping by;
  Words shade;
  Words starts;      // as in failures_runs
  Words run_shades;  // per run
  uint count;
};

void main() {
  const uint stretch = invocation();
  if (stretch * kStretch >= count) return;
  const uint end = min((stretch + 1) * kStretch, count);
  Run run = kNoRun;
  uint number = starts.at[stretch];
  uint served = 0;
  for (uint slot = stretch * kStretch; slot < end; ++slot) {
    if (shade.at[slot] != kShadeNotFound) continue;
    if (startsRun(run, by, slot)) served = run_shades.at[number++];
    shade.at[slot] = served;
  }
}
