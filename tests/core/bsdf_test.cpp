// Lobes of UsdPreviewSurface against closed forms, quadrature and an independent twin of GGX.
#include "core/shade/bsdf.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "core/scene/random.h"
#include "core/shade/interface_albedo.h"

namespace encore {
namespace {

constexpr double kPiD = 3.14159265358979323846;
constexpr Vec3f kUp{0, 0, 1};
constexpr float kLimit = 0.3f;

Vec3f viewAt(float cos_theta) { return {std::sqrt(1 - cos_theta * cos_theta), 0, cos_theta}; }

// A white dielectric; roughness decides whether its interface is traced.
struct Surface {
  Material material;
  PathInputs inputs{{1, 1, 1}, {0, 0, 0}, 0, 0, 0, 0, 1, 1.5f};

  Surface& roughness(float r) { return set(material.roughness, inputs.roughness, r); }
  Surface& metallic(float m) { return set(material.metallic, inputs.metallic, m); }
  Surface& clearcoat(float c, float r) {
    set(material.clearcoat_roughness, inputs.clearcoat_roughness, r);
    return set(material.clearcoat, inputs.clearcoat, c);
  }
  Surface& opacity(float o) { return set(material.opacity, inputs.opacity, o); }
  Surface& ior(float i) { return set(material.ior, inputs.ior, i); }
  Surface& specular(Vec3f f0) {
    material.use_specular_workflow = true;
    material.specular_color.value = inputs.specular_color = f0;
    return *this;
  }
  Surface& base(Vec3f c) {
    material.diffuse_color.value = inputs.base_color = c;
    return *this;
  }
  Lobes lobes(bool back = false) const { return makeLobes(material, inputs, back, kLimit); }
  bool viewWeight() const { return viewWeightInShading(material, kLimit, false); }

 private:
  Surface& set(Input<float>& input, float& value, float x) {
    input.value = value = x;
    return *this;
  }
};
Surface smooth() { return Surface().roughness(0); }

// Sobol points in three or four dimensions, padded from two.
struct Points {
  float u[4];
  Points(uint32_t i, uint32_t seed) {
    const Vec2f a = sobol2(i, seed), b = sobol2(i, seed + 1000);
    u[0] = a.x, u[1] = a.y, u[2] = b.x, u[3] = b.y;
  }
};

// Twin of the rough interface in double: textbook formulas (Walter et al. 2007; Heitz 2014).
double twinLambda(double z, double alpha) {
  const double tan2 = (1 - z * z) / (z * z);
  return 0.5 * (std::sqrt(1 + alpha * alpha * tan2) - 1);
}
// f · cos for F = 1.
double twinReflection(const Vec3d& wo, const Vec3d& wi, double alpha) {
  const Vec3d h = normalize(wo + wi);
  const double c2 = h.z * h.z, k = c2 * (alpha * alpha - 1) + 1;
  const double d = alpha * alpha / (kPiD * k * k);
  const double g2 = 1 / (1 + twinLambda(wo.z, alpha) + twinLambda(wi.z, alpha));
  return d * g2 / (4 * wo.z);
}
double twinFresnel(double c, double n) {
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

Vec3f meanReflection(const Lobes& lobes, Vec3f wo, uint32_t count) {
  Vec3d sum;
  for (uint32_t i = 0; i < count; ++i) {
    const Bounce b = sampleReflection(lobes, kUp, wo, Points(i, 1).u);
    if (b.valid) sum += toDouble(b.weight);
  }
  return toFloat(sum / double(count));
}
Vec3f meanRefraction(const Lobes& lobes, Vec3f wo, uint32_t count) {
  Vec3d sum;
  for (uint32_t i = 0; i < count; ++i) {
    const Bounce b = sampleRefraction(lobes, kUp, wo, Points(i, 2).u);
    if (b.valid) sum += toDouble(b.weight);
  }
  return toFloat(sum / double(count));
}
// Albedo of the evaluated rough lobes, by their own sampling.
Vec3f meanShadedSpecular(const Lobes& lobes, Vec3f wo, uint32_t count) {
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
Vec3f furnace(const Surface& surface, bool back, Vec3f wo, uint32_t count) {
  const Lobes lobes = surface.lobes(back);
  const EffectWeights weights = effectWeights(lobes, wo.z, surface.viewWeight());
  const Vec3f diffuse = ShadedView(lobes, {1, 1, 1}, kUp, wo, surface.viewWeight()).diffuse();
  return meanReflection(lobes, wo, count) + meanRefraction(lobes, wo, count) + meanShadedSpecular(lobes, wo, count) +
         diffuse * weights.absorption;
}

TEST(Fresnel, KnownValues) {
  EXPECT_NEAR(fresnelDielectric(1, 1.5f), 0.04f, 1e-6);
  EXPECT_NEAR(fresnelDielectric(1, 1 / 1.5f), 0.04f, 1e-6);
  EXPECT_NEAR(fresnelDielectric(1, 2.5f), std::pow(1.5 / 3.5, 2), 1e-6);
  EXPECT_EQ(fresnelDielectric(0, 1.5f), 1);  // grazing
  EXPECT_EQ(fresnelDielectric(0.3f, 1), 0);  // no interface
  // Brewster's angle, tan = n: only s-polarised light reflects, ((n² - 1) / (n² + 1))² of it.
  const float n = 1.5f, brewster = std::cos(std::atan(n));
  EXPECT_NEAR(fresnelDielectric(brewster, n), 0.5 * std::pow((n * n - 1) / (n * n + 1), 2), 1e-6);
  // Total reflection from 41.8 degrees on, from the denser side.
  const float critical = std::sqrt(1 - 1 / (n * n));
  EXPECT_EQ(fresnelDielectric(critical - 1e-3f, 1 / n), 1);
  EXPECT_LT(fresnelDielectric(critical + 1e-3f, 1 / n), 1);
  // Both sides of one ray reflect alike (Stokes).
  for (float c : {0.2f, 0.5f, 0.9f}) {
    const float inside = std::sqrt(1 - (1 - c * c) / (n * n));
    EXPECT_NEAR(fresnelDielectric(c, n), fresnelDielectric(inside, 1 / n), 1e-5);
    EXPECT_NEAR(fresnelDielectric(c, n), twinFresnel(c, n), 1e-6);
    EXPECT_NEAR(refractedCosine(inside, 1 / n), c, 1e-5);
  }
  EXPECT_EQ(fresnelSchlick(1, {0.1f, 0.5f, 1}), (Vec3f{0.1f, 0.5f, 1}));
  EXPECT_NEAR(fresnelSchlick(0, {0.1f, 0.5f, 1}).x, 1, 1e-6);
}

TEST(Lobes, FollowUsdPreviewSurface) {
  const Lobes metal = Surface().metallic(1).base({0.9f, 0.5f, 0.1f}).roughness(0).lobes();
  EXPECT_EQ(metal.f0, (Vec3f{0.9f, 0.5f, 0.1f}));
  const EffectWeights m = effectWeights(metal, 1, false);
  EXPECT_NEAR(m.reflection.y, 0.5f, 1e-6);
  EXPECT_EQ(m.absorption, (Vec3f{}));
  EXPECT_EQ(m.refraction, (Vec3f{}));

  // The specular workflow ignores metallic.
  const Lobes specular = smooth().metallic(1).specular({0.2f, 0.3f, 0.4f}).lobes();
  const EffectWeights s = effectWeights(specular, 1, false);
  EXPECT_NEAR(s.reflection.y, 0.3f, 1e-6);
  EXPECT_NEAR(s.absorption.y, 0.7f, 1e-6);

  // Half transparent glass: what passes the interface is shared between diffuse and refraction.
  const EffectWeights g = effectWeights(smooth().opacity(0.25f).lobes(), 1, false);
  EXPECT_NEAR(g.reflection.x, 0.04f, 1e-6);
  EXPECT_NEAR(g.refraction.x, 0.96f * 0.75f, 1e-6);
  EXPECT_NEAR(g.absorption.x, 0.96f * 0.25f, 1e-6);

  // A clearcoat takes its share first; it is not there from the inside of a solid.
  Surface coated = smooth().clearcoat(0.5f, 0).opacity(0);
  EXPECT_NEAR(effectWeights(coated.lobes(), 1, false).reflection.x, 0.02f + 0.98f * 0.04f, 1e-6);
  EXPECT_NEAR(effectWeights(coated.lobes(true), 1, false).reflection.x, 0.04f, 1e-6);

  // Only what can refract has an inside.
  EXPECT_EQ(smooth().lobes(true).eta, 1.5f);
  EXPECT_EQ(smooth().opacity(0).lobes(true).eta, 1 / 1.5f);
  Surface cutout = smooth().opacity(0.5f);
  cutout.material.opacity_threshold = 0.3f;
  EXPECT_EQ(cutout.lobes(true).opacity, 1);
}

TEST(Lobes, LayersThatExist) {
  EXPECT_TRUE(feedsReflection(smooth().material, kLimit));
  EXPECT_FALSE(feedsReflection(Surface().roughness(0.5f).material, kLimit));
  EXPECT_TRUE(feedsReflection(Surface().roughness(0.5f).clearcoat(1, 0).material, kLimit));
  EXPECT_FALSE(feedsReflection(smooth().ior(1).material, kLimit));
  EXPECT_TRUE(feedsReflection(smooth().ior(1).metallic(0.1f).material, kLimit));
  Surface varying = smooth();
  varying.material.roughness.node = 0;  // its largest value may be 1
  EXPECT_FALSE(feedsReflection(varying.material, kLimit));
  EXPECT_TRUE(feedsReflection(varying.material, 1));
  EXPECT_FALSE(varying.lobes().specular_traced);

  EXPECT_FALSE(feedsRefraction(smooth().material));
  EXPECT_TRUE(feedsRefraction(smooth().opacity(0.9f).material));
  EXPECT_FALSE(feedsRefraction(smooth().opacity(0.9f).metallic(1).material));
  Surface cutout = smooth().opacity(0.5f);
  cutout.material.opacity_threshold = 0.3f;
  EXPECT_FALSE(feedsRefraction(cutout.material));
}

TEST(Lobes, WhereViewWeightsAreApplied) {
  EXPECT_FALSE(viewWeightInShading(smooth().material, kLimit, true));
  EXPECT_FALSE(viewWeightInShading(Surface().roughness(0.2f).material, kLimit, false));
  EXPECT_TRUE(viewWeightInShading(Surface().roughness(0.2f).material, kLimit, true));
  EXPECT_TRUE(viewWeightInShading(Surface().roughness(0.5f).material, kLimit, false));
  EXPECT_FALSE(viewWeightInShading(Surface().roughness(0.5f).ior(1).material, kLimit, true));
  EXPECT_TRUE(viewWeightInShading(smooth().clearcoat(1, 0.5f).material, kLimit, false));
  Surface emits = smooth();
  emits.material.emissive_color.value = {0, 0, 1};
  EXPECT_TRUE(emits.viewWeight());
  // Diffuse is weighted once, in either place.
  for (float cos_theta : {0.1f, 0.5f, 1.0f}) {
    const Lobes lobes = smooth().lobes();
    const Vec3f wo = viewAt(cos_theta), wi = viewAt(0.7f);
    const Vec3f outside = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, false, false).diffuse *
                          effectWeights(lobes, cos_theta, false).absorption;
    const Vec3f inside = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).diffuse;
    EXPECT_NEAR(outside.x, inside.x, 1e-6);
    EXPECT_NEAR(inside.x, (1 - fresnelDielectric(cos_theta, 1.5f)) * 0.7f * kInvPi, 1e-6);
    EXPECT_EQ(effectWeights(lobes, cos_theta, true).absorption, (Vec3f{1, 1, 1}));
  }
}

TEST(Bounce, SmoothReflectionAndSnell) {
  const Vec3f n = normalize(Vec3f{0.3f, -0.5f, 0.8f});
  const Vec3f wo = normalize(n + Vec3f{0.4f, 0.3f, 0.1f});
  const Lobes glass = smooth().opacity(0).lobes();
  const Points u(3, 7);
  const Bounce r = sampleReflection(glass, n, wo, u.u), t = sampleRefraction(glass, n, wo, u.u);
  ASSERT_TRUE(r.valid && t.valid);
  EXPECT_NEAR(dot(r.direction, n), dot(wo, n), 1e-6);
  EXPECT_NEAR(length(r.direction + wo - n * (2 * dot(wo, n))), 0, 1e-6);
  EXPECT_EQ(r.half_vector, n);
  // Snell: tangential parts differ by the factor ior and lie in one line.
  const Vec3f tangent_o = wo - n * dot(wo, n), tangent_t = t.direction - n * dot(t.direction, n);
  EXPECT_NEAR(length(tangent_t * 1.5f + tangent_o), 0, 1e-6);
  EXPECT_LT(dot(t.direction, n), 0);
  const float fresnel = fresnelDielectric(dot(wo, n), 1.5f);
  EXPECT_NEAR(r.weight.x, fresnel, 1e-6);
  EXPECT_NEAR(t.weight.x, 1 - fresnel, 1e-6);
}

TEST(Bounce, SlabKeepsDirection) {
  // Normals of a slab's two sides as a path sees them: towards where the ray comes from.
  const Lobes enter = smooth().opacity(0).lobes(), leave = smooth().opacity(0).lobes(true);
  const Vec3f n{0, 0, 1}, wo = viewAt(0.4f);
  const Points u(0, 0);
  const Bounce in = sampleRefraction(enter, n, wo, u.u);
  const Bounce out = sampleRefraction(leave, n, -in.direction, u.u);
  ASSERT_TRUE(in.valid && out.valid);
  EXPECT_NEAR(length(out.direction + wo), 0, 1e-6);
  EXPECT_NEAR(out.weight.x, in.weight.x, 1e-6);
}

TEST(Bounce, TotalReflection) {
  const Lobes inside = smooth().opacity(0).lobes(true);
  const Points u(0, 0);
  const Vec3f wo = viewAt(0.5f);  // 60 degrees
  EXPECT_FALSE(sampleRefraction(inside, kUp, wo, u.u).valid);
  EXPECT_EQ(sampleReflection(inside, kUp, wo, u.u).weight, (Vec3f{1, 1, 1}));
  const EffectWeights weights = effectWeights(inside, 0.5f, false);
  EXPECT_EQ(weights.reflection, (Vec3f{1, 1, 1}));
  EXPECT_EQ(weights.refraction, (Vec3f{}));
}

TEST(Bounce, NoChangeOfIndexGoesStraight) {
  for (float roughness : {0.0f, 0.2f}) {
    const Lobes air = Surface().roughness(roughness).opacity(0).ior(1).lobes();
    const Bounce b = sampleRefraction(air, kUp, viewAt(0.3f), Points(5, 5).u);
    ASSERT_TRUE(b.valid);
    EXPECT_EQ(b.direction, -viewAt(0.3f));
    EXPECT_NEAR(b.weight.x, 1, 1e-6);
    EXPECT_FALSE(sampleReflection(air, kUp, viewAt(0.3f), Points(5, 5).u).valid);
  }
}

TEST(Bounce, RoughWeightsIntegrateToAlbedo) {
  for (float roughness : {0.15f, 0.3f}) {
    for (float cos_theta : {0.2f, 0.6f, 1.0f}) {
      const double alpha = double(roughness) * roughness;
      const Vec3d wo = toDouble(viewAt(cos_theta));
      const double albedo = integrateHemisphere(
          [&](Vec3d wi) { return twinReflection(wo, wi, alpha) * twinFresnel(dot(wo, normalize(wo + wi)), 1.5); }, 1500,
          1500);
      const Lobes lobes = Surface().roughness(roughness).lobes();
      ASSERT_TRUE(lobes.specular_traced);
      EXPECT_NEAR(meanReflection(lobes, viewAt(cos_theta), 1 << 14).x / albedo, 1, 4e-3)
          << roughness << ' ' << cos_theta;
    }
  }
}

TEST(Bounce, RoughRefractionObeysSnellAtTheMicrofacet) {
  for (bool back : {false, true}) {
    const Lobes lobes = Surface().roughness(0.6f).opacity(0).lobes(back);
    const Vec3f wo = viewAt(0.8f);
    int valid = 0;
    for (uint32_t i = 0; i < 500; ++i) {
      const Bounce b = sampleRefraction(lobes, kUp, wo, Points(i, 9).u);
      if (!b.valid) continue;
      ++valid;
      EXPECT_NEAR(length(cross(b.direction, b.half_vector)) * lobes.eta, length(cross(wo, b.half_vector)), 1e-5);
      EXPECT_NEAR(dot(cross(b.direction, b.half_vector), wo), 0, 1e-5);
      EXPECT_LT(b.direction.z, 0);
      EXPECT_LE(b.weight.x, 1);
    }
    EXPECT_GT(valid, 300);
  }
}

TEST(Albedo, TablesMatchQuadrature) {
  for (float alpha : {0.01f, 0.09f, 0.25f, 0.49f, 1.0f}) {
    for (float cos_theta : {0.03f, 0.1f, 0.35f, 0.72f, 0.97f}) {
      for (float ior : {1.05f, 1.33f, 1.5f, 2.4f, 8.0f}) {
        Lobes lobes;
        lobes.alpha = alpha, lobes.eta = ior;
        const float sampled = meanReflection(lobes, viewAt(cos_theta), 1 << 11).x;
        EXPECT_NEAR(dielectricAlbedo(cos_theta, alpha, ior), sampled, 3e-3) << alpha << ' ' << cos_theta << ' ' << ior;
        lobes.eta = 1 / ior;
        EXPECT_GE(dielectricAlbedo(cos_theta, alpha, 1 / ior),
                  meanReflection(lobes, viewAt(cos_theta), 1 << 11).x - 1e-3);
      }
      Lobes lobes;
      lobes.alpha = alpha, lobes.schlick = 1, lobes.f0 = {0.04f, 0.5f, 1};
      const Vec3f sampled = meanReflection(lobes, viewAt(cos_theta), 1 << 11);
      const Vec3f table = schlickAlbedo(cos_theta, alpha, lobes.f0, 1);
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(table[k], sampled[k], 3e-3) << alpha << ' ' << cos_theta;
    }
  }
}

TEST(Energy, NeverGrows) {
  for (float roughness : {0.0f, 0.1f, 0.3f, 0.31f, 0.5f, 1.0f})
    for (float ior : {1.0f, 1.2f, 1.5f, 5.0f})
      for (float metallic : {0.0f, 0.5f, 1.0f})
        for (float opacity : {1.0f, 0.3f})
          for (bool back : {false, true})
            for (float cos_theta : {0.02f, 0.15f, 0.5f, 0.75f, 1.0f}) {
              const Surface surface = Surface().roughness(roughness).ior(ior).metallic(metallic).opacity(opacity);
              const Vec3f sum = furnace(surface, back, viewAt(cos_theta), 1024);
              EXPECT_LE(sum.x, 1 + 1e-3) << "roughness " << roughness << " ior " << ior << " metallic " << metallic
                                         << " opacity " << opacity << " back " << back << " cos " << cos_theta;
            }
}

TEST(Energy, NeverGrowsUnderClearcoatAndInTheSpecularWorkflow) {
  for (float roughness : {0.0f, 0.2f, 0.5f, 1.0f})
    for (float coat_roughness : {0.0f, 0.2f, 0.6f})
      for (float cos_theta : {0.05f, 0.5f, 1.0f})
        for (float f0 : {0.0f, 1.0f})
          for (int body = 0; body < 3; ++body) {  // opaque; half transparent from outside, from inside
            const float opacity = body == 0 ? 1 : 0.3f;
            const Surface surface =
                Surface().roughness(roughness).specular({f0, f0, f0}).clearcoat(1, coat_roughness).opacity(opacity);
            const Vec3f sum = furnace(surface, body == 2, viewAt(cos_theta), 1 << 13);
            EXPECT_LE(sum.x, 1 + 1e-3) << "roughness " << roughness << " coat " << coat_roughness << " f0 " << f0
                                       << " body " << body << " cos " << cos_theta;
          }
}

TEST(Energy, WhiteDielectricsStayWhite) {
  // Smooth: exactly. Rough over diffuse: what microfacets lose goes to the diffuse lobe.
  for (float cos_theta : {0.05f, 0.5f, 1.0f}) {
    for (bool back : {false, true})
      EXPECT_NEAR(furnace(smooth().opacity(0), back, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
    EXPECT_NEAR(furnace(smooth().opacity(0.4f), true, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
    EXPECT_NEAR(furnace(smooth().clearcoat(0.7f, 0), false, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
    for (float roughness : {0.2f, 0.5f, 1.0f})
      EXPECT_NEAR(furnace(Surface().roughness(roughness), false, viewAt(cos_theta), 1 << 12).x, 1, 3e-3) << roughness;
  }
}

TEST(Shaded, MatchesTwinAndIsReciprocal) {
  const Lobes lobes = Surface().roughness(0.6f).lobes();
  ASSERT_FALSE(lobes.specular_traced);
  for (uint32_t k = 0; k < 200; ++k) {
    const Vec2f a = sobol2(k, 11), b = sobol2(k, 12);
    const auto direction = [](Vec2f u) {
      const float z = 0.02f + 0.98f * u.x, s = std::sqrt(1 - z * z);
      return Vec3f{s * std::cos(2 * kPi * u.y), s * std::sin(2 * kPi * u.y), z};
    };
    const Vec3f wo = direction(a), wi = direction(b);
    const float there = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).specular.x / wi.z;
    const float back = evaluateShaded(lobes, {1, 1, 1}, kUp, wi, wo, true, false).specular.x / wo.z;
    EXPECT_NEAR(there / back, 1, 1e-4);
    const Vec3d o = toDouble(wo), i = toDouble(wi);
    const double twin = twinReflection(o, i, double(lobes.alpha)) * twinFresnel(dot(o, normalize(o + i)), 1.5);
    EXPECT_NEAR(there * wi.z / twin, 1, 1e-4);
  }
  EXPECT_EQ(evaluateShaded(lobes, {1, 1, 1}, kUp, kUp, {0, 0.6f, -0.8f}, true, true).specular, (Vec3f{}));
  EXPECT_EQ(evaluateShaded(lobes, {1, 1, 1}, kUp, kUp, {0, 0.6f, -0.8f}, true, true).diffuse, (Vec3f{}));
}

TEST(Shaded, TracedLobesOnlyOnRequest) {
  const Lobes lobes = Surface().roughness(0.2f).clearcoat(1, 0.2f).lobes();
  const Vec3f wo = viewAt(0.8f), wi{-wo.x, 0, wo.z};
  EXPECT_FALSE(hasRoughLobe(lobes));
  EXPECT_EQ(pdfRoughLobe(lobes, kUp, wo, wi), 0);
  EXPECT_EQ(evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).specular, (Vec3f{}));
  const float both = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, true).specular.x;
  const float coat_only =
      evaluateShaded(Surface().roughness(0).clearcoat(1, 0.2f).lobes(), {1, 1, 1}, kUp, wo, wi, true, true).specular.x;
  EXPECT_GT(coat_only, 1);  // the peak of a narrow lobe
  EXPECT_GT(both, 1.5f * coat_only);
}

// The density integrates to the share of samples that leave upwards, and histograms agree with it.
TEST(Shaded, RoughLobeSamplingMatchesItsDensity) {
  const Surface surfaces[] = {Surface().roughness(0.5f), Surface().roughness(1),
                              Surface().roughness(0.7f).clearcoat(1, 0.4f)};
  for (const Surface& surface : surfaces) {
    const Lobes lobes = surface.lobes();
    for (float cos_theta : {0.15f, 0.9f}) {
      const Vec3f wo = viewAt(cos_theta);
      constexpr int kRings = 8, kSectors = 8;
      constexpr uint32_t kSamples = 1 << 15;
      std::vector<double> expected(kRings * kSectors), counted(kRings * kSectors);
      constexpr int kFine = 60;
      for (int r = 0; r < kRings * kFine; ++r)
        for (int s = 0; s < kSectors * kFine; ++s) {
          const double z = (r + 0.5) / (kRings * kFine), phi = 2 * kPiD * (s + 0.5) / (kSectors * kFine);
          const double sine = std::sqrt(1 - z * z);
          const Vec3f wi{float(sine * std::cos(phi)), float(sine * std::sin(phi)), float(z)};
          expected[size_t(r / kFine * kSectors + s / kFine)] +=
              double(pdfRoughLobe(lobes, kUp, wo, wi)) * 2 * kPiD / (kRings * kFine * kSectors * kFine);
        }
      uint32_t below = 0;
      for (uint32_t i = 0; i < kSamples; ++i) {
        const auto h = pcg4d(i, 1, 2, 3);
        const float u[3] = {toUnit(h[0]), toUnit(h[1]), toUnit(h[2])};
        const Vec3f wi = sampleRoughLobe(lobes, kUp, wo, u);
        if (wi == Vec3f{}) {
          ++below;
          continue;
        }
        const double phi = std::atan2(double(wi.y), double(wi.x)) + (wi.y < 0 ? 2 * kPiD : 0);
        const int ring = std::min(int(wi.z * kRings), kRings - 1);
        const int sector = std::min(int(phi / (2 * kPiD) * kSectors), kSectors - 1);
        counted[size_t(ring * kSectors + sector)] += 1;
      }
      double total = double(below) / kSamples, chi2 = 0;
      int cells = 0;
      for (size_t k = 0; k < expected.size(); ++k) {
        total += expected[k];
        const double n = expected[k] * kSamples;
        if (n < 10) continue;
        chi2 += (counted[k] - n) * (counted[k] - n) / n;
        ++cells;
      }
      EXPECT_NEAR(total, 1, 0.01) << cos_theta;
      // 64 cells: mean cells, deviation sqrt(2 cells); five deviations.
      EXPECT_LT(chi2, cells + 5 * std::sqrt(2.0 * cells)) << cos_theta;
    }
  }
}

TEST(Lobes, BadNumbersStayFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  for (float bad : {nan, inf, -inf, -1.0f, 1e30f}) {
    Surface surface = Surface().roughness(0.5f);
    surface.material.opacity.node = surface.material.ior.node = 0;
    surface.inputs = {{bad, bad, bad}, {bad, bad, bad}, bad, bad, bad, bad, bad, bad};
    for (bool specular : {false, true})
      for (bool back : {false, true}) {
        surface.material.use_specular_workflow = specular;
        const Lobes lobes = surface.lobes(back);
        const EffectWeights weights = effectWeights(lobes, nan, false);
        EXPECT_LE(maxComponent(weights.reflection + weights.refraction + weights.absorption), 1.001f);
        const Points u(1, 1);
        EXPECT_TRUE(isFinite(sampleReflection(lobes, kUp, viewAt(0.5f), u.u).weight));
        EXPECT_TRUE(isFinite(sampleRefraction(lobes, kUp, viewAt(0.5f), u.u).weight));
        const ShadedResponse r = evaluateShaded(lobes, {bad, bad, bad}, kUp, viewAt(0.5f), kUp, true, true);
        EXPECT_TRUE(isFinite(r.diffuse) && isFinite(r.specular));
      }
  }
}

}  // namespace
}  // namespace encore
