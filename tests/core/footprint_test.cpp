#include "core/path/footprint.h"

#include <gtest/gtest.h>

#include "path_world.h"

namespace encore {
namespace {

using namespace test;

TEST(ReuseKey, TellsOctavesApart) {
  const SurfaceKey key{kOctaveInstances - 1, 99};
  const auto octave = [&](float r) {
    const SurfaceKey k = reuseKey(key, r, FootprintReuse::Octaves);
    EXPECT_EQ(k.instance & (kOctaveInstances - 1), key.instance);
    EXPECT_EQ(k.primitive_side, key.primitive_side);
    EXPECT_NE(k.instance, kNoInstance);
    return int(k.instance >> 26) - 56;
  };
  EXPECT_EQ(octave(1), 0);
  EXPECT_EQ(octave(1.999f), 0);
  EXPECT_EQ(octave(2), 1);
  EXPECT_EQ(octave(0.25f), -2);
  EXPECT_EQ(octave(0.2499f), -3);
  EXPECT_EQ(octave(1e30f), 6);
  EXPECT_EQ(octave(std::numeric_limits<float>::infinity()), 6);
  EXPECT_EQ(octave(1e-30f), -56);
  for (const float r : {0.0f, -1.0f, std::numeric_limits<float>::quiet_NaN()}) EXPECT_EQ(octave(r), -56);
}

TEST(ReuseKey, StaysAsItIsElsewhere) {
  for (const FootprintReuse reuse : {FootprintReuse::Ignore, FootprintReuse::Metric})
    EXPECT_EQ(reuseKey({5, 9}, 0.5f, reuse).instance, 5u);
  EXPECT_EQ(reuseKey({kNoInstance, 0}, 0.5f, FootprintReuse::Octaves).instance, kNoInstance);
}

// A wall 4 × 4 units wide, 5 away, at 32 pixels to 3 units: a pixel is 3 / 32 / 4 of its parameters.
TEST(Footprint, IsAPixelInParameters) {
  World world;
  world.stage.add(wall(-5, 2), kMatte);
  world.settings.max_reuse_distance = 1;
  world.build();
  Batch batch = film(world, 1);
  std::vector<float> footprint(batch.first.size());
  SampleOutputs out;
  out.footprint = footprint;
  EXPECT_EQ(tracePaths(world.context(), world.camera(), Layer::Direct, batch.first, batch.ends, batch.vertices, out),
            batch.first.size());
  for (size_t i = 0; i < footprint.size(); ++i) {
    EXPECT_NEAR(footprint[i], 3.0f / 32 / 4, 1e-6f);
    EXPECT_EQ(batch.vertices[i].footprint, footprint[i]);
  }
}

TEST(Footprint, IsLeftOutUnlessAskedFor) {
  World world;
  world.stage.add(wall(-5, 2), kMatte);
  world.build();
  EXPECT_FALSE(needsFootprints(world.settings));
  Batch batch = film(world, 1);
  follow(world, Layer::Direct, batch);
  for (const PathVertex& v : batch.vertices) EXPECT_EQ(v.footprint, 0);
}

TEST(Samples, AreThePathsValues) {
  World world;
  world.stage.add(box({-0.5f, -0.5f, -4}, {0.5f, 0.5f, -3}), kMirror, rotation({0, 0, 1}, 0.4));
  world.stage.add(wall(3, 50), kMatte);
  world.stage.scene.lights = {dome({1, 2, 3})};
  world.settings.footprint_reuse = FootprintReuse::Octaves;
  world.build();
  Batch batch = film(world, 2);
  for (const Layer layer : {Layer::Direct, Layer::Reflection}) {
    const size_t n = batch.first.size();
    std::vector<SurfaceKey> key(n);
    std::vector<Vec2f> uv(n);
    std::vector<Vec3f> throughput(n);
    std::vector<float> footprint(n, -1);
    const uint64_t on_surface = tracePaths(world.context(), world.camera(), layer, batch.first, batch.ends,
                                           batch.vertices, {key, uv, throughput, footprint, {}});
    uint64_t valid = 0;
    for (size_t i = 0; i < n; ++i) {
      const PathVertex& v = batch.vertices[i];
      valid += v.hit.valid();
      EXPECT_EQ(key[i].instance, v.key.instance);
      EXPECT_EQ(key[i].primitive_side, v.key.primitive_side);
      EXPECT_EQ(uv[i], v.uv);
      EXPECT_EQ(throughput[i], v.throughput);
      EXPECT_EQ(footprint[i], v.footprint);
      EXPECT_EQ(v.footprint > 0, v.hit.valid());
    }
    EXPECT_EQ(valid, on_surface);
    if (layer == Layer::Reflection) {
      EXPECT_GT(on_surface, 100u);
    }
  }
}

}  // namespace
}  // namespace encore
