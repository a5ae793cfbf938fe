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
      EXPECT_TRUE(block.x >= tile.rect.x0 && block.x < tile.rect.x1 && block.y >= tile.rect.y0 &&
                  block.y < tile.rect.y1);
    }
  EXPECT_EQ(blocks.size(), 66u * 44u);
}

TEST(ShadingRays, AreAsManyAsTheRateAsks) {
  for (const float rate : {0.01f, 0.25f, 1.0f, 2.0f, 3.7f}) {
    Settings settings = frame(512, 512);
    settings.reuse_tile_pixels = 512;
    const BlockRays rays = generateShadingRays(settings, reuseTiles(settings)[0].blocks, rate);
    const double expected = 512.0 * 512.0 * double(rate);
    EXPECT_NEAR(double(rays.first.size()), expected, 3 * std::sqrt(1024.0)) << rate;
    EXPECT_EQ(rays.ends.back(), rays.first.size());
  }
}

// 512 points of a (0, 2)-sequence over 16 × 16 pixels put exactly two into every pixel.
TEST(ShadingRays, AreStratifiedOverPixels) {
  Settings settings = frame(64, 48);
  const BlockRays rays = generateShadingRays(settings, reuseTiles(settings)[0].blocks, 2);
  std::vector<int> count(64 * 48);
  for (const FirstHit& f : rays.first) ++count[size_t(f.film_y) * 64 + size_t(f.film_x)];
  for (const int c : count) EXPECT_EQ(c, 2);
}

// A primitive of a lower rate keeps the points below its own count: they are the lower rate's points.
TEST(ShadingRays, OfALowerRateAreTheFirstOfAHigher) {
  const Settings settings = frame(32, 32);
  const auto blocks = reuseTiles(settings)[0].blocks;
  for (const float low : {0.003f, 0.25f, 0.5f, 1.7f, 4.0f}) {
    const BlockRays some = generateShadingRays(settings, blocks, low), all = generateShadingRays(settings, blocks, 4);
    std::vector<std::pair<float, float>> expected, kept;
    for (const FirstHit& f : some.first) expected.emplace_back(f.film_x, f.film_y);
    size_t i = 0;
    for (size_t b = 0; b < blocks.size(); ++b)
      for (; i < all.ends[b]; ++i)
        if (all.first[i].sample < shadingRayCount(settings, blocks[b], low))
          kept.emplace_back(all.first[i].film_x, all.first[i].film_y);
    EXPECT_EQ(kept, expected) << low;
  }
}

TEST(ShadingRays, DoNotLeaveTheImage) {
  const Settings settings = frame(21, 7);
  for (const FirstHit& f : generateShadingRays(settings, reuseTiles(settings)[0].blocks, 2).first) {
    EXPECT_LT(f.film_x, 21.0f);
    EXPECT_LT(f.film_y, 7.0f);
  }
}

}  // namespace
}  // namespace encore
