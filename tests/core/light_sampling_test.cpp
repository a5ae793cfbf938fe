// Every kind of light: that samples follow their density, and that what they carry adds up.
#include <gtest/gtest.h>

#include <limits>

#include "core/shade/light_set.h"
#include "light_kinds.h"
#include "shapes.h"

namespace encore {
namespace {

using test::NamedLight;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kPiD = 3.14159265358979323846;
const Vec3f kOrigin{0, 0, 0}, kUp{0, 0, 1};

TEST(LightSampling, FollowsItsDensity) {
  for (const NamedLight& c : test::lightsOfEveryKind()) {
    const LightSampler sampler(c.light, kOrigin, kUp);
    const auto sample = [&](Vec2f u, Vec3f& d) {
      const LightSample s = sampler.sample(u);
      d = s.direction;
      return s.valid;
    };
    const test::ChiSquared chi = test::testDirections(sample, [&](Vec3f d) { return sampler.pdf(d); }, 40000, 400);
    EXPECT_LT(chi.value(), chi.limit()) << c.name;
    EXPECT_GE(chi.cells, 100) << c.name;
  }
}

TEST(LightSampling, AgreesWithIntersection) {
  for (const NamedLight& c : test::lightsOfEveryKind()) {
    const LightSampler sampler(c.light, kOrigin, kUp);
    int missed = 0, valid = 0;
    for (uint32_t i = 0; i < 4000; ++i) {
      const LightSample s = sampler.sample(sobol2(i, 8));
      if (!s.valid) continue;
      ++valid;
      EXPECT_NEAR(length(s.direction), 1, 1e-5) << c.name;
      const float pdf = sampler.pdf(s.direction), t = intersectLight(c.light, kOrigin, s.direction);
      if (t < 0 || pdf == 0) {
        ++missed;  // on the rim, by rounding
        continue;
      }
      EXPECT_NEAR(pdf / s.pdf, 1, 4e-3) << c.name;
      if (s.distance == kInfinity) {
        EXPECT_EQ(t, kInfinity);
      } else {
        EXPECT_NEAR(t / s.distance, 1, 1e-3) << c.name;
      }
    }
    EXPECT_LE(missed, 8) << c.name;
    EXPECT_GT(valid, 3000) << c.name;
  }
}

// The irradiance from samples against that from directions all over the sphere, which only intersection knows of.
TEST(LightSampling, FluxIsThatOfAllDirections) {
  for (NamedLight c : test::lightsOfEveryKind()) {
    if (c.name == "small rect" || c.name == "far cylinder") c.light.radiance = {1, 1, 1};
    const LightSampler sampler(c.light, kOrigin, kUp);
    double by_samples = 0, by_directions = 0, squares = 0;
    constexpr uint32_t kSamples = 1 << 15, kDirections = 1 << 18;
    for (uint32_t i = 0; i < kSamples; ++i) {
      const LightSample s = sampler.sample(sobol2(i, 4));
      if (s.valid) by_samples += double(std::max(s.direction.z, 0.0f) / s.pdf) / kSamples;
    }
    for (uint32_t i = 0; i < kDirections; ++i) {
      const Vec3f d = test::onSphere(sobol2(i, 3));
      if (d.z > 0 && intersectLight(c.light, kOrigin, d) >= 0)
        by_directions += 4 * kPiD * double(d.z) / kDirections,
            squares += std::pow(4 * kPiD * double(d.z), 2) / kDirections;
    }
    const double error = std::sqrt(squares / kDirections);
    EXPECT_NEAR(by_samples, by_directions, 0.002 * by_directions + 2 * error) << c.name;
  }
}

// What leaves a light altogether is radiance × π × area: brute force over points and directions around it.
TEST(LightSampling, TotalFluxThroughASphereAround) {
  using K = Light::Kind;
  const struct {
    Light light;
    double area;
  } cases[] = {
      {test::light(K::Rect, {0, 0, 0}, {0.4f, 0, 0}, {0, 0.3f, 0}), 0.48},
      {test::light(K::Disk, {0, 0, 0}, {0.4f, 0, 0}, {0, 0.3f, 0}), kPiD * 0.12},
      {test::light(K::Sphere, {0.1, 0, 0}, {}, {}, 0.4f), 4 * kPiD * 0.16},
      {test::light(K::Cylinder, {0, 0, 0.1}, {0.1f, 0.2f, 0.3f}, {}, 0.2f), 2 * kPiD * 0.2 * 2 * std::sqrt(0.14)}};
  for (const auto& c : cases) {
    double flux = 0;
    constexpr uint32_t kPoints = 4096, kSamples = 16;
    for (uint32_t i = 0; i < kPoints; ++i) {
      const Vec3f p = test::onSphere(sobol2(i, 2));
      const LightSampler sampler(c.light, p, -p);
      for (uint32_t k = 0; k < kSamples; ++k) {
        const LightSample s = sampler.sample(sobol2(k, i));
        if (s.valid) flux += double(std::max(dot(s.direction, -p), 0.0f) / s.pdf);
      }
    }
    flux *= 4 * kPiD / kPoints / kSamples;
    EXPECT_NEAR(flux / (kPiD * c.area), 1, 0.01) << int(c.light.kind);
  }
}

TEST(LightSampling, DarkSidesAndNoExtent) {
  using K = Light::Kind;
  const Light disk = test::light(K::Disk, {0, 0, 2}, {1, 0, 0}, {0, 1, 0});  // emits along -Z
  EXPECT_NEAR(intersectLight(disk, {0, 0, 0}, kUp), 2, 1e-6);
  EXPECT_LT(intersectLight(disk, {0.8f, 0.8f, 0}, kUp), 0);
  EXPECT_LT(intersectLight(disk, {0, 0, 4}, -kUp), 0);
  EXPECT_FALSE(sampleLight(disk, {0, 0, 4}, -kUp, {0.3f, 0.3f}).valid);
  const Light tube = test::light(K::Cylinder, {0, 0, 0}, {0, 0, 1}, {}, 1);
  EXPECT_LT(intersectLight(tube, {0, 0, 0}, {1, 0, 0}), 0);   // from inside
  EXPECT_LT(intersectLight(tube, {0, 0, 3}, {0, 0, -1}), 0);  // no caps
  EXPECT_LT(intersectLight(tube, {2, 0, 1.01f}, {-1, 0, 0}), 0);
  EXPECT_NEAR(intersectLight(tube, {3, 0, 0.5f}, {-1, 0, 0}), 2, 1e-6);
  for (const Vec3f p : {Vec3f{0.5f, 0, 0}, Vec3f{1, 0, 0}, Vec3f{0, 0, 3}}) {
    EXPECT_FALSE(sampleLight(tube, p, kUp, {0.3f, 0.3f}).valid);
    EXPECT_EQ(pdfLight(tube, p, kUp, {1, 0, 0}), 0);
  }
  for (const K kind : {K::Rect, K::Disk, K::Sphere, K::Cylinder, K::Mesh}) {
    const Light none = test::light(kind, {0, 0, 2}, {0, 0, 0}, {0, 1, 0}, 0);
    EXPECT_FALSE(sampleLight(none, kOrigin, kUp, {0.3f, 0.3f}).valid) << int(kind);
    EXPECT_EQ(pdfLight(none, kOrigin, kUp, kUp), 0) << int(kind);
    EXPECT_LT(intersectLight(none, kOrigin, kUp), 0) << int(kind);
  }
}

// Whatever the scale and wherever the point, samples are finite or not valid.
TEST(LightSampling, IsFiniteInHardPlaces) {
  test::Stream stream(5);
  for (const NamedLight& c : test::lightsOfEveryKind())
    for (const float scale : {1e-6f, 1.0f, 1e6f}) {
      Light light = c.light;
      light.centre = light.centre * scale, light.half_u *= scale, light.half_v *= scale, light.radius *= scale;
      for (int i = 0; i < 300; ++i) {
        const Vec3f centre = toFloat(light.centre);
        const Vec3f points[] = {stream.inCube(10 * scale),
                                centre,
                                centre + light.half_u,
                                centre + light.half_v * 1.00001f,
                                centre + stream.onSphere() * light.radius,
                                stream.inCube(1e7f * scale)};
        for (const Vec3f p : points) {
          const LightSampler sampler(light, p, stream.onSphere());
          const LightSample s = sampler.sample({i % 3 ? stream.next() : 0, i % 5 ? stream.next() : 0x1.fffffep-1f});
          if (!s.valid) continue;
          EXPECT_TRUE(isFinite(s.direction)) << c.name << " " << scale;
          EXPECT_FALSE(std::isnan(s.distance)) << c.name << " " << scale;
          EXPECT_GE(s.distance, 0) << c.name << " " << scale;
          EXPECT_FALSE(std::isnan(s.pdf)) << c.name << " " << scale;
          EXPECT_FALSE(std::isnan(sampler.pdf(stream.onSphere()))) << c.name << " " << scale;
        }
      }
    }
}

// A mesh: its own density against the count of points on each triangle, and irradiance against the sphere it stands
// for.
TEST(MeshLight, ChoosesTrianglesByItsDensity) {
  test::Stage stage;
  stage.add(test::sphere(3), 0, test::translation({1, 2, 3}) * test::scaling({1, -1, 2}));  // mirrored
  const TraceScene trace(stage.scene, stage.diced);
  const MeshLight mesh(trace, 0, true, false);
  ASSERT_EQ(mesh.size(), 6u * 9 * 2);
  const Vec3f p{0.5f, 0, 0.2f};
  constexpr uint32_t kCount = 100000;
  std::vector<double> observed(mesh.size()), expected(mesh.size());
  for (uint32_t t = 0; t < mesh.size(); ++t) {
    const auto c = mesh.triangle(trace, t, 0);
    const Vec3f axis = cross(c[1] - c[0], c[2] - c[0]);
    EXPECT_GT(dot(axis, (c[0] + c[1] + c[2]) / 3 - Vec3f{1, 2, 3}), 0);  // outside
    expected[t] = double(mesh.density(trace, p, t, 0)) * double(length(axis)) / 2 * kCount;
  }
  for (uint32_t i = 0; i < kCount; ++i) {
    const auto h = pcg4d(i, 1, 2, 3);
    const MeshLight::Sample s = mesh.sample(trace, p, {toUnit(h[0]), toUnit(h[1])}, 0);
    ASSERT_GT(s.density, 0);
    uint32_t best = 0;
    float least = kInfinity;
    for (uint32_t t = 0; t < mesh.size(); ++t) {  // the triangle that it lies in
      const auto c = mesh.triangle(trace, t, 0);
      const float around = length(cross(c[0] - s.position, c[1] - s.position)) +
                           length(cross(c[1] - s.position, c[2] - s.position)) +
                           length(cross(c[2] - s.position, c[0] - s.position));
      const float excess = around / length(cross(c[1] - c[0], c[2] - c[0]));
      if (excess < least) least = excess, best = t;
    }
    observed[best] += 1;
    if (i < 100) {
      EXPECT_NEAR(s.density / mesh.density(trace, p, best, 0), 1, 1e-3);
    }
  }
  const test::ChiSquared chi = test::chiSquared(observed, expected);
  EXPECT_LT(chi.value(), chi.limit());
}

TEST(MeshLight, ShinesAsTheShapeThatItStandsFor) {
  test::Stage stage;
  stage.add(test::sphere(12), 0, test::translation({1, 2, 2}) * test::scaling({0.5, 0.5, 0.5}));
  stage.scene.lights.emplace_back().kind = Light::Kind::Mesh;
  stage.scene.lights[0].instance = 0;
  const TraceScene trace(stage.scene, stage.diced);
  const LightSet set(stage.scene, {}, trace);
  const LightSampler sampler(stage.scene.lights[0], kOrigin, kUp, set.lights()[0].parts);
  double irradiance = 0;
  int invalid = 0;
  for (uint32_t i = 0; i < 4096; ++i) {
    const LightSample s = sampler.sample(sobol2(i, 6));
    invalid += !s.valid;
    if (s.valid) irradiance += double(std::max(s.direction.z, 0.0f) / s.pdf) / 4096;
  }
  EXPECT_NEAR(irradiance / (kPiD * 0.25 / 9 * 2 / 3), 1, 0.02);  // the polyhedron is a little smaller
  EXPECT_LT(invalid, 400);                                       // faces that are turned away are hardly chosen
  EXPECT_EQ(set.meshRadiance(0, kUp), (Vec3f{1, 1, 1}));
}

}  // namespace
}  // namespace encore
