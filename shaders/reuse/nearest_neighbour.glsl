// What both nearest-neighbour kernels share. A sample's neighbour is the shading sample of its primitive at the
// least distance in (u, v), or in the metric of §2.4, the lowest id of several: every order of search gives the same
// one, as long as distances are computed by the same expression.

#include "footprint.glsl"

// Two floats in one load: on CPU devices a load by address costs the same for 32 and 64 bits.
layout(buffer_reference, scalar, buffer_reference_align = 8) buffer FloatPairs {
  uint64_t at[];
};

// Squared; farther than any sample can be.
const float kFar = 2.0 * kLargestPart;
// Left by the grouped kernel to the single one.
const uint kShadePending = 0xfffffffdu;

vec2 pairAt(FloatPairs pairs, uint i) { return uintBitsToFloat(unpackUint2x32(pairs.at[i])); }
Footprint footprintAt(FloatPairs footprints, uint i) {
  const vec2 pair = pairAt(footprints, i);
  return Footprint(pair.x, pair.y);
}
// ranges: four floats per node
FootprintRange footprintRangeAt(FloatPairs ranges, uint node) {
  const vec2 logs = pairAt(ranges, 2 * node);
  return FootprintRange(logs.x, logs.y, pairAt(ranges, 2 * node + 1).x);
}

float squaredDistance(vec2 a, vec2 b) {
  precise const vec2 d = a - b;
  precise const float squared = d.x * d.x + d.y * d.y;
  return squared;
}

// Least squared distance between the boxes a and b. Every operation rounds monotonically, so it is never
// above squaredDistance() of a point in one and a point in the other.
float squaredDistanceOfBoxes(vec2 a_low, vec2 a_high, vec2 b_low, vec2 b_high) {
  precise const vec2 d = max(max(b_low - a_high, a_low - b_high), 0.0);
  precise const float squared = d.x * d.x + d.y * d.y;
  return squared;
}

// Squared distance in the metric: the squared one in (u, v) and the footprints' part.
float withPart(float squared, float part) {
  precise const float sum = squared + part;
  return sum;
}
