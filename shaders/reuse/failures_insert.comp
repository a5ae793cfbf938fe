// Enters all runs into a hash table that keeps the first run of each group. Where a group stands may depend on the
// order of the invocations; which run it keeps does not. What a place holds changes only from empty to a run,
// and to earlier ones of the same group: it does not matter how late a change is seen.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"
#include "failures.glsl"

layout(push_constant, scalar) uniform Arguments {
  Grouping by;
  Words run_slots;
  Words table;   // must start as kEmptySlot
  Words places;  // per run: where its group stands
  uint run_count;
  uint capacity;  // a power of two, at least twice run_count
};

void main() {
  const uint run = invocation();
  if (run >= run_count) return;
  const uint slot = run_slots.at[run];
  uint place = hashOfGroup(by, slot) & (capacity - 1);
  for (;; place = (place + 1) & (capacity - 1)) {
    uint other = table.at[place];
    if (other == kEmptySlot) other = atomicCompSwap(table.at[place], kEmptySlot, run);
    if (other == kEmptySlot) break;
    if (sameGroup(by, run_slots.at[other], slot)) {
      if (run < other) atomicMin(table.at[place], run);
      break;
    }
  }
  places.at[run] = place;
}
