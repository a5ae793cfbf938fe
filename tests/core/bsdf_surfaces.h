// Surfaces of bsdf_*_test.cpp, twins of rough interfaces, and what a white furnace makes of them.
#pragma once

#include <cmath>

#include "core/scene/random.h"
#include "core/shade/bsdf.h"

namespace encore {

inline constexpr double kPiD = 3.14159265358979323846;
inline constexpr Vec3f kUp{0, 0, 1};
inline constexpr float kLimit = 0.3f;

inline Vec3f viewAt(float cos_theta) { return {std::sqrt(1 - cos_theta * cos_theta), 0, cos_theta}; }

// A white dielectric; roughness decides whether its interface is traced.
struct Surface {
  Material material;
  Settings settings = [] {
    Settings s;
    s.roughness_limit = kLimit;
    return s;
  }();
  PathInputs inputs{{1, 1, 1}, {0, 0, 0}, 0, 0, 0, 0, 1, 1.5f, {0, 0, 1}};

  Surface& roughness(float r) { return set(material.roughness, inputs.roughness, r); }
  Surface& metallic(float m) { return set(material.metallic, inputs.metallic, m); }
  Surface& clearcoat(float c, float r) {
    set(material.clearcoat_roughness, inputs.clearcoat_roughness, r);
    return set(material.clearcoat, inputs.clearcoat, c);
  }
  Surface& opacity(float o) { return set(material.opacity, inputs.opacity, o); }
  Surface& ior(float i) { return set(material.ior, inputs.ior, i); }
  Surface& uncompensated() {
    settings.energy_compensation = false;
    return *this;
  }
  Surface& roughnessLimit(float limit) {
    settings.roughness_limit = limit;
    return *this;
  }
  Surface& specular(Vec3f f0) {
    material.use_specular_workflow = true;
    material.specular_color.value = inputs.specular_color = f0;
    return *this;
  }
  Surface& base(Vec3f c) {
    material.diffuse_color.value = inputs.base_color = c;
    return *this;
  }
  Lobes lobes(bool back = false) const { return lobes(InterfaceView{back, false, 1}); }
  Lobes lobes(const InterfaceView& view) const { return makeLobes(material, inputs, view, settings); }
  bool viewWeight() const { return viewWeightInShading(material, settings.roughness_limit, false); }

 private:
  Surface& set(Input<float>& input, float& value, float x) {
    input.value = value = x;
    return *this;
  }
};
inline Surface smooth() { return Surface().roughness(0); }

// Sobol points in three or four dimensions, padded from two.
struct Points {
  float u[4];
  Points(uint32_t i, uint32_t seed) {
    const Vec2f a = sobol2(i, seed), b = sobol2(i, seed + 1000);
    u[0] = a.x, u[1] = a.y, u[2] = b.x, u[3] = b.y;
  }
};

// Twin of the rough interface in double: textbook formulas (Walter et al. 2007; Heitz 2014).
inline double twinLambda(double z, double alpha) {
  const double tan2 = (1 - z * z) / (z * z);
  return 0.5 * (std::sqrt(1 + alpha * alpha * tan2) - 1);
}
// f · cos for F = 1.
inline double twinReflection(const Vec3d& wo, const Vec3d& wi, double alpha) {
  const Vec3d h = normalize(wo + wi);
  const double c2 = h.z * h.z, k = c2 * (alpha * alpha - 1) + 1;
  const double d = alpha * alpha / (kPiD * k * k);
  const double g2 = 1 / (1 + twinLambda(wo.z, alpha) + twinLambda(wi.z, alpha));
  return d * g2 / (4 * wo.z);
}
inline double twinFresnel(double c, double n) {
  const double s2 = (1 - c * c) / (n * n);
  if (s2 >= 1) return 1;
  const double t = std::sqrt(1 - s2);
  const double rs = (c - n * t) / (c + n * t), rp = (t - n * c) / (t + n * c);
  return 0.5 * (rs * rs + rp * rp);
}

// Integral over the upper hemisphere of f(wi), which is even in phi: midpoints in polar angles.
template <class F>
double integrateHemisphere(F f, int rings = 400, int angles = 400) {
  double sum = 0;
  for (int r = 0; r < rings; ++r) {
    const double theta = 0.5 * kPiD * (r + 0.5) / rings, s = std::sin(theta);
    for (int a = 0; a < angles; ++a) {
      const double phi = kPiD * (a + 0.5) / angles;
      sum += f(Vec3d{s * std::cos(phi), s * std::sin(phi), std::cos(theta)}) * s;
    }
  }
  return sum * kPiD * kPiD / (double(rings) * angles);
}

inline Vec3f meanReflection(const Lobes& lobes, Vec3f wo, uint32_t count) {
  Vec3d sum;
  for (uint32_t i = 0; i < count; ++i) {
    const Bounce b = sampleReflection(lobes, kUp, wo, Points(i, 1).u);
    if (b.valid) sum += toDouble(b.weight);
  }
  return toFloat(sum / double(count));
}
inline Vec3f meanRefraction(const Lobes& lobes, Vec3f wo, uint32_t count) {
  Vec3d sum;
  for (uint32_t i = 0; i < count; ++i) {
    const Bounce b = sampleRefraction(lobes, kUp, wo, Points(i, 2).u);
    if (b.valid) sum += toDouble(b.weight);
  }
  return toFloat(sum / double(count));
}
// Albedo of the evaluated rough lobes, by their own sampling.
inline Vec3f meanShadedSpecular(const Lobes& lobes, Vec3f wo, uint32_t count) {
  const ShadedView view(lobes, {1, 1, 1}, kUp, wo, true);
  Vec3d sum;
  for (uint32_t i = 0; i < count && view.hasRoughLobe(); ++i) {
    const Vec3f wi = view.sampleRoughLobe(Points(i, 3).u);
    const float pdf = view.pdfRoughLobe(wi);
    if (pdf > 0) sum += toDouble(view.evaluate(wi, false).specular / pdf);
  }
  return toFloat(sum / double(count));
}
// Everything that leaves towards wo in a white furnace.
inline Vec3f furnace(const Surface& surface, const InterfaceView& view, Vec3f wo, uint32_t count) {
  const Lobes lobes = surface.lobes(view);
  const EffectWeights weights = effectWeights(lobes, wo.z, surface.viewWeight());
  const Vec3f diffuse = ShadedView(lobes, {1, 1, 1}, kUp, wo, surface.viewWeight()).diffuse();
  return meanReflection(lobes, wo, count) + meanRefraction(lobes, wo, count) + meanShadedSpecular(lobes, wo, count) +
         diffuse * weights.absorption;
}

}  // namespace encore
