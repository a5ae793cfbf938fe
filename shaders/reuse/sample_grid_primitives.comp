// Writes each primitive's key and range of samples; `count` is the end of the range until sample_grid_shape.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "sample_grid.glsl"

layout(push_constant, scalar) uniform Arguments {
  SurfaceKeys keys;
  Words order;
  Words heads;  // heads up to and without sample i; sample i is of primitive heads[i + 1] - 1
  Primitives primitives;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  const uint primitive = heads.at[i + 1] - 1;
  if (heads.at[i] == primitive) {
    primitives.at[primitive].key = keys.at[order.at[i]];
    primitives.at[primitive].first = i;
  }
  if (i + 1 == count || heads.at[i + 2] - 1 != primitive) primitives.at[primitive].count = i + 1;
}
