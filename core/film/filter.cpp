// Reconstruction filters. The twin of shaders/film/filter.glsl, bit for bit: no library functions, and
// every addition and multiplication in the order written there.
#include <cmath>

#include "core/film/film.h"

namespace encore {
namespace {

// exp(-4.5 t²) - exp(-4.5), t in [0, 1]: three standard deviations, lowered to reach 0 at the radius.
float gaussianWeight(float t) {
  const float y = 0.28125f * (t * t);  // 4.5 t² / 16: a short series, then the 16th power
  float e = 1.0f - y * 0.16666667f;
  e = 1.0f - y * 0.2f * e;
  e = 1.0f - y * 0.25f * e;
  e = 1.0f - y * 0.33333334f * e;
  e = 1.0f - y * 0.5f * e;
  e = 1.0f - y * e;
  e = e * e;
  e = e * e;
  e = e * e;
  e = e * e;
  return std::max(e - 0.011108996f, 0.0f);
}

// Mitchell & Netravali 1988 with B = C = 1/3, over [0, 2].
float mitchellWeight(float t) {
  const float s = 2.0f * t;
  if (s < 1.0f) return (1.1666666f * s - 2.0f) * s * s + 0.8888889f;
  return ((-0.3888889f * s + 2.0f) * s - 3.3333333f) * s + 1.7777778f;
}

// The four-term window of Harris 1978 as a polynomial of cos(πt), which is a polynomial of t² fitted over
// Chebyshev nodes. Right to 1.1e-6.
float blackmanHarrisWeight(float t) {
  const float q = t * t;
  float c = 0.22965036f - q * 0.020577252f;
  c = q * c - 1.3323691f;
  c = q * c + 4.058041f;
  c = q * c - 4.9347453f;
  c = q * c + 0.9999992f;
  return 0.21747f + c * (0.45325f + c * (0.28256f + c * 0.04672f));
}

}  // namespace

float filterWeight(FilterKind kind, float radius, float x) {
  if (kind == FilterKind::Box) return x > -radius && x <= radius ? 1.0f : 0.0f;
  if (!(std::abs(x) < radius)) return 0.0f;
  const float t = std::abs(x) * (1.0f / radius);
  switch (kind) {
    case FilterKind::Gaussian:
      return gaussianWeight(t);
    case FilterKind::Mitchell:
      return mitchellWeight(t);
    default:
      return blackmanHarrisWeight(t);
  }
}

uint32_t filterPad(float radius) { return uint32_t(std::max(0.0f, std::ceil(radius - 0.5f))); }

}  // namespace encore
