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
