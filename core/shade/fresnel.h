// What smooth interfaces reflect.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/scene/math.h"

namespace encore {

// x within [low, high]; not a number becomes low.
inline float clampClean(float x, float low, float high) { return x > low ? std::min(x, high) : low; }
inline Vec3f clampClean(Vec3f c, float high) {
  return {clampClean(c.x, 0, high), clampClean(c.y, 0, high), clampClean(c.z, 0, high)};
}

// Fresnel reflectance of a dielectric for unpolarised light, exact. eta: far over near. 1 at total reflection.
inline float fresnelDielectric(float cos_theta, float eta) {
  if (eta == 1) return 0;
  const float c = clampClean(cos_theta, 0, 1);
  const float sin2_t = (1 - c * c) / (eta * eta);
  if (sin2_t >= 1) return 1;
  const float cos_t = std::sqrt(1 - sin2_t);
  const float s = (c - eta * cos_t) / (c + eta * cos_t), p = (eta * c - cos_t) / (eta * c + cos_t);
  return 0.5f * (s * s + p * p);
}

// Schlick's formula with f90 = 1.
inline Vec3f fresnelSchlick(float cos_theta, Vec3f f0) {
  const float m = 1 - clampClean(cos_theta, 0, 1), m2 = m * m;
  return f0 + (Vec3f{1, 1, 1} - f0) * (m2 * m2 * m);
}

// Cosine beyond the interface where eta < 1, 0 at total reflection; cos_theta itself otherwise.
inline float refractedCosine(float cos_theta, float eta) {
  if (eta >= 1) return cos_theta;
  return std::sqrt(std::max(0.0f, 1 - (1 - cos_theta * cos_theta) / (eta * eta)));
}

// Two parallel interfaces, each reflecting r and passing 1 - r, around a body that lets the share `clear` through
// at each pass: the sum of the geometric series of reflections within. Without interference, as sheets are thick
// against the wavelength. The rest, 1 - reflected - transmitted, stays in the body.
struct Sheet {
  float reflected, transmitted;
};
inline Sheet sheetOf(float r, float clear) {
  const float echo = 1 - r * r * clear * clear;
  if (!(echo > 1e-6f)) return {1, 0};
  const float passed = (1 - r) * (1 - r) * clear / echo;
  return {r + passed * r * clear, passed};
}

}  // namespace encore
