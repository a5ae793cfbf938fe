#include "core/render/samples.h"

#include <gtest/gtest.h>

#include <set>

namespace encore {
namespace {

Settings frame(uint32_t width, uint32_t height) {
  Settings settings;
  settings.width = width;
  settings.height = height;
  return settings;
}

TEST(ReuseTiles, HoldEveryBlockOnce) {
  Settings settings = frame(1050, 700);
  settings.reuse_tile_pixels = 256;
  std::set<std::pair<uint32_t, uint32_t>> blocks;
  for (const ReuseTile& tile : reuseTiles(settings))
    for (const BlockOrigin block : tile.blocks) {
      EXPECT_TRUE(blocks.insert({block.x, block.y}).second);
      EXPECT_EQ(block.x / 256, tile.blocks[0].x / 256);
      EXPECT_EQ(block.y / 256, tile.blocks[0].y / 256);
    }
  EXPECT_EQ(blocks.size(), 66u * 44u);
}

TEST(ShadingRays, AreAsManyAsTheRateAsks) {
  for (const float rate : {0.01f, 0.25f, 1.0f, 2.0f, 3.7f}) {
    Settings settings = frame(512, 512);
    settings.shading_rate = rate;
    settings.reuse_tile_pixels = 512;
    const BlockRays rays = generateShadingRays(settings, reuseTiles(settings)[0].blocks);
    const double expected = 512.0 * 512.0 * double(rate);
    EXPECT_NEAR(double(rays.first.size()), expected, 3 * std::sqrt(1024.0)) << rate;
    EXPECT_EQ(rays.ends.back(), rays.first.size());
  }
}

// 512 points of a (0, 2)-sequence over 16 × 16 pixels put exactly two into every pixel.
TEST(ShadingRays, AreStratifiedOverPixels) {
  Settings settings = frame(64, 48);
  settings.shading_rate = 2;
  const BlockRays rays = generateShadingRays(settings, reuseTiles(settings)[0].blocks);
  std::vector<int> count(64 * 48);
  for (const FirstHit& f : rays.first) ++count[size_t(f.film_y) * 64 + size_t(f.film_x)];
  for (const int c : count) EXPECT_EQ(c, 2);
}

TEST(ShadingRays, OfALowerRateAreAmongThoseOfAHigher) {
  Settings low = frame(32, 32), high = frame(32, 32);
  low.shading_rate = 0.5f;
  high.shading_rate = 4;
  const auto tile = reuseTiles(low)[0];
  std::set<std::pair<float, float>> points;
  for (const FirstHit& f : generateShadingRays(high, tile.blocks).first) points.insert({f.film_x, f.film_y});
  for (const FirstHit& f : generateShadingRays(low, tile.blocks).first)
    EXPECT_TRUE(points.contains({f.film_x, f.film_y}));
}

TEST(ShadingRays, DoNotLeaveTheImage) {
  const Settings settings = frame(21, 7);
  for (const FirstHit& f : generateShadingRays(settings, reuseTiles(settings)[0].blocks).first) {
    EXPECT_LT(f.film_x, 21.0f);
    EXPECT_LT(f.film_y, 7.0f);
  }
}

TEST(AntialiasRays, AreJitteredInTheirStrata) {
  Settings settings = frame(37, 21);
  settings.samples = 5;
  const auto blocks = reuseTiles(settings)[0].blocks;
  std::vector<uint32_t> position(blocks.size() * kBlockArea * 25);
  const BlockRays rays = generateAntialiasRays(settings, blocks, position);
  ASSERT_EQ(rays.first.size(), position.size());
  ASSERT_EQ(rays.ends.size(), blocks.size());
  size_t active = 0;
  for (size_t i = 0; i < rays.first.size(); ++i) {
    const FirstHit& f = rays.first[i];
    const uint32_t pixel = uint32_t(i / 25 % kBlockArea), block = uint32_t(i / 25 / kBlockArea);
    const float x = float(blocks[block].x + pixel % kBlockPixels), y = float(blocks[block].y + pixel / kBlockPixels);
    EXPECT_EQ(f.active, x < 37 && y < 21);
    active += f.active;
    EXPECT_EQ(f.film_x, x + float(position[i] & 0xffff) * 0x1p-16f);
    EXPECT_EQ(f.film_y, y + float(position[i] >> 16) * 0x1p-16f);
    const uint32_t s = uint32_t(i % 25);
    EXPECT_NEAR((f.film_x - x) * 5, float(s % 5) + 0.5f, 0.5f + 1e-3f);
    EXPECT_NEAR((f.film_y - y) * 5, float(s / 5) + 0.5f, 0.5f + 1e-3f);
  }
  EXPECT_EQ(active, size_t(37) * 21 * 25);
}

}  // namespace
}  // namespace encore
