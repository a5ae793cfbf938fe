// Planes of tiles against planes of the whole image, at every size of the last column and row.
#include "core/film/tile_planes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "core/scene/error.h"

namespace encore {
namespace {

struct Grid {
  int32_t width, height, tile_width, tile_height, pad;
  int32_t x0 = 0, y0 = 0;  // where it begins

  PixelRect area() const { return {x0, y0, x0 + width, y0 + height}; }
  size_t pixels() const { return size_t(width) * size_t(height); }
  size_t index(int32_t x, int32_t y) const { return size_t(y - y0) * size_t(width) + size_t(x - x0); }
};

void forTiles(const Grid& g, const std::function<void(PixelRect)>& f) {
  const PixelRect area = g.area();
  for (int32_t y = area.y0; y < area.y1; y += g.tile_height) {
    for (int32_t x = area.x0; x < area.x1; x += g.tile_width) {
      f({x, y, std::min(x + g.tile_width, area.x1), std::min(y + g.tile_height, area.y1)});
    }
  }
}

// What a tile adds to all that it reaches: not associative in float, so that the order shows.
void addTile(const Grid& g, PixelRect tile, const std::function<float&(int32_t, int32_t)>& at) {
  const PixelRect area = g.area();
  for (int32_t y = std::max(tile.y0 - g.pad, area.y0); y < std::min(tile.y1 + g.pad, area.y1); ++y) {
    for (int32_t x = std::max(tile.x0 - g.pad, area.x0); x < std::min(tile.x1 + g.pad, area.x1); ++x) {
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
    whole[plane].assign(g.pixels(), initial[plane]);
    tiled[plane].assign(g.pixels(), -1.0f);
  }
  std::vector<uint32_t> set(g.pixels());
  TilePlanes planes(g.area(), uint32_t(g.pad), {initial[0], initial[1]});
  forTiles(g, [&](PixelRect tile) {
    planes.begin(tile);
    for (size_t plane = 0; plane < 2; ++plane) {
      addTile(g, tile, [&](int32_t x, int32_t y) -> float& { return planes.at(plane, x, y); });
      addTile(g, tile, [&](int32_t x, int32_t y) -> float& { return whole[plane][g.index(x, y)]; });
    }
    const PixelRect done = planes.finish();
    for (int32_t y = done.y0; y < done.y1; ++y) {
      for (int32_t x = done.x0; x < done.x1; ++x) {
        for (size_t plane = 0; plane < 2; ++plane) tiled[plane][g.index(x, y)] = planes.at(plane, x, y);
        ++set[g.index(x, y)];
      }
    }
  });
  return whole[0] == tiled[0] && whole[1] == tiled[1] &&
         std::all_of(set.begin(), set.end(), [](uint32_t times) { return times == 1; });
}

TEST(TilePlanes, AllSizesOfTheLastColumnAndRow) {
  for (const int32_t pad : {0, 1, 2, 3, 7, 8}) {
    for (const int32_t tile : {16, 32}) {
      for (int32_t size = 1; size <= 2 * tile + 17; ++size) {
        for (const int32_t other : {1, 7, 17, 40}) {
          ASSERT_TRUE(matchesWholeImage({size, other, tile, 16, pad})) << size << " x " << other << ", pad " << pad;
          ASSERT_TRUE(matchesWholeImage({other, size, 16, tile, pad})) << other << " x " << size << ", pad " << pad;
        }
      }
    }
  }
}

TEST(TilePlanes, AllCornersOfTwoSmallTiles) {
  for (int32_t width = 30; width <= 52; ++width) {
    for (int32_t height = 30; height <= 52; ++height) {
      ASSERT_TRUE(matchesWholeImage({width, height, 16, 16, 8})) << width << " x " << height;
    }
  }
}

TEST(TilePlanes, AreasAnywhere) {
  for (const int32_t x0 : {-1000, -32, -5, 16}) {
    for (const int32_t y0 : {-48, -1, 7}) {
      ASSERT_TRUE(matchesWholeImage({70, 45, 32, 16, 8, x0, y0})) << x0 << ", " << y0;
      ASSERT_TRUE(matchesWholeImage({16, 100, 16, 32, 3, x0, y0})) << x0 << ", " << y0;
    }
  }
}

TEST(TilePlanes, FinishedPixelsEndWhereLaterTilesReach) {
  TilePlanes planes({0, 0, 100, 60}, 3, {0.0f});
  const auto finish = [&](PixelRect tile) {
    planes.begin(tile);
    const PixelRect r = planes.finish();
    return std::vector<int32_t>{r.x0, r.y0, r.x1, r.y1};
  };
  EXPECT_EQ(finish({0, 0, 48, 48}), (std::vector<int32_t>{0, 0, 45, 45}));
  EXPECT_EQ(finish({48, 0, 96, 48}), (std::vector<int32_t>{45, 0, 93, 45}));
  EXPECT_EQ(finish({96, 0, 100, 48}), (std::vector<int32_t>{93, 0, 100, 45}));
  EXPECT_EQ(finish({0, 48, 48, 60}), (std::vector<int32_t>{0, 45, 45, 60}));
  EXPECT_EQ(finish({48, 48, 96, 60}), (std::vector<int32_t>{45, 45, 93, 60}));
  EXPECT_EQ(finish({96, 48, 100, 60}), (std::vector<int32_t>{93, 45, 100, 60}));
}

TEST(TilePlanes, TilesOutOfOrderAreErrors) {
  TilePlanes planes({0, 0, 100, 60}, 8, {0.0f});
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
