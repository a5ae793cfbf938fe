#include "core/render/shading_rates.h"

#include <gtest/gtest.h>

namespace encore {
namespace {

// Two meshes, placed together twice.
Scene twoByTwo() {
  Scene scene;
  scene.meshes.resize(2);
  scene.prototypes = {{"/p", {0, 1}}};
  scene.instances.resize(2);
  return scene;
}

float rate(const ShadingRates& rates, Layer layer, uint32_t instance, uint32_t mesh) {
  Hit hit;
  hit.instance = instance;
  hit.mesh = mesh;
  return rates.of(layer, hit);
}

TEST(ShadingRates, AreTheFramesWithoutAnythingElse) {
  Settings settings;
  settings.shading_rate = 3;
  settings.shading_rate_refraction = 5;
  const Scene scene = twoByTwo();
  const ShadingRates rates(scene, settings);
  EXPECT_EQ(rate(rates, Layer::Direct, 0, 0), 3);
  EXPECT_EQ(rate(rates, Layer::Reflection, 1, 1), 3);
  EXPECT_EQ(rate(rates, Layer::Refraction, 1, 0), 5);
  EXPECT_EQ(rates.highest(Layer::Refraction), 5);
  EXPECT_FALSE(rates.vary(Layer::Direct));
}

TEST(ShadingRates, OfInstancesComeBeforeThoseOfMeshes) {
  Scene scene = twoByTwo();
  scene.meshes[1].shading_rate = {8, 0, 0.25f};
  scene.instances[1].shading_rate = {0.5f, 0, 0};
  const ShadingRates rates(scene, Settings{});
  EXPECT_EQ(rate(rates, Layer::Direct, 0, 0), 2);
  EXPECT_EQ(rate(rates, Layer::Direct, 0, 1), 8);
  EXPECT_EQ(rate(rates, Layer::Direct, 1, 0), 0.5f);
  EXPECT_EQ(rate(rates, Layer::Direct, 1, 1), 0.5f);
  EXPECT_EQ(rate(rates, Layer::Refraction, 1, 1), 0.25f);
  EXPECT_EQ(rates.highest(Layer::Direct), 8);
  EXPECT_EQ(rates.highest(Layer::Refraction), 2);
  EXPECT_TRUE(rates.vary(Layer::Direct));
  EXPECT_FALSE(rates.vary(Layer::Reflection));
}

// What no instance shows makes nobody trace more.
TEST(ShadingRates, OfMeshesThatAreNotPlacedDoNotCount) {
  Scene scene = twoByTwo();
  scene.meshes.emplace_back().shading_rate = {64, 64, 64};
  EXPECT_EQ(ShadingRates(scene, Settings{}).highest(Layer::Direct), 2);
}

}  // namespace
}  // namespace encore
