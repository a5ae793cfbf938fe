// Writes where a word occurs, in ascending order.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words words;
  Words starts;  // exclusive scan of compaction_count's
  Words places;
  uint count;
  uint run_length;
  uint wanted;
};

void main() {
  const uint run = invocation();
  const uint first = run * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  uint place = starts.at[run];
  for (uint i = first; i < end; ++i) {
    if (words.at[i] == wanted) places.at[place++] = i;
  }
}
