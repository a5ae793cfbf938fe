// Lists the slots of the heads in ascending order, and finds the shade of each run.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words run_slots;
  Words table;
  Words ranks;   // heads before a run
  Words places;  // becomes the run's shade
  Words head_slots;
  uint run_count;
  uint first_shade;
};

void main() {
  const uint run = invocation();
  if (run >= run_count) return;
  const uint head = table.at[places.at[run]];
  if (head == run) head_slots.at[ranks.at[run]] = run_slots.at[run];
  places.at[run] = first_shade + ranks.at[head];
}
