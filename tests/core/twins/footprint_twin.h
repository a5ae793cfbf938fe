// The metric of §2.4 as shaders/reuse/footprint.glsl computes it, operation by operation.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace encore::twin {

inline float clampedFootprint(float r) {
  return std::isnan(r) || std::signbit(r) ? 0x1p-60f : std::clamp(r, 0x1p-60f, 0x1p60f);
}

inline float portableLog2(float x) {
  const uint32_t bits = std::bit_cast<uint32_t>(x);
  const float t = std::bit_cast<float>((bits & 0x007fffffu) | 0x3f800000u) - 1.0f;
  const float coefficients[] = {-0.012404507f, 0.06397884f,  -0.155964002f, 0.25649759f,
                                -0.353590608f, 0.480100572f, -0.721312642f, 1.44269478f};
  float p = 0;
  for (const float c : coefficients) p = p * t + c;
  return p * t + float(int(bits >> 23) - 127);
}

inline float footprintPart(float ra, float rb, float weight) {
  const float a = clampedFootprint(ra), b = clampedFootprint(rb);
  const float difference = portableLog2(a) - portableLog2(b);
  const float part = (weight * (difference * difference)) * (a * a + b * b);
  return std::min(part, 0x1p100f);
}

}  // namespace encore::twin
