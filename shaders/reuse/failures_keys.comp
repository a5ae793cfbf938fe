// Gathers the keys of failed samples.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  SurfaceKeys keys;
  Words failed;
  SurfaceKeys failed_keys;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i < count) failed_keys.at[i] = keys.at[failed.at[i]];
}
