// Sampling of every lobe: chi-squared against twin densities in double, weights against twin values, reciprocity.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "bsdf_surfaces.h"
#include "core/shade/interface_shares.h"

namespace encore {
namespace {

double twinG1(double z, double alpha) { return 1 / (1 + twinLambda(z, alpha)); }
double twinDensity(Vec3d h, double alpha) {
  const double k = h.z * h.z * (alpha * alpha - 1) + 1;
  return alpha * alpha / (kPiD * k * k);
}
// Of visible normals, per solid angle (Heitz 2014, eq. 20).
double twinVisible(Vec3d wo, Vec3d h, double alpha) {
  const double c = dot(wo, h);
  return c > 0 && h.z > 0 ? twinDensity(h, alpha) * twinG1(wo.z, alpha) * c / wo.z : 0;
}
// Of directions reflected about visible normals, wi.z of either sign.
double twinReflectionPdf(Vec3d wo, Vec3d wi, double alpha) {
  const Vec3d h = normalize(wo + wi);
  return dot(wo, h) > 1e-9 ? twinVisible(wo, h, alpha) / (4 * dot(wo, h)) : 0;
}
// Of directions refracted at visible normals, per solid angle (Walter et al. 2007, eqs. 16 and 17).
struct TwinRefraction {
  double pdf = 0, jacobian = 0;
  Vec3d h;
};
TwinRefraction twinRefraction(Vec3d wo, Vec3d wi, double alpha, double eta) {
  TwinRefraction twin;
  twin.h = normalize(-(wo + wi * eta));
  if (twin.h.z < 0) twin.h = -twin.h;
  const double o = dot(wo, twin.h), i = dot(wi, twin.h);
  if (!(o > 0) || !(i < 0) || !(wi.z < 0)) return twin;
  twin.jacobian = eta * eta * -i / ((o + eta * i) * (o + eta * i));
  twin.pdf = twinVisible(wo, twin.h, alpha) * twin.jacobian;
  return twin;
}
void randomNumbers(uint32_t i, uint32_t k, float* u) {
  const auto h = pcg4d(i, k, 2, 3);
  for (int j = 0; j < 4; ++j) u[j] = toUnit(h[size_t(j)]);
}

// Directions counted in cells of equal solid angle over the whole sphere, against the integral of their density.
// sample(u, wi): false where nothing is sampled.
void expectDensity(const std::string& name, const std::function<bool(const float*, Vec3f&)>& sample,
                   const std::function<double(Vec3d)>& density) {
  constexpr int kRings = 16, kSectors = 8, kFine = 40;
  constexpr uint32_t kSamples = 1 << 15;
  std::vector<double> expected(kRings * kSectors), counted(kRings * kSectors);
  const double area = 4 * kPiD / (double(kRings) * kFine * kSectors * kFine);
  for (int r = 0; r < kRings * kFine; ++r)
    for (int s = 0; s < kSectors * kFine; ++s) {
      const double z = 2 * (r + 0.5) / (kRings * kFine) - 1, phi = 2 * kPiD * (s + 0.5) / (kSectors * kFine);
      const double sine = std::sqrt(1 - z * z);
      expected[size_t(r / kFine * kSectors + s / kFine)] +=
          density({sine * std::cos(phi), sine * std::sin(phi), z}) * area * kSamples;
    }
  double lost = 0;
  for (uint32_t i = 0; i < kSamples; ++i) {
    float u[4];
    randomNumbers(i, 1, u);
    Vec3f wi;
    if (!sample(u, wi)) {
      ++lost;
      continue;
    }
    const double phi = std::atan2(double(wi.y), double(wi.x)) + (wi.y < 0 ? 2 * kPiD : 0);
    const int ring = std::min(int((wi.z + 1) / 2 * kRings), kRings - 1);
    const int sector = std::min(int(phi / (2 * kPiD) * kSectors), kSectors - 1);
    counted[size_t(ring * kSectors + sector)] += 1;
  }
  double chi2 = 0, total = 0, rare = 0, rare_counted = lost;
  int cells = 0;
  for (size_t k = 0; k < expected.size(); ++k) {
    total += expected[k];
    if (expected[k] < 20) {
      rare += expected[k], rare_counted += counted[k];
      continue;
    }
    chi2 += (counted[k] - expected[k]) * (counted[k] - expected[k]) / expected[k];
    ++cells;
  }
  // What is in no cell, and the rare ones together.
  rare += std::max(0.0, kSamples - total);
  EXPECT_LE(total, kSamples * 1.005) << name;
  EXPECT_NEAR(rare_counted, rare, 5 * std::sqrt(rare) + 0.003 * kSamples) << name;
  ASSERT_GE(cells, 4) << name;
  // Mean: cells; deviation: sqrt(2 cells). Five deviations.
  EXPECT_LT(chi2, cells + 5 * std::sqrt(2.0 * cells)) << name;
}

std::string caseName(const char* lobe, float roughness, float cos_theta) {
  return std::string(lobe) + ", roughness " + std::to_string(roughness) + ", cosine " + std::to_string(cos_theta);
}

// All lobes traced, so that widths are not limited to what is traced by default.
Surface traced(float roughness) { return Surface().roughness(roughness).roughnessLimit(1); }

const float kRoughnesses[] = {0.4f, 0.7f, 1}, kCosines[] = {0.15f, 0.8f};

TEST(ChiSquared, TracedReflection) {
  for (float roughness : kRoughnesses)
    for (float cos_theta : kCosines) {
      const Lobes lobes = traced(roughness).lobes();
      const Vec3f wo = viewAt(cos_theta);
      const double alpha = double(lobes.alpha);
      expectDensity(
          caseName("reflection", roughness, cos_theta),
          [&](const float* u, Vec3f& wi) {
            const Bounce b = sampleReflection(lobes, kUp, wo, u);
            wi = b.direction;
            return b.valid;
          },
          [&](Vec3d wi) { return wi.z > 0 ? twinReflectionPdf(toDouble(wo), wi, alpha) : 0; });
    }
}

// The two interfaces share the samples by their albedos.
TEST(ChiSquared, TracedCoatOverSpecular) {
  for (float cos_theta : kCosines) {
    const Lobes lobes = traced(0.9f).clearcoat(1, 0.5f).lobes();
    const Vec3f wo = viewAt(cos_theta);
    const float coat = coatOf(lobes, wo.z).share;
    const float specular = interfaceShares(lobes, wo.z).reflected.x * (1 - coat);
    const double p = double(coat / (coat + specular));
    expectDensity(
        caseName("coat", 0.5f, cos_theta),
        [&](const float* u, Vec3f& wi) {
          const Bounce b = sampleReflection(lobes, kUp, wo, u);
          wi = b.direction;
          return b.valid;
        },
        [&](Vec3d wi) {
          if (!(wi.z > 0)) return 0.0;
          return p * twinReflectionPdf(toDouble(wo), wi, double(lobes.coat_alpha)) +
                 (1 - p) * twinReflectionPdf(toDouble(wo), wi, double(lobes.alpha));
        });
  }
}

TEST(ChiSquared, Refraction) {
  for (float roughness : kRoughnesses)
    for (float cos_theta : kCosines)
      for (bool back : {false, true}) {
        const Lobes lobes = traced(roughness).opacity(0).lobes(back);
        const Vec3f wo = viewAt(cos_theta);
        if (back && cos_theta < 0.3f && roughness < 0.5f) continue;  // next to nothing but total reflection
        expectDensity(
            caseName(back ? "refraction from inside" : "refraction", roughness, cos_theta),
            [&](const float* u, Vec3f& wi) {
              const Bounce b = sampleRefraction(lobes, kUp, wo, u);
              wi = b.direction;
              return b.valid;
            },
            [&](Vec3d wi) { return twinRefraction(toDouble(wo), wi, double(lobes.alpha), double(lobes.eta)).pdf; });
      }
}

// What is reflected down comes up again where light is given back, and is lost otherwise.
TEST(ChiSquared, ReflectionOffGlass) {
  for (bool compensated : {true, false})
    for (float roughness : kRoughnesses)
      for (float cos_theta : kCosines) {
        Surface surface = traced(roughness).opacity(0);
        if (!compensated) surface.uncompensated();
        const Lobes lobes = surface.lobes(true);
        const Vec3d wo = toDouble(viewAt(cos_theta));
        const double alpha = double(lobes.alpha);
        expectDensity(
            caseName("glass", roughness, cos_theta),
            [&](const float* u, Vec3f& wi) {
              const Bounce b = sampleReflection(lobes, kUp, toFloat(wo), u);
              wi = b.direction;
              return b.valid;
            },
            [&](Vec3d wi) {
              if (!(wi.z > 0)) return 0.0;
              const double below = compensated ? twinReflectionPdf(wo, {wi.x, wi.y, -wi.z}, alpha) : 0;
              return twinReflectionPdf(wo, wi, alpha) + below;
            });
      }
}

TEST(ChiSquared, RoughSheet) {
  for (float roughness : {0.7f, 1.0f})
    for (float cos_theta : kCosines) {
      const Lobes lobes = traced(roughness).opacity(0).ior(2).lobes(InterfaceView{false, true, 1});
      const Vec3f wo = viewAt(cos_theta);
      // The slopes of two interfaces that bend by ior - 1 each, against reflection's 2.
      const double alpha = double(roughness) * roughness * std::sqrt(2.0) * (2 - 1) / 2;
      expectDensity(
          caseName("sheet", roughness, cos_theta),
          [&](const float* u, Vec3f& wi) {
            const Bounce b = sampleRefraction(lobes, kUp, wo, u);
            wi = b.direction;
            return b.valid;
          },
          [&](Vec3d wi) { return wi.z < 0 ? twinReflectionPdf(toDouble(wo), {wi.x, wi.y, -wi.z}, alpha) : 0; });
    }
}

TEST(ChiSquared, EvaluatedLobes) {
  const Surface surfaces[] = {Surface().roughness(0.5f), Surface().roughness(1),
                              Surface().roughness(0.7f).clearcoat(1, 0.4f), Surface().roughness(0.6f).opacity(0),
                              Surface().roughness(1).opacity(0).clearcoat(1, 0.5f)};
  for (const Surface& surface : surfaces)
    for (bool back : {false, true})
      for (float cos_theta : kCosines) {
        const ShadedView view(surface.lobes(back), {1, 1, 1}, kUp, viewAt(cos_theta), true);
        expectDensity(
            caseName("evaluated", surface.inputs.roughness, cos_theta),
            [&](const float* u, Vec3f& wi) {
              wi = view.sampleRoughLobe(u);
              return wi != Vec3f{};
            },
            [&](Vec3d wi) { return double(view.pdfRoughLobe(toFloat(wi))); });
      }
}

Vec3f directionAt(uint32_t k, uint32_t seed) {
  const Vec2f u = sobol2(k, seed);
  const float z = 0.02f + 0.98f * u.x, s = std::sqrt(1 - z * z);
  return {s * std::cos(2 * kPi * u.y), s * std::sin(2 * kPi * u.y), z};
}

// What sampling carries, weight times density, is what evaluation gives and the textbook says.
TEST(Values, TracedReflectionIsItsEvaluation) {
  for (bool compensated : {true, false})
    for (float roughness : {0.1f, 0.4f, 1.0f}) {
      Surface surface = traced(roughness).metallic(0.5f).base({0.9f, 0.5f, 0.1f});
      if (!compensated) surface.uncompensated();
      const Lobes lobes = surface.lobes();
      for (uint32_t i = 0; i < 300; ++i) {
        const Vec3f wo = directionAt(i, 21);
        const Bounce b = sampleReflection(lobes, kUp, wo, Points(i, 22).u);
        if (!b.valid || b.direction.z < 1e-3f) continue;
        const double pdf = twinReflectionPdf(toDouble(wo), toDouble(b.direction), double(lobes.alpha));
        const Vec3f evaluated = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, b.direction, true, true).specular;
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(double(b.weight[k]) * pdf / double(evaluated[k]), 1, 0.01);
      }
    }
}

TEST(Values, GlassReflectionIsItsEvaluation) {
  for (bool back : {false, true}) {
    const Lobes lobes = traced(0.7f).opacity(0).specular({0.2f, 0.4f, 0.6f}).lobes(back);
    const Vec3f wo = viewAt(0.6f);
    // Albedo by sampling, and by integrating what evaluation gives.
    const Vec3f sampled = meanReflection(lobes, wo, 1 << 14);
    const ShadedView view(lobes, {1, 1, 1}, kUp, wo, true);
    for (int k = 0; k < 3; ++k) {
      const double integral =
          integrateHemisphere([&](Vec3d wi) { return double(view.evaluate(toFloat(wi), true).specular[k]); }, 200, 400);
      EXPECT_NEAR(double(sampled[k]) / integral, 1, 5e-3) << back;
    }
  }
}

TEST(Values, RoughWeightsIntegrateToAlbedo) {
  for (float roughness : {0.15f, 0.3f}) {
    for (float cos_theta : {0.2f, 0.6f, 1.0f}) {
      const double alpha = double(roughness) * roughness;
      const Vec3d wo = toDouble(viewAt(cos_theta));
      const double albedo = integrateHemisphere(
          [&](Vec3d wi) { return twinReflection(wo, wi, alpha) * twinFresnel(dot(wo, normalize(wo + wi)), 1.5); }, 1000,
          1000);
      const Lobes lobes = Surface().roughness(roughness).uncompensated().lobes();
      ASSERT_TRUE(lobes.specular_traced);
      EXPECT_NEAR(meanReflection(lobes, viewAt(cos_theta), 1 << 14).x / albedo, 1, 4e-3)
          << roughness << ' ' << cos_theta;
    }
  }
}

TEST(Values, RoughRefractionIntegratesToTheTextbook) {
  for (bool back : {false, true})
    for (float cos_theta : {0.3f, 0.9f}) {
      const Lobes lobes = traced(0.6f).opacity(0).uncompensated().lobes(back);
      const double alpha = double(lobes.alpha), eta = double(lobes.eta);
      const Vec3d wo = toDouble(viewAt(cos_theta));
      const double albedo = integrateHemisphere(
          [&](Vec3d up) {
            const Vec3d wi{up.x, up.y, -up.z};
            const TwinRefraction twin = twinRefraction(wo, wi, alpha, eta);
            if (!(twin.pdf > 0)) return 0.0;
            const double g2 = 1 / (1 + twinLambda(wo.z, alpha) + twinLambda(up.z, alpha));
            return twin.pdf * (1 - twinFresnel(dot(wo, twin.h), eta)) * g2 / twinG1(wo.z, alpha);
          },
          400, 400);
      EXPECT_NEAR(meanRefraction(lobes, toFloat(wo), 1 << 14).x / albedo, 1, 4e-3) << back << ' ' << cos_theta;
    }
}

TEST(Values, RoughRefractionObeysSnellAtTheMicrofacet) {
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

// Bare lobes: without what is given back, which depends on the view alone.
TEST(Reciprocity, Reflection) {
  const Surface surfaces[] = {Surface().roughness(0.6f), Surface().roughness(0.4f).metallic(1).base({0.9f, 0.5f, 0.2f}),
                              Surface().roughness(1).specular({0.3f, 0.3f, 0.3f}),
                              Surface().roughness(0.5f).opacity(0)};
  for (Surface surface : surfaces) {
    const Lobes lobes = surface.uncompensated().lobes();
    ASSERT_FALSE(lobes.specular_traced);
    for (uint32_t k = 0; k < 200; ++k) {
      const Vec3f wo = directionAt(k, 11), wi = directionAt(k, 12);
      const Vec3f there = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).specular / wi.z;
      const Vec3f back = evaluateShaded(lobes, {1, 1, 1}, kUp, wi, wo, true, false).specular / wo.z;
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(there[c] / back[c], 1, 2e-4);
    }
  }
  const Lobes lobes = Surface().roughness(0.6f).uncompensated().lobes();
  for (uint32_t k = 0; k < 200; ++k) {
    const Vec3f wo = directionAt(k, 11), wi = directionAt(k, 12);
    const Vec3d o = toDouble(wo), i = toDouble(wi);
    const double twin = twinReflection(o, i, double(lobes.alpha)) * twinFresnel(dot(o, normalize(o + i)), 1.5);
    EXPECT_NEAR(double(evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).specular.x) / twin, 1, 1e-4);
  }
  EXPECT_EQ(evaluateShaded(lobes, {1, 1, 1}, kUp, kUp, {0, 0.6f, -0.8f}, true, true).specular, (Vec3f{}));
  EXPECT_EQ(evaluateShaded(lobes, {1, 1, 1}, kUp, kUp, {0, 0.6f, -0.8f}, true, true).diffuse, (Vec3f{}));
}

TEST(Reciprocity, Clearcoat) {
  Lobes lobes = smooth().ior(1).clearcoat(1, 0.6f).uncompensated().lobes();
  for (uint32_t k = 0; k < 100; ++k) {
    const Vec3f wo = directionAt(k, 13), wi = directionAt(k, 14);
    const float there = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).specular.x / wi.z;
    const float back = evaluateShaded(lobes, {1, 1, 1}, kUp, wi, wo, true, false).specular.x / wo.z;
    EXPECT_NEAR(there / back, 1, 2e-4);
  }
}

// Radiance is not scaled by eta² here (bsdf.h), so that the two ways through differ by it: Walter et al. 2007, eq. 21.
TEST(Reciprocity, Refraction) {
  const Surface surface = traced(0.6f).opacity(0).uncompensated();
  const Lobes enter = surface.lobes(false), leave = surface.lobes(true);
  const double alpha = double(enter.alpha), eta = double(enter.eta);
  int compared = 0;
  for (uint32_t k = 0; k < 300; ++k) {
    const Vec3f wo = directionAt(k, 15);
    const Bounce b = sampleRefraction(enter, kUp, wo, Points(k, 16).u);
    if (!b.valid || b.direction.z > -0.01f) continue;
    // Of the other side's frame, where the normal is turned over.
    const auto turned = [](Vec3f v) { return Vec3f{v.x, v.y, -v.z}; };
    const Vec3f inside = turned(b.direction), outside = turned(wo), h = turned(-b.half_vector);
    const double there = double(b.weight.x) * twinRefraction(toDouble(wo), toDouble(b.direction), alpha, eta).pdf;
    const double back = double(facetShares(leave, {}, inside, h).transmitted.x) *
                        twinRefraction(toDouble(inside), toDouble(outside), alpha, 1 / eta).pdf;
    EXPECT_NEAR(there / double(inside.z) / (back / double(wo.z) * eta * eta), 1, 2e-3);
    ++compared;
  }
  EXPECT_GT(compared, 200);
}

}  // namespace
}  // namespace encore
