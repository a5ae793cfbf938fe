// Enters the keys of all primitives, which differ, into the table. Which slot a key gets may depend on the
// order of the invocations; what is found there does not.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words primitives;  // records that start with their keys
  Words slots;       // must start as kEmptySlot
  uint primitive_count;
  uint capacity;  // a power of two, more than primitive_count
  uint stride;    // words of a record
};

void main() {
  const uint primitive = invocation();
  if (primitive >= primitive_count) return;
  Words record = Words(uint64_t(primitives) + 4ul * stride * primitive);
  uint slot = hashOf(SurfaceKey(record.at[0], record.at[1]));
  while (atomicCompSwap(slots.at[slot & (capacity - 1)], kEmptySlot, primitive) != kEmptySlot) ++slot;
}
