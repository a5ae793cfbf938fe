// Exclusive scan of runs of consecutive words, in place: the downward half of the scan.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words words;
  Words offsets;  // sum of all that precedes a run; not read when there is one run
  uint count;
  uint run_length;
};

void main() {
  const uint run = invocation();
  const uint first = run * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  uint sum = count > run_length ? offsets.at[run] : 0;
  for (uint i = first; i < end; ++i) {
    const uint word = words.at[i];
    words.at[i] = sum;
    sum += word;
  }
}
