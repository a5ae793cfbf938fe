// Enters the keys of all primitives, which differ, into the table. Which slot a key gets may depend on the
// order of the invocations; what is found there does not.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;  // must start as kEmptySlot
  uint primitive_count;
  uint capacity;  // a power of two, more than primitive_count
};

void main() {
  const uint primitive = invocation();
  if (primitive >= primitive_count) return;
  uint slot = hashOf(primitives.at[primitive].key);
  while (atomicCompSwap(slots.at[slot & (capacity - 1)], kEmptySlot, primitive) != kEmptySlot) ++slot;
}
