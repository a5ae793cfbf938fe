// The GGX distribution of microfacet normals with Smith's height-correlated masking and shadowing.
// All vectors are unit and local: z is the shading normal. Sources: Walter et al., EGSR 2007 (distribution);
// Heitz, JCGT 2014 (masking, shadowing); Heitz, JCGT 2018, and Dupuy & Benyoub, HPG 2023 (sampling of
// visible normals by spherical caps).
#pragma once

#include <algorithm>
#include <cmath>

#include "core/scene/math.h"

namespace encore {

// Lobes narrower than this are smooth: a mirror, alpha = 0.
inline constexpr float kSmoothAlpha = 1e-4f;
// View and light cosines below it are treated as it: the lobes' formulas divide by them.
inline constexpr float kMinCosine = 1e-4f;

// Density of normals per solid angle, times their cosine integrates to 1.
inline float ggxDensity(Vec3f h, float alpha) {
  const float a2 = alpha * alpha;
  const float k = (h.x * h.x + h.y * h.y) / a2 + h.z * h.z;
  return kInvPi / (a2 * k * k);
}

// sqrt(z² + alpha² (1 - z²)): Smith's functions of a direction with cosine z are written with it.
inline float smithRoot(float z, float alpha) { return std::sqrt(z * z + alpha * alpha * std::max(0.0f, 1 - z * z)); }

// Masking of one direction, G1 = 1 / (1 + Λ). z > 0.
inline float smithG1(float z, float alpha) { return 2 * z / (z + smithRoot(z, alpha)); }

// Share of the light that meets visible microfacets under zo and also leaves under zi: G2 / G1(zo).
// Transmission uses it with |zi|: heights on the two sides are taken to be correlated as in reflection,
// which loses less energy than independent heights do.
inline float smithG2OverG1(float zo, float zi, float alpha) {
  const float o = smithRoot(zo, alpha), i = smithRoot(zi, alpha);
  return zi * (zo + o) / (zo * i + zi * o);
}

// D · G2 / (4 zo): what a reflecting lobe is for F = 1, the light's cosine included. zo, zi > 0.
inline float ggxReflection(Vec3f h, float zo, float zi, float alpha) {
  return ggxDensity(h, alpha) * 0.5f * zi / (zo * smithRoot(zi, alpha) + zi * smithRoot(zo, alpha));
}

// Density per solid angle with which reflection about sampleVisibleNormal() chooses wi.
inline float ggxReflectionPdf(Vec3f h, float zo, float alpha) {
  return ggxDensity(h, alpha) * 0.5f / (zo + smithRoot(zo, alpha));
}

// A microfacet normal with the density in which they are seen from wo (wo.z > 0). u in [0, 1)².
inline Vec3f sampleVisibleNormal(Vec3f wo, float alpha, float u0, float u1) {
  const Vec3f o = normalize(Vec3f{alpha * wo.x, alpha * wo.y, wo.z});
  const float phi = 2 * kPi * u0;
  const float z = (1 - u1) * (1 + o.z) - o.z;
  const float r = std::sqrt(std::clamp(1 - z * z, 0.0f, 1.0f));
  const Vec3f h = Vec3f{r * std::cos(phi), r * std::sin(phi), z} + o;
  return normalize(Vec3f{alpha * h.x, alpha * h.y, std::max(h.z, 1e-12f)});
}

// wo mirrored about h.
inline Vec3f reflectAbout(Vec3f wo, Vec3f h) { return h * (2 * dot(wo, h)) - wo; }

}  // namespace encore
