// Moves keys and values to their places by one digit, in order within equal digits: second half of a pass.
// Each invocation owns a run of consecutive keys and the counters of that run, so no atomics are needed.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words keys;
  Words values;
  Words sorted_keys;
  Words sorted_values;
  Words counters;  // [digit][run]: exclusive scan of radix_sort_count's
  uint count;
  uint run_length;
  uint runs;
  uint first_bit;
  uint digits;  // a power of two
};

void main() {
  const uint run = invocation();
  const uint first = run * run_length;
  if (run >= runs || first >= count) return;
  const uint end = min(first + run_length, count);
  for (uint i = first; i < end; ++i) {
    const uint key = keys.at[i];
    const uint counter = ((key >> first_bit) & (digits - 1)) * runs + run;
    const uint place = counters.at[counter];
    counters.at[counter] = place + 1;
    sorted_keys.at[place] = key;
    sorted_values.at[place] = values.at[i];
  }
}
