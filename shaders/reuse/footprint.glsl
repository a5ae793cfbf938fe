// The footprint's part of the metric of §2.4, c log2(ra / rb)² (ra² + rb²), exactly the same wherever it is computed:
// only operations that every device rounds alike. tests/core/twins/footprint_twin.h is its twin in C++.

// What the metric needs of a footprint r. Footprints are clamped to [2^-60, 2^60]; what is not a number counts as
// the lower end.
struct Footprint {
  float log2_radius;
  float squared_radius;
};

const float kLeastFootprint = 8.673617379884035e-19;   // 2^-60
const float kLargestFootprint = 1.152921504606847e18;  // 2^60
// No distance's part is larger, so that distances are finite whatever the footprints: 2^100.
const float kLargestPart = 1.2676506002282294e30;

// Comparisons on bits, because a compiler may assume that floats are numbers.
float clampedFootprint(float r) {
  const uint bits = floatBitsToUint(r);
  if (bits > 0x7f800000u) return kLeastFootprint;  // negative, or not a number
  return uintBitsToFloat(clamp(bits, floatBitsToUint(kLeastFootprint), floatBitsToUint(kLargestFootprint)));
}

// log2(x) for normal x > 0, within 6e-7 plus the rounding of the result: log2(1 + t) as t times a polynomial of t
// that is 1 at t = 1. (The log2() of GLSL differs between devices.)
float portableLog2(float x) {
  const uint bits = floatBitsToUint(x);
  const float t = uintBitsToFloat((bits & 0x007fffffu) | 0x3f800000u) - 1.0;
  precise float p = -0.012404507;
  p = p * t + 0.06397884;
  p = p * t - 0.155964002;
  p = p * t + 0.25649759;
  p = p * t - 0.353590608;
  p = p * t + 0.480100572;
  p = p * t - 0.721312642;
  p = p * t + 1.44269478;
  precise const float log2_x = p * t + float(int(bits >> 23) - 127);
  return log2_x;
}

Footprint footprintOf(float r) {
  const float clamped = clampedFootprint(r);
  precise const float squared = clamped * clamped;
  return Footprint(portableLog2(clamped), squared);
}

// Never falls when the difference or the sum grows.
float footprintPart(float log2_difference, float sum_of_squares, float weight) {
  precise const float part = (weight * (log2_difference * log2_difference)) * sum_of_squares;
  return min(part, kLargestPart);
}

float footprintPart(Footprint a, Footprint b, float weight) {
  precise const float difference = a.log2_radius - b.log2_radius;
  precise const float sum = a.squared_radius + b.squared_radius;
  return footprintPart(difference, sum, weight);
}

// Least values over a set of samples: log2_radius in [low, high], squared_radius at least `least`.
struct FootprintRange {
  float low;
  float high;
  float least;
};

// A bound: every operation rounds monotonically, so it is never above footprintPart() of a sample in the range.
float footprintBound(Footprint a, FootprintRange range, float weight) {
  precise const float difference = max(max(range.low - a.log2_radius, a.log2_radius - range.high), 0.0);
  precise const float sum = a.squared_radius + range.least;
  return footprintPart(difference, sum, weight);
}

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats {
  float at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Footprints {
  Footprint at[];
};
// low, high, least, and nothing
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer FootprintRanges {
  vec4 at[];
};
