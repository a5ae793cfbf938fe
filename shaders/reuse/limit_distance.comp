// Takes their neighbour from antialiasing samples that are too far from it, so that they fail.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "nearest_neighbour.glsl"

layout(push_constant, scalar) uniform Arguments {
  Points sample_uv;
  Points uv;
  Floats radii;
  Words shade;
  uint count;
  uint sample_count;
  float limit;  // in footprints; above 0
};

void main() {
  const uint slot = invocation();
  if (slot >= count) return;
  const uint id = shade.at[slot];
  if (id >= sample_count) return;  // nothing found, or served already
  // Nothing is farther than sqrt(2): beyond, a reach need not be told apart, and its square cannot overflow.
  precise const float reach = min(limit * clampedFootprint(radii.at[slot]), 2.0);
  precise const float squared_reach = reach * reach;
  const float squared = squaredDistance(inUnitSquare(uv.at[slot]), inUnitSquare(sample_uv.at[id]));
  if (squared > squared_reach) shade.at[slot] = kShadeNotFound;
}
