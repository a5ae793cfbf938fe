// The primitive of each key, or kNoPrimitive.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "key_table.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;
  SurfaceKeys keys;
  Words found;
  uint count;
  uint capacity;
};

void main() {
  const uint i = invocation();
  if (i < count) found.at[i] = findPrimitive(slots, capacity, primitives, keys.at[i]);
}
