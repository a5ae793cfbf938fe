// What both nearest-neighbour kernels share. A sample's neighbour is the shading sample of its primitive at the
// least distance in (u, v), the lowest id of several: every order of search gives the same one, as long as
// distances are computed by the same expression.

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats {
  float at[];
};
// Two floats in one load: on CPU devices a load by address costs the same for 32 and 64 bits.
layout(buffer_reference, scalar, buffer_reference_align = 8) buffer FloatPairs {
  uint64_t at[];
};

// Squared; farther than any two points of the unit square.
const float kFar = 3.0;
// Left by the grouped kernel to the single one.
const uint kShadePending = 0xfffffffdu;

vec2 pairAt(FloatPairs pairs, uint i) { return uintBitsToFloat(unpackUint2x32(pairs.at[i])); }

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
