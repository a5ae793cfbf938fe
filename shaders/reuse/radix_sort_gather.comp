// The word that each value is to be sorted by.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words words;  // value v is sorted by words[v * stride + offset]
  Words values;
  Words keys;
  uint count;
  uint stride;
  uint offset;
};

void main() {
  const uint i = invocation();
  if (i < count) keys.at[i] = words.at[values.at[i] * stride + offset];
}
