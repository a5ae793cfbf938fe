// Copies an array of words, or numbers it 0, 1, 2, … where there is no source.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words source;  // not read when numbered
  Words target;
  uint count;
  uint numbered;  // 0: copy
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  if (numbered != 0) {
    target.at[i] = i;
  } else {
    target.at[i] = source.at[i];
  }
}
