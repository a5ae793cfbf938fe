#include "core/render/samples.h"

#include <gtest/gtest.h>

#include <map>
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

// Every tile of a window is one of the whole plane, and holds all of its blocks; what the filter reaches is rendered.
TEST(ReuseTiles, OfAWindowAreThoseOfThePlane) {
  Settings settings = frame(100, 70);
  settings.reuse_tile_pixels = 32;
  settings.filter_radius_pixels = 2.5f;  // reaches two pixels
  settings.window = {-70, -40, 180, 140};
  std::map<std::pair<int32_t, int32_t>, ReuseTile> plane;
  for (const ReuseTile& tile : reuseTiles(settings)) plane[{tile.rect.x0, tile.rect.y0}] = tile;
  EXPECT_EQ(plane.size(), (3u + 4u + 3u) * (2u + 3u + 3u));
  for (const Window window :
       {Window{0, 0, 100, 70}, {31, 33, 32, 34}, {-3, 66, 1, 71}, {95, -1, 110, 0}, {2, 2, 9, 9}}) {
    settings.window = window;
    const FilmArea area = filmArea(settings);
    std::set<std::pair<int32_t, int32_t>> rendered;
    for (const ReuseTile& tile : reuseTiles(settings)) {
      ASSERT_TRUE(plane.contains({tile.rect.x0, tile.rect.y0}));
      const ReuseTile& whole = plane[{tile.rect.x0, tile.rect.y0}];
      EXPECT_EQ(tile.rect.x1, whole.rect.x1);
      EXPECT_EQ(tile.rect.y1, whole.rect.y1);
      EXPECT_EQ(tile.blocks.size(), whole.blocks.size());
      EXPECT_FALSE(tile.rendered.empty());
      for (const BlockOrigin block : tile.rendered) rendered.insert({block.x, block.y});
      EXPECT_TRUE(tile.rect.x0 >= area.columns.front() && tile.rect.x1 <= area.columns.back());
      EXPECT_TRUE(tile.rect.y0 >= area.rows.front() && tile.rect.y1 <= area.rows.back());
    }
    // Blocks with a pixel that is at most two away from one of the window, on the same side of the image's borders.
    const auto side = [](int32_t at, int32_t size) { return at < 0 ? -1 : at < size ? 0 : 1; };
    std::set<std::pair<int32_t, int32_t>> expected;
    for (const auto& [at, tile] : plane)
      for (const BlockOrigin block : tile.blocks)
        for (int32_t y = block.y; y < std::min(block.y + 16, tile.rect.y1); ++y)
          for (int32_t x = block.x; x < std::min(block.x + 16, tile.rect.x1); ++x) {
            bool near = false;
            for (int32_t wy = std::max(y - 2, window.y0); wy <= std::min(y + 2, window.y1 - 1); ++wy)
              for (int32_t wx = std::max(x - 2, window.x0); wx <= std::min(x + 2, window.x1 - 1); ++wx)
                near |= side(x, 100) == side(wx, 100) && side(y, 70) == side(wy, 70);
            if (near) expected.insert({block.x, block.y});
          }
    EXPECT_EQ(rendered, expected) << window.x0 << ", " << window.y0;
  }
}

TEST(ReuseTiles, OfOverscanBeginAtTheImagesBorders) {
  Settings settings = frame(100, 70);
  settings.reuse_tile_pixels = 32;
  settings.filter_radius_pixels = 0.5f;
  settings.window = {-1, -1, 101, 71};
  EXPECT_EQ(filmArea(settings).columns, (std::vector<int32_t>{-32, 0, 100, 132}));
  EXPECT_EQ(filmArea(settings).rows, (std::vector<int32_t>{-32, 0, 70, 102}));
  settings.window = {40, 70, 50, 71};
  EXPECT_EQ(filmArea(settings).columns, (std::vector<int32_t>{32, 64}));
  EXPECT_EQ(filmArea(settings).rows, (std::vector<int32_t>{70, 102}));
}

// Seeds fill blocks of the overscan whole, and their keys are neither the image's nor those of nothing.
TEST(ShadingRays, OfOverscan) {
  const Settings settings = frame(21, 7);
  for (const BlockOrigin block : {BlockOrigin{-16, -16}, {21, 0}, {-32, 0}, {0, 7}, {21, 7}}) {
    const BlockRays rays = generateShadingRays(settings, std::span(&block, 1), 2);
    const bool in_row = block.y == 0;  // whose blocks end with the image
    EXPECT_EQ(rays.first.size(), shadingRayCount(settings, block, 2) * (in_row ? 7u : 16u) / 16u);
    for (const FirstHit& f : rays.first) {
      EXPECT_TRUE(f.active());
      EXPECT_GE(f.pixel, 0x80000000u);
      EXPECT_TRUE(f.film_x >= float(block.x) && f.film_x <= float(block.x + 16));
      EXPECT_TRUE(f.film_y >= float(block.y) && f.film_y <= float(block.y + (in_row ? 7 : 16)));
    }
  }
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
