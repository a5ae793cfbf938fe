#include "core/path/differentials.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "path_world.h"

namespace encore {
namespace {

using namespace test;

TEST(Differentials, FormulasAgreeWithFiniteDifferences) {
  Stream stream(6);
  const auto refract = [](Vec3d d, Vec3d n, double eta) {
    const double c = -dot(d, n);
    return d / eta + n * (c / eta - std::sqrt(1 - (1 - c * c) / (eta * eta)));
  };
  for (int i = 0; i < 500; ++i) {
    const Vec3d n = toDouble(stream.onSphere()), d = normalize(toDouble(stream.onSphere()) * 0.9 - n);
    const Vec3d dn_any = toDouble(stream.onSphere()), dd_any = toDouble(stream.onSphere());
    const Vec3d dn = dn_any - n * dot(n, dn_any), dd = dd_any - d * dot(d, dd_any);  // unit vectors stay unit
    const double eta = double(stream.next(1.1f, 2)), h = 1e-5;
    const auto at = [&](double s, bool reflect) {
      const Vec3d di = normalize(d + dd * s), ni = normalize(n + dn * s);
      return reflect ? di - ni * (2 * dot(di, ni)) : refract(di, ni, eta);
    };
    const Vec3d reflected = (at(h, true) - at(-h, true)) / (2 * h),
                refracted = (at(h, false) - at(-h, false)) / (2 * h);
    const Vec3f df = toFloat(d), nf = toFloat(n), ddf = toFloat(dd), dnf = toFloat(dn);
    EXPECT_LT(length(toDouble(reflectDifferential(df, nf, ddf, dnf)) - reflected), 1e-5);
    EXPECT_LT(
        length(toDouble(refractDifferential(df, toFloat(refract(d, n, eta)), nf, float(eta), ddf, dnf)) - refracted),
        1e-4);
    // A plane through the ray's end.
    const Vec3d o{1, 2, 3}, dp = toDouble(stream.onSphere());
    const auto meet = [&](double s) {
      const Vec3d di = normalize(d + dd * s), oi = o + dp * s;
      return oi + di * (dot(o + d * 4 - oi, n) / dot(di, n));
    };
    const Vec3d moved = (meet(h) - meet(-h)) / (2 * h);
    EXPECT_LT(length(toDouble(transferDifferential(toFloat(dp), ddf, 4, df, nf)) - moved), 1e-5 * (1 + length(moved)));
  }
}

TEST(Differentials, AreLimited) {
  const float inf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(limited({1, inf, 0}, 5), Vec3f{});
  EXPECT_EQ(limited({std::nanf(""), 1, 0}, 5), Vec3f{});
  EXPECT_EQ(limited({3, 4, 0}, 5), (Vec3f{3, 4, 0}));
  EXPECT_NEAR(length(limited({3e30f, -3e30f, 1e30f}, 5)), 5, 1e-4);
  EXPECT_EQ(limited({1, 2, 3}, 0), Vec3f{});
}

struct FootprintErrors {
  size_t compared = 0;
  double median = 0, high = 0;  // relative; high: the 90th percentile
};

// dpdx and dpdy against where the same path ends for film points beside it.
FootprintErrors footprintErrors(World& world, Layer layer, uint32_t target) {
  const float h = 0.01f;
  Batch batch;
  Stream stream(15);
  for (uint32_t i = 0; i < 1500; ++i) {
    const float x = stream.next(1, 31), y = stream.next(1, 31);
    for (const Vec2f offset : {Vec2f{0, 0}, {h, 0}, {-h, 0}, {0, h}, {0, -h}})
      batch.first.push_back(filmPoint(x + offset.x, y + offset.y, i, 0));
  }
  batch.ends = {uint32_t(batch.first.size())};
  batch.vertices.resize(batch.first.size());
  traceFirstHits(world.context(), world.camera(), batch.first, batch.ends);
  follow(world, layer, batch);
  std::vector<double> errors;
  for (size_t i = 0; i < batch.vertices.size(); i += 5) {
    const PathVertex* v = &batch.vertices[i];
    if (std::any_of(v, v + 5, [&](const PathVertex& p) { return p.hit.instance != target; })) continue;
    const Vec3d dx = (position(world, v[1]) - position(world, v[2])) / (2 * double(h));
    const Vec3d dy = (position(world, v[3]) - position(world, v[4])) / (2 * double(h));
    const double size = std::max(length(dx), length(dy));
    errors.push_back(length(toDouble(v->dpdx) - dx) / size);
    errors.push_back(length(toDouble(v->dpdy) - dy) / size);
  }
  FootprintErrors result;
  result.compared = errors.size();
  if (errors.empty()) return result;
  std::sort(errors.begin(), errors.end());
  result.median = errors[errors.size() / 2], result.high = errors[errors.size() * 9 / 10];
  return result;
}

void expectAccurate(const FootprintErrors& errors, double median, double high) {
  EXPECT_GT(errors.compared, 800u);
  EXPECT_LT(errors.median, median);
  EXPECT_LT(errors.high, high);
}

TEST(Differentials, FootprintOnASlantedWall) {
  World world;
  const uint32_t target = world.stage.add(wall(-5, 50), kMatte, test::rotation({0, 1, 0}, 0.9));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Direct, target), 2e-3, 5e-3);
}

TEST(Differentials, FootprintInAPlaneMirror) {
  World world;
  world.stage.add(wall(-5, 50), kMirror, test::rotation({0, 1, 0}, 0.4));
  const uint32_t target = world.stage.add(wall(-8, 100), kMatte, test::rotation({0, 1, 0}, 3.0));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Reflection, target), 2e-3, 5e-3);
}

TEST(Differentials, FootprintInAMirrorBall) {
  World world;
  world.stage.add(test::sphere(60), kMirror, test::translation({0, 0, -4}) * test::scaling({0.9, 0.9, -0.9}));
  const uint32_t target =
      world.stage.add(test::sphere(10), kMatte, test::translation({0, 0, -4}) * test::scaling({30, 30, 30}));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Reflection, target), 1e-2, 5e-2);
}

TEST(Differentials, FootprintThroughASlab) {
  World world;
  world.settings.max_bounces = 2;
  world.stage.add(test::box({-50, -50, -5}, {50, 50, -3}), kGlass, test::rotation({0, 1, 0}, 0.3));
  const uint32_t target = world.stage.add(wall(-9, 100), kMatte);
  world.build();
  expectAccurate(footprintErrors(world, Layer::Refraction, target), 5e-3, 2e-2);
}

TEST(Differentials, FootprintThroughAGlassBall) {
  World world;
  world.settings.max_bounces = 2;
  world.stage.add(test::sphere(60), kGlass, test::translation({0, 0, -4}));
  const uint32_t target = world.stage.add(wall(-9, 100), kMatte);
  world.build();
  expectAccurate(footprintErrors(world, Layer::Refraction, target), 2e-2, 1e-1);
}

// A magnifying glass: what the camera's lens sees through a ball, lens point and all.
TEST(Differentials, FootprintThroughAMagnifierAndALens) {
  for (const bool orthographic : {false, true}) {
    World world;
    world.settings.max_bounces = 2;
    Camera& camera = world.stage.scene.camera;
    camera.lens_radius = 0.1f, camera.focus_distance = 5;
    if (orthographic) camera.projection = Camera::Projection::Orthographic, camera.half_tangent = {1.2f, 1.2f};
    world.stage.add(test::sphere(60), kGlass, test::translation({0, 0, -4}));
    const uint32_t target = world.stage.add(wall(-6, 100), kMatte);
    world.build();
    expectAccurate(footprintErrors(world, Layer::Refraction, target), 2e-2, 1e-1);
  }
}

TEST(Differentials, FootprintOfAnOrthographicCamera) {
  World world;
  Camera& camera = world.stage.scene.camera;
  camera.projection = Camera::Projection::Orthographic, camera.half_tangent = {2, 2};
  const uint32_t target = world.stage.add(wall(-5, 50), kMatte, test::rotation({0, 1, 0}, 0.9));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Direct, target), 2e-3, 5e-3);
}

// A sheet passes footprints straight on.
TEST(Differentials, FootprintThroughAThinSheet) {
  World world;
  world.settings.max_bounces = 1;
  world.stage.add(wall(-3, 50), kGlass, test::rotation({0, 1, 0}, 0.5));
  world.stage.scene.meshes[0].thin_walled = true;
  const uint32_t target = world.stage.add(wall(-9, 100), kMatte);
  world.build();
  Batch batch = film(world, 4);
  follow(world, Layer::Refraction, batch);
  size_t through = 0;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const PathVertex& v = batch.vertices[i];
    if (!v.hit.valid()) continue;
    EXPECT_EQ(v.hit.instance, target);
    EXPECT_LT(length(v.direction - direction(world, batch.first[i])), 1e-6f);
    ++through;
  }
  EXPECT_EQ(through, batch.vertices.size());
  expectAccurate(footprintErrors(world, Layer::Refraction, target), 5e-3, 2e-2);
}

// Widths add in squares along the principal axes, and nothing else changes.
TEST(Differentials, RoughLobesWidenSpreads) {
  Stream stream(4);
  for (int i = 0; i < 300; ++i) {
    const Vec3f d = stream.onSphere();
    const auto across = [&] {
      const Vec3f v = stream.inCube(1);
      return v - d * dot(v, d);
    };
    const Spread spread{across() * 0.1f, i % 3 ? across() * 0.01f : Vec3f{}};
    const float width = stream.next(0, 0.2f);
    const Spread wide = widened(spread, d, width);
    // A Aᵀ grows by width² times the identity.
    const Basis basis(d);
    const auto square = [&](const Spread& s, Vec3f p, Vec3f q) {
      return double(dot(s.x, p)) * double(dot(s.x, q)) + double(dot(s.y, p)) * double(dot(s.y, q));
    };
    const double w2 = double(width) * double(width);
    EXPECT_NEAR(square(wide, basis.t, basis.t), square(spread, basis.t, basis.t) + w2, 1e-6);
    EXPECT_NEAR(square(wide, basis.b, basis.b), square(spread, basis.b, basis.b) + w2, 1e-6);
    EXPECT_NEAR(square(wide, basis.t, basis.b), square(spread, basis.t, basis.b), 1e-6);
    EXPECT_NEAR(dot(wide.x, d), 0, 1e-6);
    // Aᵀ A keeps its axes: without a width, all stays.
    const Spread same = widened(spread, d, 1e-7f);
    EXPECT_LT(length(same.x - spread.x) + length(same.y - spread.y), 1e-5f);
    EXPECT_EQ(widened(spread, d, 0).x, spread.x);
  }
  EXPECT_NEAR(length(widened({}, {0, 0, 1}, 0.3f).x), 0.3, 1e-6);
}

// In a rough mirror a sample stands for its part of the lobe: the footprint is that wide, and no wider.
TEST(Differentials, FootprintInARoughMirrorIsItsPartOfTheLobe) {
  World world;
  Material rough = mirror();
  rough.roughness = {0.3f};
  world.stage.scene.materials[kMirror] = rough;
  world.settings.roughness_limit = 0.5f;
  DicedMesh back;
  test::addQuad(back, {90, -90, 5}, {-90, -90, 5}, {-90, 90, 5}, {90, 90, 5});
  world.stage.add(wall(-5, 50), kMirror);
  const uint32_t target = world.stage.add(back, kMatte);
  world.build();
  Batch batch = film(world, 4);
  std::vector<double> sizes[2];
  for (const uint32_t samples : {2u, 8u}) {
    world.settings.samples = samples;
    follow(world, Layer::Reflection, batch);
    for (const PathVertex& v : batch.vertices)
      if (v.hit.valid() && v.hit.instance == target && v.direction.z > 0.98f)
        sizes[samples == 8].push_back(std::sqrt(double(length(cross(v.dpdx, v.dpdy)))));
  }
  ASSERT_GT(sizes[0].size(), 500u);
  // Five units to the mirror, ten back from it. A half-angle of alpha would be the lobe's, were it that of a cone.
  const double width = 2 * std::sqrt(M_PI) * 0.09, pixel = 0.6 / 32;
  const double expected = 5 * pixel + 10 * std::hypot(pixel, width / 2);
  double mean[2] = {0, 0};
  for (int k : {0, 1}) {
    for (const double s : sizes[k]) mean[k] += s;
    mean[k] /= double(sizes[k].size());
  }
  EXPECT_NEAR(mean[0], expected, 0.05 * expected);
  EXPECT_GT(mean[0] / mean[1], 2);
  EXPECT_LT(mean[0] / mean[1], 4);
}

TEST(Differentials, StayFiniteInAHallOfMirrorBalls) {
  World world;
  Stream stream(8);
  for (int i = 0; i < 20; ++i)
    world.stage.add(test::sphere(6), i % 2 ? kMirror : kGlass,
                    test::translation({stream.next(-1, 1), stream.next(-1, 1), stream.next(-5, -2)}) *
                        test::scaling({0.3, 0.3, 0.3}));
  world.stage.add(test::sphere(10), kMatte, test::scaling({20, 20, 20}));
  world.settings.max_bounces = 30;
  world.build();
  Batch batch = film(world, 8);
  size_t deep = 0;
  for (const Layer layer : {Layer::Reflection, Layer::Refraction}) {
    follow(world, layer, batch);
    for (const PathVertex& v : batch.vertices) {
      if (!v.hit.valid()) continue;
      ++deep;
      EXPECT_TRUE(isFinite(v.dpdx) && isFinite(v.dpdy));
      EXPECT_LE(length(v.dpdx), world.trace->diagonal() * 1.001f);
    }
  }
  EXPECT_GT(deep, 1000u);
}

}  // namespace
}  // namespace encore
