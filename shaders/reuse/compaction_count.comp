// How often a word occurs in each run of consecutive words.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words words;
  Words counts;  // one per run, and one more for the scan
  uint count;
  uint run_length;
  uint wanted;
};

void main() {
  const uint run = invocation();
  const uint first = run * run_length;
  const uint runs = (count + run_length - 1) / run_length;
  if (run > runs) return;
  uint matches = 0;
  const uint end = min(first + run_length, count);
  for (uint i = min(first, count); i < end; ++i) matches += words.at[i] == wanted ? 1 : 0;
  counts.at[run] = matches;
}
