// How often each digit occurs in each run of consecutive keys: first half of a radix sort pass.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words keys;
  Words counters;  // [digit][run]
  uint count;
  uint run_length;
  uint runs;
  uint first_bit;
  uint digits;  // a power of two
};

void main() {
  const uint run = invocation();
  if (run >= runs) return;
  for (uint digit = 0; digit < digits; ++digit) counters.at[digit * runs + run] = 0;
  const uint first = min(run * run_length, count);
  const uint end = min(first + run_length, count);
  for (uint i = first; i < end; ++i) {
    const uint digit = (keys.at[i] >> first_bit) & (digits - 1);
    counters.at[digit * runs + run] += 1;
  }
}
