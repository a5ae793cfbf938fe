// Solids that touch and overlap.
#include "core/path/interior.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/shade/bsdf.h"
#include "path_world.h"

namespace encore {
namespace {

using namespace test;

Solid solid(uint32_t instance, float ior, int32_t priority) { return {instance, 0, ior, priority}; }

TEST(Interior, HigherPrioritiesWin) {
  const Solid ice = solid(0, 1.31f, 2), water = solid(1, 1.33f, 1);
  Interior in;
  EXPECT_TRUE(in.empty());
  EXPECT_EQ(in.ior(), 1);
  EXPECT_TRUE(in.real(water, false));
  EXPECT_EQ(in.outside(water, false), 1);
  in.pass(water, false);
  EXPECT_EQ(in.ior(), 1.33f);
  EXPECT_TRUE(in.real(ice, false));
  EXPECT_EQ(in.outside(ice, false), 1.33f);
  in.pass(ice, false);
  EXPECT_EQ(in.ior(), 1.31f);
  EXPECT_FALSE(in.real(water, true));  // the water ends inside of the ice
  in.pass(water, true);
  EXPECT_EQ(in.ior(), 1.31f);
  EXPECT_FALSE(in.real(water, false));  // and begins again
  in.pass(water, false);
  EXPECT_TRUE(in.real(ice, true));
  EXPECT_EQ(in.outside(ice, true), 1.33f);
  in.pass(ice, true);
  EXPECT_EQ(in.ior(), 1.33f);
  EXPECT_EQ(in.outside(water, true), 1);
  in.pass(water, true);
  EXPECT_TRUE(in.empty());
}

TEST(Interior, OfEqualsTheOneEnteredLastWins) {
  const Solid a = solid(0, 1.2f, 0), b = solid(1, 1.4f, 0);
  Interior in;
  in.pass(a, false);
  EXPECT_TRUE(in.real(b, false));
  in.pass(b, false);
  EXPECT_EQ(in.ior(), 1.4f);
  EXPECT_FALSE(in.real(a, true));
  EXPECT_TRUE(in.real(b, true));
  EXPECT_EQ(in.outside(b, true), 1.2f);
  // A mesh may overlap itself.
  in.pass(b, false);
  in.pass(b, true);
  EXPECT_EQ(in.ior(), 1.4f);
}

TEST(Interior, SolidsThatWereNeverEnteredCountAsEnteredFirst) {
  const Solid room = solid(0, 1.3f, 1), ball = solid(1, 1.5f, 1), bubble = solid(2, 1, 0);
  Interior in;
  EXPECT_TRUE(in.real(room, true));
  EXPECT_EQ(in.outside(room, true), 1);
  in.pass(ball, false);
  EXPECT_FALSE(in.real(room, true));
  in.pass(room, true);  // nothing to forget
  EXPECT_EQ(in.ior(), 1.5f);
  in.pass(ball, true);
  in.pass(bubble, false);
  EXPECT_TRUE(in.real(room, true));
  EXPECT_EQ(in.outside(room, true), 1);
}

TEST(Interior, ForgetsTheFifth) {
  Interior in;
  for (uint32_t i = 0; i < 5; ++i) in.pass(solid(i, 1.1f + 0.1f * float(i), int32_t(i)), false);
  EXPECT_EQ(in.ior(), 1.1f + 0.1f * 3);
  for (uint32_t i = 5; i-- > 0;) in.pass(solid(i, 1, int32_t(i)), true);
  EXPECT_TRUE(in.empty());
}

// Slabs between planes of z, as (front, back, ior, priority), of which the rays go through all.
struct Slab {
  float front, back, ior;
  int32_t priority;
};
struct Seen {
  size_t through = 0;
  double worst = 0;               // distance from where Snell's law leads
  float lowest = 2, highest = 0;  // throughput times what the first interface reflects
};
// media: between the real interfaces, (z of the front, ior), from the camera on; the last one is the air behind.
Seen lookThrough(const std::vector<Slab>& slabs, const std::vector<std::pair<double, double>>& media,
                 uint32_t bounces) {
  World world;
  world.settings.max_bounces = bounces;
  for (const Slab& s : slabs) {
    Material m = glass(s.ior);
    m.dielectric_priority = s.priority;
    world.stage.scene.materials.push_back(m);
    world.stage.add(test::box({-50, -50, s.back}, {50, 50, s.front}), int32_t(world.stage.scene.materials.size() - 1));
  }
  const uint32_t target = world.stage.add(wall(-12, 100), kMatte);
  world.build();
  Batch batch = film(world, 8);
  follow(world, Layer::Refraction, batch);
  Seen seen;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const PathVertex& v = batch.vertices[i];
    if (!v.hit.valid() || v.hit.instance != target) continue;
    const Vec3d d = normalize(toDouble(direction(world, batch.first[i])));
    const double sine = std::sqrt(d.x * d.x + d.y * d.y);
    double radius = sine / -d.z * -media.front().first;
    for (size_t k = 0; k < media.size(); ++k) {
      const double inner = sine / media[k].second, end = k + 1 < media.size() ? media[k + 1].first : -12;
      radius += inner / std::sqrt(1 - inner * inner) * (media[k].first - end);
    }
    const Vec3d expected{d.x / sine * radius, d.y / sine * radius, -12};
    const double off = length(position(world, v) - expected);
    if (off > 0.02) continue;  // reflected on its way
    ++seen.through;
    seen.worst = std::max(seen.worst, off);
    const float first = 1 - fresnelDielectric(float(-d.z), float(media.front().second));
    seen.lowest = std::min(seen.lowest, v.throughput.x / first);
    seen.highest = std::max(seen.highest, v.throughput.x / first);
  }
  return seen;
}

// A tumbler's bottom: water that reaches into the glass refracts where the glass ends, and three bounces are enough.
TEST(NestedDielectrics, WaterInGlassRefractsExactly) {
  for (const bool water_first : {false, true}) {
    std::vector<Slab> slabs{{-3, -5, 1.5f, 2}, {-4.5f, -8, 1.33f, 1}};
    if (water_first) std::swap(slabs[0], slabs[1]);
    const Seen seen = lookThrough(slabs, {{-3, 1.5}, {-5, 1.33f}, {-8, 1}}, 3);
    EXPECT_GT(seen.through, 7000u);
    EXPECT_LT(seen.worst, 1e-4);
    EXPECT_NEAR(seen.lowest, 1, 1e-4);  // weights of chosen bounces cancel with their probability
    EXPECT_NEAR(seen.highest, 1, 1e-4);
  }
}

TEST(NestedDielectrics, TheOtherWayRoundTheGlassEndsEarlier) {
  const Seen seen = lookThrough({{-3, -5, 1.5f, 1}, {-4.5f, -8, 1.33f, 2}}, {{-3, 1.5}, {-4.5, 1.33f}, {-8, 1}}, 3);
  EXPECT_GT(seen.through, 7000u);
  EXPECT_LT(seen.worst, 1e-4);
}

TEST(NestedDielectrics, WhatIsInsideOfHigherPriorityIsNotThere) {
  const Seen seen = lookThrough({{-3, -8, 1.5f, 9}, {-4, -5, 2.2f, 1}, {-4.5f, -6, 1.1f, 3}}, {{-3, 1.5}, {-8, 1}}, 2);
  EXPECT_GT(seen.through, 7000u);
  EXPECT_LT(seen.worst, 1e-4);
}

TEST(NestedDielectrics, BubblesAreInsideOfWhatSurroundsThem) {
  const Seen seen =
      lookThrough({{-3, -9, 1.5f, 0}, {-5, -7, 1.0001f, 1}}, {{-3, 1.5}, {-5, 1.0001f}, {-7, 1.5}, {-9, 1}}, 4);
  EXPECT_GT(seen.through, 6500u);
  EXPECT_LT(seen.worst, 1e-4);
}

// The same medium on both sides: nothing happens, though it is an interface.
TEST(NestedDielectrics, EqualIorsMakeNoInterface) {
  const Seen seen = lookThrough({{-3, -6, 1.5f, 0}, {-5, -9, 1.5f, 0}}, {{-3, 1.5}, {-9, 1}}, 3);
  EXPECT_GT(seen.through, 7000u);
  EXPECT_LT(seen.worst, 1e-4);
}

TEST(NestedDielectrics, LayersAddUpToOneInAWhiteSky) {
  World world;
  world.settings.max_bounces = 200, world.settings.dome_light_visible = true;
  Material water = glass(1.33f), bubble = glass(1.05f);
  water.dielectric_priority = 1, bubble.dielectric_priority = 3;
  world.stage.scene.materials.push_back(water), world.stage.scene.materials.push_back(bubble);
  world.stage.add(test::sphere(24), kGlass, test::translation({0, 0, -3}));
  world.stage.add(test::sphere(16), 3, test::translation({0.6, 0, -3}));
  world.stage.add(test::sphere(12), 4, test::translation({0.3, 0.3, -2.6}) * test::scaling({0.4, 0.4, 0.4}));
  world.stage.scene.lights = {dome({1, 1, 1})};
  world.build();
  Batch batch = film(world, 32);
  std::vector<double> sums(batch.first.size());
  for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
    follow(world, layer, batch);
    for (size_t i = 0; i < sums.size(); ++i) sums[i] += double(batch.vertices[i].throughput.x);
  }
  double mean = 0, squares = 0;
  for (const double s : sums) mean += s, squares += s * s;
  const double n = double(sums.size());
  mean /= n;
  EXPECT_NEAR(mean, 1, 5 * std::sqrt(std::max(0.0, squares / n - mean * mean) / n) + 1e-3);
}

}  // namespace
}  // namespace encore
