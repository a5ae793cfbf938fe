// Debug images: how shading was spent, against the twin.
#include <gtest/gtest.h>

#include <cmath>

#include "core/scene/error.h"
#include "tests/core/film_samples.h"

namespace encore {
namespace {

constexpr uint32_t kShadingSamples = 40;

using FilmDebugTest = FilmTest;

struct SearchSamples {
  FrameSamples frame;
  std::vector<uint32_t> shade;  // per slot
  std::vector<Vec2f> aa_uv;
  std::vector<Vec2f> uv;  // per shading sample
};

SearchSamples makeSearch(uint32_t width, uint32_t height, uint32_t samples_per_pixel) {
  SearchSamples s{makeSamples(width, height, samples_per_pixel, 2, 32, 16), {}, {}, {}};
  for (uint32_t i = 0; i < kShadingSamples; ++i) s.uv.push_back({randomUnit(i, 1), randomUnit(i, 2)});
  for (uint32_t i = 0; i < s.frame.slots(); ++i) {
    const float kind = randomUnit(i, 3);
    s.shade.push_back(kind < 0.3f   ? kShadeNone
                      : kind < 0.6f ? kShadeNotFound
                                    : uint32_t(randomUnit(i, 4) * kShadingSamples));
    if (i / samples_per_pixel % 5 == 0) s.shade.back() = kShadeNone;      // pixels without a surface
    if (i / samples_per_pixel % 5 == 1) s.shade.back() = kShadeNotFound;  // and without a neighbour
    if (!s.frame.inside(i)) s.shade.back() = 12345;
    s.aa_uv.push_back({randomUnit(i, 5), randomUnit(i, 6)});
  }
  return s;
}

// As shaders/film/search_debug.comp has it.
Vec3f falseColor(uint32_t id) {
  uint32_t h = id + 1;
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  h ^= h >> 16;
  return Vec3f{float((h & 255) + 1), float((h >> 8 & 255) + 1), float((h >> 16 & 255) + 1)} * (1 / 256.0f);
}

struct PixelSearch {
  double surface = 0, failed = 0, distance = 0;
  Vec3d id;
};

std::vector<PixelSearch> twinSearch(const SearchSamples& s) {
  std::vector<PixelSearch> pixels(size_t(s.frame.width) * s.frame.height);
  for (size_t i = 0; i < s.frame.slots(); ++i) {
    if (!s.frame.inside(i) || s.shade[i] == kShadeNone) continue;
    const BlockOrigin at = s.frame.pixelOf(i);
    PixelSearch& pixel = pixels[size_t(at.y) * s.frame.width + at.x];
    pixel.surface += 1;
    if (s.shade[i] == kShadeNotFound) {
      pixel.failed += 1;
      continue;
    }
    const Vec2f near = s.uv[s.shade[i]];
    pixel.distance += std::hypot(double(s.aa_uv[i].x - near.x), double(s.aa_uv[i].y - near.y));
    pixel.id += toDouble(falseColor(s.shade[i]));
  }
  return pixels;
}

void addSearchBatch(Device& device, Film& film, const SearchSamples& s, uint32_t layer, size_t first, size_t count) {
  const size_t per_block = size_t(kBlockArea) * s.frame.samples_per_pixel;
  AaSamples aa;
  aa.count = uint32_t(count * per_block);
  aa.samples_per_pixel = s.frame.samples_per_pixel;
  aa.shade = upload(device, s.shade, first * per_block, aa.count, "shade");
  aa.uv = upload(device, s.aa_uv, first * per_block, aa.count, "uv");
  film.addSearch(layer, std::span(s.frame.blocks).subspan(first, count), aa,
                 upload(device, s.uv, 0, s.uv.size(), "shading uv"));
}

TEST_F(FilmDebugTest, SearchAgreesWithTheTwin) {
  for (const uint32_t samples : {1u, 5u}) {
    const SearchSamples s = makeSearch(75, 39, samples);
    const std::vector<PixelSearch> twin = twinSearch(s);
    Film film(device(), 75, 39, FilterKind::BlackmanHarris, 1.5f, 2, samples, true);
    size_t pixels = 0;
    for (const FrameTile& tile : s.frame.tiles) {
      film.beginTile(tile.rect);
      addSearchBatch(device(), film, s, 1, tile.first_block, 1);
      if (tile.blocks > 1) addSearchBatch(device(), film, s, 1, tile.first_block + 1, tile.blocks - 1);
      const FilmImages images = film.finishTile();
      ASSERT_EQ(images.debug.size(), 2u);
      for (size_t i = 0; i < images.rect.area(); ++i, ++pixels) {
        const PixelSearch& expected =
            twin[(images.rect.y0 + i / images.rect.width()) * 75 + images.rect.x0 + i % images.rect.width()];
        const double found = expected.surface - expected.failed;
        const DebugImages& shown = images.debug[1];
        ASSERT_NEAR(shown.reshaded[i], expected.surface > 0 ? expected.failed / expected.surface : 0, 1e-6) << i;
        ASSERT_NEAR(shown.distance[i], found > 0 ? expected.distance / found : 0, 1e-5) << i;
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(shown.id[i][c], expected.id[c] / samples, 1e-6) << i;
        ASSERT_EQ(images.debug[0].reshaded[i], 0.0f);
        ASSERT_EQ(shown.evaluations[i], 0.0f);
      }
    }
    EXPECT_EQ(pixels, 75u * 39u);
  }
}

TEST_F(FilmDebugTest, EvaluationsAreCountedInTheirPixels) {
  Film film(device(), 40, 20, FilterKind::BlackmanHarris, 2.0f, 2, 1, true);
  std::vector<float> counts[2];
  for (auto& layer : counts) layer.assign(800, 0.0f);
  std::vector<float> expected[2] = {counts[0], counts[1]};
  for (const PixelRect tile : {PixelRect{0, 0, 32, 16}, {32, 0, 40, 16}, {0, 16, 32, 20}, {32, 16, 40, 20}}) {
    film.beginTile(tile);
    for (uint32_t i = 0; i < 500; ++i) {
      const uint32_t layer = i % 2, x = tile.x0 + uint32_t(randomUnit(i, tile.x0) * float(tile.width()));
      const uint32_t y = tile.y0 + uint32_t(randomUnit(i, 7 + tile.y0) * float(tile.height()));
      film.addEvaluation(layer, x, y);
      expected[layer][y * 40 + x] += 1;
    }
    film.addEvaluation(0, 40, 0);  // outside of the image
    film.addEvaluation(0, 0, 20);
    const FilmImages images = film.finishTile();
    for (size_t layer = 0; layer < 2; ++layer) {
      for (size_t i = 0; i < images.rect.area(); ++i) {
        const size_t x = images.rect.x0 + i % images.rect.width(), y = images.rect.y0 + i / images.rect.width();
        counts[layer][y * 40 + x] = images.debug[layer].evaluations[i];
      }
    }
  }
  expectSameBits(counts[0], expected[0], "layer 0");
  expectSameBits(counts[1], expected[1], "layer 1");
}

TEST_F(FilmDebugTest, CoordinatesThatAreNoNumbersCountAsNoDistance) {
  SearchSamples s = makeSearch(16, 16, 1);
  std::fill(s.shade.begin(), s.shade.end(), 3u);
  std::fill(s.aa_uv.begin(), s.aa_uv.end(), Vec2f{kNan, 0.5f});
  Film film(device(), 16, 16, FilterKind::Box, 0.5f, 1, 1, true);
  film.beginTile({0, 0, 16, 16});
  addSearchBatch(device(), film, s, 0, 0, 1);
  EXPECT_EQ(film.finishTile().debug[0].distance[7], 0.0f);
}

TEST_F(FilmDebugTest, NothingIsKeptUnlessAskedFor) {
  const SearchSamples s = makeSearch(16, 16, 1);
  const uint64_t before = device().allocatedBytes();
  Film film(device(), 16, 16, FilterKind::Box, 0.5f, 2, 1);
  film.beginTile({0, 0, 16, 16});
  const uint64_t begun = device().allocatedBytes();
  addSearchBatch(device(), film, s, 0, 0, 1);
  film.addEvaluation(0, 3, 3);
  EXPECT_EQ(device().allocatedBytes(), begun);
  EXPECT_LE(begun - before, 4096u);
  EXPECT_TRUE(film.finishTile().debug.empty());
  EXPECT_LT(Film::tileBytes({0, 0, 512, 512}, 512, 1.5f, 2, false),
            Film::tileBytes({0, 0, 512, 512}, 512, 1.5f, 2, true));
}

TEST_F(FilmDebugTest, ShadingSamplesThatDoNotExistAreAnError) {
  SearchSamples s = makeSearch(16, 16, 1);
  s.shade[9] = kShadingSamples;
  Film film(device(), 16, 16, FilterKind::Box, 0.5f, 1, 1, true);
  film.beginTile({0, 0, 16, 16});
  EXPECT_THROW(addSearchBatch(device(), film, s, 0, 0, 1), Error);
}

}  // namespace
}  // namespace encore
