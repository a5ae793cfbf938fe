// Which lights get how many rays, and what a cone and a focus leave of them.
#include "core/shade/light_choice.h"

#include <gtest/gtest.h>

#include "core/shade/light_shaping.h"
#include "light_kinds.h"
#include "shade_world.h"
#include "shapes.h"

namespace encore {
namespace {

const Vec3f kUp{0, 0, 1};

TEST(Shaping, FormulasOfTheSpecification) {
  Light light;
  light.shaping_axis = {0, 0, -1};
  light.focus = 3, light.focus_tint = {0.5f, 0, 0};
  EXPECT_EQ(shapingFactor(light, kUp), (Vec3f{1, 1, 1}));  // not shaped
  light.shaped = true, light.cone_angle_radians = kPi;
  const float c = std::cos(0.6f), f = c * c * c;
  const auto at = [&](float angle) { return shapingFactor(light, {std::sin(angle), 0, -std::cos(angle)}); };
  EXPECT_NEAR(at(0.6f).x, f + (1 - f) * 0.5f, 1e-5);
  EXPECT_NEAR(at(0.6f).y, f, 1e-5);
  EXPECT_NEAR(at(kPi - 0.6f).y, f, 1e-5);  // the absolute value of the cosine
  light.focus = -2;                        // ignored
  EXPECT_EQ(at(0.6f), (Vec3f{1, 1, 1}));
  light.focus = 0, light.cone_angle_radians = 1;
  EXPECT_EQ(at(0.99f).x, 1);
  EXPECT_EQ(at(1.01f).x, 0);
  light.cone_softness = 0.5f;  // from half the angle on
  EXPECT_EQ(at(0.49f).x, 1);
  EXPECT_NEAR(at(0.75f).x, 0.5f, 1e-5);
  EXPECT_NEAR(at(0.625f).x, 1 - (3 / 16.0f - 2 / 64.0f), 1e-5);
  EXPECT_EQ(at(1.01f).x, 0);
}

TEST(Shaping, BoundsHold) {
  test::Stream stream(3);
  for (int i = 0; i < 200; ++i) {
    Light light;
    light.shaped = true, light.shaping_axis = stream.onSphere();
    light.focus = i % 3 ? stream.next(0, 8) : 0, light.focus_tint = {stream.next(), stream.next(0, 2), 0};
    light.cone_angle_radians = stream.next(0, kPi), light.cone_softness = stream.next();
    const Vec3f axis = stream.onSphere();
    const float half = stream.next(0, 1.5f);
    const float bound = shapingBound(light, axis, half);
    for (int k = 0; k < 50; ++k) {
      const float angle = stream.next(0, half), around = stream.next(0, 7);
      const Vec3f d = Basis(axis).toWorld(
          {std::sin(angle) * std::cos(around), std::sin(angle) * std::sin(around), std::cos(angle)});
      EXPECT_LE(maxComponent(shapingFactor(light, normalize(d))), bound + 1e-4f);
    }
  }
}

// Many lights of every kind, here and there; some are dark at the origin.
void addManyLights(Scene& scene, uint32_t count) {
  test::Stream stream(8);
  const auto kinds = test::lightsOfEveryKind();
  while (scene.lights.size() < count) {
    Light light = kinds[stream.index(uint32_t(kinds.size()) - 1)].light;
    light.centre = light.centre + toDouble(stream.inCube(6)) + Vec3d{0, 0, 3};
    light.direction = stream.onSphere();
    const float bright = std::pow(10.0f, stream.next(-1, 1));
    light.radiance = Vec3f{stream.next(), stream.next(), stream.next()} * bright;
    if (stream.next() < 0.2f)
      light.shaped = true, light.shaping_axis = {0, 0, -1}, light.cone_angle_radians = 1, light.focus = 1;
    scene.lights.push_back(light);
  }
}

TEST(LightChoice, NeverLeavesOutWhatContributes) {
  test::Stage stage;
  addManyLights(stage.scene, 120);
  const TraceScene trace(stage.scene, stage.diced);
  Settings settings;
  const LightSet set(stage.scene, settings, trace);
  EXPECT_TRUE(set.chooses());
  test::Stream stream(1);
  int dark = 0;
  for (int i = 0; i < 40; ++i) {
    const Vec3f p = stream.inCube(4), n = stream.onSphere();
    for (const PreparedLight& light : set.lights()) {
      const float importance = lightImportance(light, p, n);
      dark += importance == 0;
      if (importance > 0) continue;
      const LightSampler sampler(*light.light, p, n);
      for (uint32_t k = 0; k < 200; ++k) {
        const LightSample s = sampler.sample(sobol2(k, uint32_t(i)));
        EXPECT_FALSE(s.valid && s.radiance != Vec3f{} && dot(s.direction, n) > 1e-5f) << int(light.light->kind);
      }
    }
  }
  EXPECT_GT(dark, 100);
}

TEST(LightChoice, CountsAreTheirExpectationsRounded) {
  test::Stage stage;
  addManyLights(stage.scene, 60);
  stage.scene.lights[7].samples = 5;  // keeps them
  stage.scene.lights[8].kind = Light::Kind::Dome;
  stage.scene.lights[9].lit_groups = {0, 1};
  const TraceScene trace(stage.scene, stage.diced);
  Settings settings;
  settings.most_light_samples = 100;
  const LightSet set(stage.scene, settings, trace);
  LightChoice choice(set, settings);
  std::vector<double> mean(60);
  constexpr int kTimes = 512;
  for (int i = 0; i < kTimes; ++i) {
    const auto rays = choice.choose({0, 0, 0}, kUp, 0, float(i) / kTimes);
    uint32_t sum = 0;
    for (size_t k = 0; k < 60; ++k) {
      if (k == 7 || k == 8) continue;
      EXPECT_GE(rays[k].count, uint32_t(std::floor(rays[k].expected))) << k;
      EXPECT_LE(rays[k].count, uint32_t(std::ceil(rays[k].expected))) << k;
      EXPECT_EQ(rays[k].first, rays[k].count ? sum : rays[k].first);
      sum += rays[k].count;
      mean[k] += rays[k].count / double(kTimes);
    }
    EXPECT_EQ(sum, 100u);
    EXPECT_EQ(rays[7].count, 5u);
    EXPECT_EQ(rays[8].count, settings.occlusion_samples);
    EXPECT_EQ(rays[9].count, 0u);  // not linked to group 0
  }
  EXPECT_EQ(choice.choose({0, 0, 0}, kUp, 1, 0)[9].expected > 0, lightImportance(set.lights()[9], {0, 0, 0}, kUp) > 0);
  const auto rays = choice.choose({0, 0, 0}, kUp, 0, 0);
  for (size_t k = 0; k < 60; ++k) {
    if (k == 7 || k == 8) continue;
    EXPECT_NEAR(mean[k], rays[k].expected, 2.0 / kTimes) << k;
  }
}

// The same scene with all of the rays and with a few: the means agree, and importance is quieter than chance.
TEST(LightChoice, ExpectationIsTheSum) {
  test::ShadeWorld world;
  world.material().ior.value = 1.5f;
  world.material().roughness.value = 0.6f;  // a rough lobe as well
  world.addGround();
  world.stage.add(test::sphere(6), 0, test::translation({2, 1.5, 1}));
  addManyLights(world.stage.scene, 80);
  const Vec3f from{0.3f, -0.2f, 0.9f}, down{0.2f, 0, -1};
  world.settings.light_samples = 4;
  world.settings.most_light_samples = 1000;
  const auto spread = [&](Vec3d& mean) {
    std::vector<PathVertex> vertices;
    constexpr uint32_t kCount = 1500;
    for (uint32_t i = 0; i < kCount; ++i) vertices.push_back(world.vertex(from, down, 0, i));
    const std::vector<Vec3f> r = world.shadeAll(vertices, {kCount});
    double squares = 0;
    for (const Vec3f v : r) mean = mean + toDouble(v) / kCount, squares += double(v.y) * double(v.y) / kCount;
    return squares - mean.y * mean.y;
  };
  Vec3d all, few;
  spread(all);
  world.settings.most_light_samples = 16;
  const double variance = spread(few);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(few[k] / all[k], 1, 0.02) << k;
  // Chance: one light of all, evenly, 16 times. Its variance from the lights' own sums.
  std::vector<double> sums;
  const std::vector<Light> lights = world.stage.scene.lights;
  world.settings.most_light_samples = 1000;
  for (const Light& light : lights) {
    world.stage.scene.lights = {light};
    Vec3d one;
    spread(one);
    sums.push_back(one.y);
  }
  double mean = 0, squares = 0;
  for (const double s : sums) mean += s / double(sums.size()), squares += s * s / double(sums.size());
  const double by_chance = (squares - mean * mean) * double(sums.size() * sums.size()) / 16;
  EXPECT_LT(variance, 0.25 * by_chance);
}

}  // namespace
}  // namespace encore
