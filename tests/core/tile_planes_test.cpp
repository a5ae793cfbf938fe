// Planes of tiles against planes of the whole image, at every size of the last column and row.
#include "core/film/tile_planes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "core/scene/error.h"

namespace encore {
namespace {

struct Grid {
  uint32_t width, height, tile_width, tile_height, pad;
};

void forTiles(const Grid& g, const std::function<void(PixelRect)>& f) {
  for (uint32_t y = 0; y < g.height; y += g.tile_height) {
    for (uint32_t x = 0; x < g.width; x += g.tile_width) {
      f({x, y, std::min(x + g.tile_width, g.width), std::min(y + g.tile_height, g.height)});
    }
  }
}

// What a tile adds to all that it reaches: not associative in float, so that the order shows.
void addTile(const Grid& g, PixelRect tile, const std::function<float&(uint32_t, uint32_t)>& at) {
  const uint32_t x0 = tile.x0 - std::min(tile.x0, g.pad), y0 = tile.y0 - std::min(tile.y0, g.pad);
  for (uint32_t y = y0; y < std::min(tile.y1 + g.pad, g.height); ++y) {
    for (uint32_t x = x0; x < std::min(tile.x1 + g.pad, g.width); ++x) {
      at(x, y) += 0.1f + 1.7f * float(tile.x0) + 0.3f * float(tile.y0) + 0.01f * float(x + y);
    }
  }
}

// True when every pixel comes once, with the whole image's sums.
bool matchesWholeImage(const Grid& g) {
  const float initial[] = {0.0f, 3.5f};
  std::vector<float> whole[2];
  std::vector<float> tiled[2];
  for (size_t plane = 0; plane < 2; ++plane) {
    whole[plane].assign(size_t(g.width) * g.height, initial[plane]);
    tiled[plane].assign(size_t(g.width) * g.height, -1.0f);
  }
  std::vector<uint32_t> set(size_t(g.width) * g.height);
  TilePlanes planes(g.width, g.height, g.pad, {initial[0], initial[1]});
  forTiles(g, [&](PixelRect tile) {
    planes.begin(tile);
    for (size_t plane = 0; plane < 2; ++plane) {
      addTile(g, tile, [&](uint32_t x, uint32_t y) -> float& { return planes.at(plane, x, y); });
      addTile(g, tile, [&](uint32_t x, uint32_t y) -> float& { return whole[plane][size_t(y) * g.width + x]; });
    }
    const PixelRect done = planes.finish();
    for (uint32_t y = done.y0; y < done.y1; ++y) {
      for (uint32_t x = done.x0; x < done.x1; ++x) {
        for (size_t plane = 0; plane < 2; ++plane) tiled[plane][size_t(y) * g.width + x] = planes.at(plane, x, y);
        ++set[size_t(y) * g.width + x];
      }
    }
  });
  return whole[0] == tiled[0] && whole[1] == tiled[1] &&
         std::all_of(set.begin(), set.end(), [](uint32_t times) { return times == 1; });
}

TEST(TilePlanes, AllSizesOfTheLastColumnAndRow) {
  for (const uint32_t pad : {0u, 1u, 2u, 3u, 7u, 8u}) {
    for (const uint32_t tile : {16u, 32u}) {
      for (uint32_t size = 1; size <= 2 * tile + 17; ++size) {
        for (const uint32_t other : {1u, 7u, 17u, 40u}) {
          ASSERT_TRUE(matchesWholeImage({size, other, tile, 16, pad})) << size << " x " << other << ", pad " << pad;
          ASSERT_TRUE(matchesWholeImage({other, size, 16, tile, pad})) << other << " x " << size << ", pad " << pad;
        }
      }
    }
  }
}

TEST(TilePlanes, AllCornersOfTwoSmallTiles) {
  for (uint32_t width = 30; width <= 52; ++width) {
    for (uint32_t height = 30; height <= 52; ++height) {
      ASSERT_TRUE(matchesWholeImage({width, height, 16, 16, 8})) << width << " x " << height;
    }
  }
}

TEST(TilePlanes, FinishedPixelsEndWhereLaterTilesReach) {
  TilePlanes planes(100, 60, 3, {0.0f});
  const auto finish = [&](PixelRect tile) {
    planes.begin(tile);
    const PixelRect r = planes.finish();
    return std::vector<uint32_t>{r.x0, r.y0, r.x1, r.y1};
  };
  EXPECT_EQ(finish({0, 0, 48, 48}), (std::vector<uint32_t>{0, 0, 45, 45}));
  EXPECT_EQ(finish({48, 0, 96, 48}), (std::vector<uint32_t>{45, 0, 93, 45}));
  EXPECT_EQ(finish({96, 0, 100, 48}), (std::vector<uint32_t>{93, 0, 100, 45}));
  EXPECT_EQ(finish({0, 48, 48, 60}), (std::vector<uint32_t>{0, 45, 45, 60}));
  EXPECT_EQ(finish({48, 48, 96, 60}), (std::vector<uint32_t>{45, 45, 93, 60}));
  EXPECT_EQ(finish({96, 48, 100, 60}), (std::vector<uint32_t>{93, 45, 100, 60}));
}

TEST(TilePlanes, TilesOutOfOrderAreErrors) {
  TilePlanes planes(100, 60, 8, {0.0f});
  EXPECT_THROW(planes.finish(), Error);
  EXPECT_THROW(planes.begin({16, 0, 32, 16}), Error);  // not the first
  EXPECT_THROW(planes.begin({0, 0, 15, 16}), Error);   // too narrow
  EXPECT_THROW(planes.begin({0, 0, 16, 15}), Error);   // too low
  EXPECT_THROW(planes.begin({0, 0, 0, 16}), Error);    // empty
  EXPECT_THROW(planes.begin({0, 0, 101, 16}), Error);  // beyond the image
  planes.begin({0, 0, 80, 32});
  EXPECT_THROW(planes.begin({80, 0, 100, 32}), Error);  // not finished
  planes.finish();
  EXPECT_THROW(planes.begin({0, 32, 80, 60}), Error);   // leaves out a tile
  EXPECT_THROW(planes.begin({80, 0, 100, 16}), Error);  // of another height
  planes.begin({80, 0, 100, 32});
  planes.finish();
  planes.begin({0, 32, 100, 60});
  planes.finish();
  EXPECT_THROW(planes.begin({0, 0, 80, 32}), Error);  // after the last
}

}  // namespace
}  // namespace encore
