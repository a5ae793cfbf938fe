// The samples' coordinates, brought into the unit square.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "unit_square.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points uv;
  Points points;
  uint count;
};

void main() {
  const uint i = invocation();
  if (i < count) points.at[i] = normalInUnitSquare(uv.at[i]);
}
