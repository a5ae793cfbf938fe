// The first slot of each run.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"
#include "failures.glsl"

layout(push_constant, scalar) uniform Arguments {
  Grouping by;
  Words shade;
  Words starts;  // exclusive scan of failures_count's
  Words run_slots;
  uint count;
};

void main() {
  const uint stretch = invocation();
  if (stretch * kStretch >= count) return;
  const uint end = min((stretch + 1) * kStretch, count);
  Run run = kNoRun;
  uint number = starts.at[stretch];
  for (uint slot = stretch * kStretch; slot < end; ++slot) {
    if (shade.at[slot] == kShadeNotFound && startsRun(run, by, slot)) run_slots.at[number++] = slot;
  }
}
