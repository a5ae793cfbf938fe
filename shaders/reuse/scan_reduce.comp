// Sums of runs of consecutive words: the upward half of the scan.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words words;
  Words sums;  // one per run
  uint count;
  uint run_length;
};

void main() {
  const uint run = invocation();
  const uint first = run * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  uint sum = 0;
  for (uint i = first; i < end; ++i) sum += words.at[i];
  sums.at[run] = sum;
}
