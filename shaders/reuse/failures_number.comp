// Gives every failed sample a shade of its own.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words failed;  // slots
  Words shade;
  uint count;
  uint first_shade;
};

void main() {
  const uint i = invocation();
  if (i < count) shade.at[failed.at[i]] = first_shade + i;
}
