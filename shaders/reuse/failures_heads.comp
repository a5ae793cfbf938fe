// Marks the runs that start with the head of their group.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words table;
  Words places;
  Words marks;  // one more than runs, for the scan
  uint run_count;
};

void main() {
  const uint run = invocation();
  if (run > run_count) return;
  marks.at[run] = run < run_count && table.at[places.at[run]] == run ? 1 : 0;
}
