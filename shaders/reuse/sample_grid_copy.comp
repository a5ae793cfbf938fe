// Copies words.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words source;
  Words target;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i < count) target.at[i] = source.at[i];
}
