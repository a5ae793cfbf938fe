// Lights against closed forms of irradiance and solid angle.
#include "core/shade/lights.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/scene/random.h"
#include "core/shade/light_set.h"
#include "shapes.h"

namespace encore {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr uint32_t kSamples = 1 << 14;

Light rect(Vec3d centre, Vec3f half_u, Vec3f half_v) {
  Light light;
  light.kind = Light::Kind::Rect;
  light.centre = centre, light.half_u = half_u, light.half_v = half_v;
  return light;
}
Light sphere(Vec3d centre, float radius) {
  Light light;
  light.kind = Light::Kind::Sphere;
  light.centre = centre, light.radius = radius;
  return light;
}
Light distant(Vec3f direction, float angle) {
  Light light;
  light.kind = Light::Kind::Distant;
  light.direction = normalize(direction), light.angle_radians = angle;
  return light;
}
Light dome() {
  Light light;
  light.kind = Light::Kind::Dome;
  return light;
}

// Mean of f(sample) / pdf: an integral over the light's solid angle.
template <class F>
double integrate(const Light& light, Vec3f p, Vec3f n, F f) {
  double sum = 0;
  for (uint32_t i = 0; i < kSamples; ++i) {
    const LightSample s = sampleLight(light, p, n, sobol2(i, 4));
    if (s.valid) sum += double(f(s)) / double(s.pdf);
  }
  return sum / kSamples;
}
double irradiance(const Light& light, Vec3f p, Vec3f n) {
  return integrate(light, p, n,
                   [&](const LightSample& s) { return s.radiance.x * std::max(dot(s.direction, n), 0.0f); });
}
double solidAngle(const Light& light, Vec3f p) {
  return integrate(light, p, {0, 0, 1}, [](const LightSample&) { return 1; });
}

// Twin: Lambert's formula for a polygon wholly above the horizon, corners in order.
double lambertIrradiance(const Light& light, Vec3f p, Vec3f n) {
  const Vec3d hu = toDouble(light.half_u), hv = toDouble(light.half_v), c = light.centre - toDouble(p);
  const Vec3d corners[4] = {c - hu - hv, c + hu - hv, c + hu + hv, c - hu + hv};
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    const Vec3d a = normalize(corners[i]), b = normalize(corners[(i + 1) % 4]);
    sum += std::acos(dot(a, b)) * dot(normalize(cross(a, b)), toDouble(n));
  }
  return std::abs(sum) / 2;
}
// Twin: solid angle of a triangle (Van Oosterom & Strackee 1983), twice.
double quadSolidAngle(const Light& light, Vec3f p) {
  const Vec3d hu = toDouble(light.half_u), hv = toDouble(light.half_v), o = light.centre - toDouble(p);
  const auto triangle = [](Vec3d a, Vec3d b, Vec3d c) {
    a = normalize(a), b = normalize(b), c = normalize(c);
    return std::abs(2 * std::atan2(dot(a, cross(b, c)), 1 + dot(a, b) + dot(b, c) + dot(c, a)));
  };
  return triangle(o - hu - hv, o + hu - hv, o + hu + hv) + triangle(o - hu - hv, o + hu + hv, o - hu + hv);
}

struct RectCase {
  const char* name;
  Light light;
};
// All light the ground around the origin (normal +Z) from above.
const RectCase kRects[] = {
    {"overhead", rect({0, 0, 2}, {1, 0, 0}, {0, 1, 0})},
    {"aside", rect({3, -1, 2}, {0.7f, 0, 0}, {0, 0.4f, 0})},
    {"close", rect({0.5, 0.5, 0.05}, {2, 0, 0}, {0, 2, 0})},
    {"tilted", rect({1, 0.5, 3}, {0.8f, 0.6f, 0}, {-0.36f, 0.48f, 0.8f})},
    {"strip", rect({0, 1, 1}, {5, 0, 0}, {0, 0.02f, 0})},
    {"small", rect({0, 4, 9}, {0.05f, 0, 0}, {0, 0.03f, 0})},
    {"sheared", rect({1, 0, 2}, {1, 0, 0}, {0.6f, 0.8f, 0})},
    {"far", rect({3e4, 1e4, 4e4}, {3e3f, 0, 0}, {0, 2e3f, 0})},
};

TEST(Rect, IrradianceIsLamberts) {
  for (const RectCase& c : kRects) {
    const double exact = lambertIrradiance(c.light, {0, 0, 0}, {0, 0, 1});
    EXPECT_NEAR(irradiance(c.light, {0, 0, 0}, {0, 0, 1}) / exact, 1, 0.005) << c.name;
  }
}

TEST(Rect, SolidAngle) {
  for (const RectCase& c : kRects)
    EXPECT_NEAR(solidAngle(c.light, {0, 0, 0}) / quadSolidAngle(c.light, {0, 0, 0}), 1, 0.005) << c.name;
  // Uniform in solid angle: no variance at all.
  const float pdf = pdfLight(kRects[0].light, {0, 0, 0}, {0, 0, 1}, {0, 0, 1});
  EXPECT_NEAR(pdf * quadSolidAngle(kRects[0].light, {0, 0, 0}), 1, 1e-5);
}

TEST(Rect, OnlyOneSideEmits) {
  const Light light = rect({0, 0, 2}, {1, 0, 0}, {0, 1, 0});  // emits along -Z
  EXPECT_TRUE(sampleLight(light, {0, 0, 0}, {0, 0, 1}, {0.3f, 0.6f}).valid);
  EXPECT_FALSE(sampleLight(light, {0, 0, 4}, {0, 0, -1}, {0.3f, 0.6f}).valid);
  EXPECT_FALSE(sampleLight(light, {5, 0, 2}, {-1, 0, 0}, {0.3f, 0.6f}).valid);  // edge on
  EXPECT_EQ(pdfLight(light, {0, 0, 4}, {0, 0, -1}, {0, 0, -1}), 0);
  EXPECT_LT(intersectLight(light, {0, 0, 4}, {0, 0, -1}), 0);
  EXPECT_EQ(intersectLight(light, {0, 0, 0}, {0, 0, 1}), 2);
  EXPECT_LT(intersectLight(light, {0, 0, 0}, {0, 0, -1}), 0);
  EXPECT_LT(intersectLight(light, {1.01f, 0, 0}, {0, 0, 1}), 0);
  EXPECT_EQ(intersectLight(light, {0.99f, -0.99f, 0}, {0, 0, 1}), 2);
  EXPECT_FALSE(sampleLight(rect({0, 0, 2}, {0, 0, 0}, {0, 1, 0}), {0, 0, 0}, {0, 0, 1}, {0.5f, 0.5f}).valid);
}

TEST(Sphere, IrradianceAndSolidAngle) {
  const Vec3f n{0, 0, 1};
  for (float r : {0.01f, 0.5f, 1.5f}) {
    const Light light = sphere({1, 2, 2}, r);  // distance 3, cosine 2/3, above the horizon
    EXPECT_NEAR(irradiance(light, {0, 0, 0}, n) / (double(kPi) * r * r / 9 * 2 / 3), 1, 0.002) << r;
    EXPECT_NEAR(solidAngle(light, {0, 0, 0}) / (2 * double(kPi) * (1 - std::sqrt(1 - double(r) * r / 9))), 1, 1e-3)
        << r;
  }
  // From inside all directions see it.
  const Light around = sphere({0, 0, 1}, 4);
  EXPECT_NEAR(solidAngle(around, {0, 0, 0}), 4 * kPi, 1e-3);
  EXPECT_NEAR(irradiance(around, {0, 0, 0}, n), kPi, 0.01);
  EXPECT_NEAR(intersectLight(around, {0, 0, 0}, {0, 0, 1}), 5, 1e-5);
  EXPECT_NEAR(intersectLight(around, {0, 0, 0}, {0, 0, -1}), 3, 1e-5);
  EXPECT_FALSE(sampleLight(sphere({0, 0, 1}, 0), {0, 0, 0}, n, {0.5f, 0.5f}).valid);
}

TEST(Distant, DeltaAndDisk) {
  const Vec3f direction{0.6f, 0, -0.8f}, n{0, 0, 1};
  const Light sun = distant(direction, 0);
  EXPECT_TRUE(isDelta(sun));
  EXPECT_TRUE(anyDelta(std::span(&sun, 1)));
  const LightSample s = sampleLight(sun, {0, 0, 0}, n, {0.2f, 0.7f});
  EXPECT_TRUE(s.valid);
  EXPECT_EQ(s.direction, -sun.direction);
  EXPECT_EQ(s.distance, kInfinity);
  EXPECT_EQ(s.pdf, 0);
  EXPECT_LT(intersectLight(sun, {0, 0, 0}, -sun.direction), 0);

  // E = pi L sin²(half angle) cos. The sun's disk is 0.53 degrees.
  for (float degrees : {0.01f, 0.53f, 10.0f, 60.0f}) {
    const Light disk = distant(direction, degrees * kPi / 180);
    EXPECT_FALSE(isDelta(disk));
    const double half = double(degrees) * double(kPi) / 360;
    EXPECT_NEAR(irradiance(disk, {0, 0, 0}, n) / (double(kPi) * std::pow(std::sin(half), 2) * 0.8), 1, 0.002)
        << degrees;
    EXPECT_NEAR(solidAngle(disk, {0, 0, 0}) / (4 * double(kPi) * std::pow(std::sin(half / 2), 2)), 1, 1e-3) << degrees;
  }
}

TEST(Dome, CosineAroundTheNormal) {
  const Vec3f n = normalize(Vec3f{1, -2, 0.5f});
  EXPECT_NEAR(irradiance(dome(), {0, 0, 0}, n), kPi, 1e-4);
  EXPECT_NEAR(pdfLight(dome(), {0, 0, 0}, n, n), kInvPi, 1e-6);
  EXPECT_EQ(pdfLight(dome(), {0, 0, 0}, n, -n), 0);
}

// pdf() is what sample() says, samples lie on the light, and the density integrates to 1.
TEST(Lights, DensitiesAgree) {
  std::vector<Light> lights = {sphere({1, 2, 2}, 1.5f), sphere({0, 0, 1}, 4), distant({0.6f, 0, -0.8f}, 0.7f), dome()};
  for (const RectCase& c : kRects) lights.push_back(c.light);
  const Vec3f p{0, 0, 0}, n{0, 0, 1};
  for (size_t k = 0; k < lights.size(); ++k) {
    int missed = 0;
    for (uint32_t i = 0; i < 1000; ++i) {
      const LightSample s = sampleLight(lights[k], p, n, sobol2(i, 8));
      ASSERT_TRUE(s.valid);
      EXPECT_NEAR(length(s.direction), 1, 1e-5);
      const float pdf = pdfLight(lights[k], p, n, s.direction);
      if (pdf == 0) {
        ++missed;  // on the rim, by rounding
        continue;
      }
      EXPECT_NEAR(pdf / s.pdf, 1, 2e-3) << k;
      const float t = intersectLight(lights[k], p, s.direction);
      if (s.distance == kInfinity) {
        EXPECT_EQ(t, kInfinity);
      } else {
        EXPECT_NEAR(t / s.distance, 1, 1e-4) << k;
      }
    }
    EXPECT_LE(missed, 4) << k;
    double sum = 0;
    constexpr uint32_t kDirections = 1 << 18;
    for (uint32_t i = 0; i < kDirections; ++i) {
      const Vec2f u = sobol2(i, 3);
      const float z = 1 - 2 * u.x, s = std::sqrt(std::max(0.0f, 1 - z * z));
      sum += double(pdfLight(lights[k], p, n, {s * std::cos(2 * kPi * u.y), s * std::sin(2 * kPi * u.y), z}));
    }
    const double solid_angle = k == 3 ? 2 * double(kPi) : solidAngle(lights[k], p);
    // Counting error of the directions that fall on the light.
    const double hits = kDirections * solid_angle / (4 * double(kPi));
    EXPECT_NEAR(sum / kDirections * 4 * double(kPi), 1, 0.005 + 2 / std::sqrt(hits)) << k;
  }
}

TEST(Lights, FarFromTheOriginNothingIsLost) {
  // The centre is in double: only the difference to p is rounded.
  const Light near_by = rect({0, 0, 2}, {1, 0, 0}, {0, 1, 0}), away = rect({65536, 0, 2}, {1, 0, 0}, {0, 1, 0});
  EXPECT_EQ(pdfLight(near_by, {0, 0, 0}, {0, 0, 1}, {0, 0, 1}), pdfLight(away, {65536, 0, 0}, {0, 0, 1}, {0, 0, 1}));
}

TEST(Lights, NearestIsSeenAndInfiniteOnesAddUp) {
  test::Stage stage;
  const TraceScene trace(stage.scene, stage.diced);
  const LightSet set(stage.scene, {}, trace);
  std::vector<Light> lights = {rect({0, 0, 5}, {1, 0, 0}, {0, 1, 0}),
                               sphere({0, 0, 3}, 1),
                               dome(),
                               dome(),
                               distant({0, 0, -1}, 0.5f),
                               distant({0, 0, -1}, 0)};
  for (size_t i = 0; i < lights.size(); ++i) lights[i].radiance = {float(1 << i), 0, 0};
  lights[1].specular = 0.5f;
  lights[3].specular = 0;
  const Vec3f p{0, 0, 0}, up{0, 0, 1};
  const LightHit hit = intersectLights(set, lights, p, up, kInfinity);
  EXPECT_TRUE(hit.valid);
  EXPECT_EQ(hit.radiance.x, 2);
  EXPECT_EQ(hit.specular_radiance.x, 1);
  EXPECT_NEAR(hit.t, 2, 1e-6);
  EXPECT_FALSE(intersectLights(set, lights, p, up, 1.5f).valid);  // a surface in front of them
  const LightHit beside = intersectLights(set, lights, {1.5f, 0, 0}, up, kInfinity);
  EXPECT_EQ(beside.radiance.x, 4 + 8 + 16);
  EXPECT_EQ(beside.specular_radiance.x, 4 + 16);
  EXPECT_EQ(beside.t, kInfinity);
  EXPECT_FALSE(intersectLights(set, lights, {1.5f, 0, 0}, up, 100).valid);
  const LightHit down = intersectLights(set, lights, p, -up, kInfinity);
  EXPECT_EQ(down.radiance.x, 4 + 8);
  EXPECT_FALSE(intersectLights(set, {}, p, up, kInfinity).valid);
}

}  // namespace
}  // namespace encore
