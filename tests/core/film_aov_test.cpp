// Aovs on the film, and parts of the plane of the image between which filters do not reach.
#include <gtest/gtest.h>

#include <bit>

#include "core/scene/error.h"
#include "tests/core/film_samples.h"

namespace encore {
namespace {

using FilmAovTest = FilmTest;
using Kind = Aov::Kind;

// The components of the normal and of the coverage, whose images film_test compares with a twin.
float channel(const FrameSamples& f, size_t slot, size_t c) {
  const Vec3f n = f.normal[slot];
  return c == 0 ? n.x : c == 1 ? n.y : c == 2 ? n.z : f.coverage[slot];
}

void addValues(Device& device, Film& film, size_t aov, const FrameSamples& f, const FrameTile& tile,
               uint32_t components) {
  const size_t per_block = size_t(kBlockArea) * f.samples_per_pixel, first = tile.first_block * per_block;
  const size_t slots = tile.blocks * per_block;
  Buffer<float> values(device, slots * components, "values");
  for (size_t i = 0; i < slots * components; ++i) values.host()[i] = channel(f, first + i / components, i % components);
  values.toDevice();
  FilmSamples shared;
  shared.position = upload(device, f.position, first, slots, "position");
  film.addAov(aov, std::span(f.blocks).subspan(tile.first_block, tile.blocks), shared, values);
}

// A value of one's own for every pixel.
float pixelValue(BlockOrigin pixel, size_t c) { return float(1000 * pixel.y + pixel.x) + 0.25f * float(c); }

void setPixels(Film& film, size_t positions, size_t ids, const FrameSamples& f, const FrameTile& tile) {
  std::vector<float> values;
  std::vector<int32_t> numbers;
  for (size_t p = tile.first_block * kBlockArea; p < (tile.first_block + tile.blocks) * kBlockArea; ++p) {
    const BlockOrigin pixel = f.pixelOf(p * f.samples_per_pixel);
    for (size_t c = 0; c < 3; ++c) values.push_back(pixelValue(pixel, c));
    numbers.push_back(0x7f800001 + pixel.y * 100 + pixel.x);  // bits of numbers that are not
  }
  const auto blocks = std::span(f.blocks).subspan(tile.first_block, tile.blocks);
  film.setAov(positions, blocks, std::span<const float>(values));
  film.setAov(ids, blocks, std::span<const int32_t>(numbers));
}

TEST_F(FilmAovTest, AreFilteredAsNormalsAndCoverageToTheLastBit) {
  const std::vector<Aov> aovs = {{Kind::Primvar, "1", "p", 1},   {Kind::Position, "P", "", 0},
                                 {Kind::Primvar, "2", "p", 2},   {Kind::Primvar, "3", "p", 3},
                                 {Kind::EyeNormal, "Ne", "", 0}, {Kind::PrimId, "id", "", 0},
                                 {Kind::Primvar, "4", "p", 4}};
  for (const auto& [kind, radius, samples] :
       {std::tuple{FilterKind::BlackmanHarris, 1.5f, 3u}, {FilterKind::Box, 2.7f, 2u}}) {
    const FrameSamples f = makeSamples(53, 39, samples, 1, 32, 16);
    Film film(device(), FilmArea::ofImage(53, 39), kind, radius, 1, samples, false, aovs);
    size_t seen = 0;
    for (const FrameTile& tile : f.tiles) {
      film.beginTile(tile.rect);
      addBatch(device(), film, f, tile.first_block, tile.blocks);
      for (const auto& [aov, components] : {std::pair{0, 1u}, {2, 2u}, {3, 3u}, {6, 4u}})
        addValues(device(), film, size_t(aov), f, tile, components);
      setPixels(film, 1, 5, f, tile);
      const FilmImages images = film.finishTile();
      ASSERT_EQ(images.aovs.size(), aovs.size());
      EXPECT_TRUE(images.aovs[4].values.empty());
      for (size_t i = 0; i < images.rect.area(); ++i, ++seen) {
        const BlockOrigin at{images.rect.x0 + int32_t(i % images.rect.width()),
                             images.rect.y0 + int32_t(i / images.rect.width())};
        const float expected[] = {images.normal[i].x, images.normal[i].y, images.normal[i].z, images.alpha[i]};
        for (const size_t aov : {0, 2, 3, 6})
          for (uint32_t c = 0; c < aovs[aov].components; ++c)
            ASSERT_EQ(std::bit_cast<uint32_t>(images.aovs[aov].values[i * aovs[aov].components + c]),
                      std::bit_cast<uint32_t>(expected[c]))
                << aov << ", pixel " << i;
        for (size_t c = 0; c < 3; ++c) ASSERT_EQ(images.aovs[1].values[3 * i + c], pixelValue(at, c));
        ASSERT_EQ(images.aovs[5].ids[i], 0x7f800001 + at.y * 100 + at.x);
      }
    }
    EXPECT_EQ(seen, 53u * 39u);
    EXPECT_EQ(film.nonFiniteSamples(), 0u);
  }
}

TEST_F(FilmAovTest, WhatIsNotFiniteCountsAsNothingAndIsCounted) {
  const std::vector<Aov> aovs = {{Kind::Primvar, "v", "p", 2}, {Kind::Position, "P", "", 0}};
  FrameSamples f = makeSamples(16, 16, 1, 1);
  f.normal[17] = {kNan, 1, 1};
  Film film(device(), FilmArea::ofImage(16, 16), FilterKind::Box, 0.5f, 1, 1, false, aovs);
  film.beginTile({0, 0, 16, 16});
  addBatch(device(), film, f, 0, 1);
  const uint64_t before = film.nonFiniteSamples();
  addValues(device(), film, 0, f, f.tiles[0], 2);
  EXPECT_EQ(film.nonFiniteSamples(), before + 1);
  std::vector<float> values(3 * kBlockArea, 1.0f);
  values[3 * 40 + 1] = kInfinity;
  film.setAov(1, f.blocks, std::span<const float>(values));
  EXPECT_EQ(film.nonFiniteSamples(), before + 2);
  const FilmImages images = film.finishTile();
  EXPECT_EQ(images.aovs[0].values[2 * 17 + 1], 0.0f);
  EXPECT_EQ(images.aovs[1].values[3 * 40], 0.0f);
  EXPECT_EQ(images.aovs[1].values[3 * 41], 1.0f);
}

TEST_F(FilmAovTest, PixelsOfNoBlockHaveNoIds) {
  const std::vector<Aov> aovs = {{Kind::ElementId, "id", "", 0}};
  Film film(device(), FilmArea::ofImage(40, 16), FilterKind::Box, 0.5f, 1, 1, false, aovs);
  film.beginTile({0, 0, 40, 16});
  const BlockOrigin block[] = {{16, 0}};
  film.setAov(0, block, std::vector<int32_t>(kBlockArea, 9));
  const FilmImages images = film.finishTile();
  EXPECT_EQ(images.aovs[0].ids[15], -1);
  EXPECT_EQ(images.aovs[0].ids[16], 9);
}

TEST_F(FilmAovTest, MisuseIsAnError) {
  const std::vector<Aov> aovs = {{Kind::Primvar, "v", "p", 2}, {Kind::ElementId, "id", "", 0}};
  const FrameSamples f = makeSamples(16, 16, 1, 1);
  Film film(device(), FilmArea::ofImage(16, 16), FilterKind::Box, 0.5f, 1, 1, false, aovs);
  film.beginTile({0, 0, 16, 16});
  EXPECT_THROW(addValues(device(), film, 1, f, f.tiles[0], 1), Error);
  EXPECT_THROW(addValues(device(), film, 2, f, f.tiles[0], 1), Error);
  EXPECT_THROW(addValues(device(), film, 0, f, f.tiles[0], 1), Error);  // too few
  EXPECT_THROW(film.setAov(0, f.blocks, std::vector<float>(3 * kBlockArea)), Error);
  EXPECT_THROW(film.setAov(1, f.blocks, std::vector<int32_t>(kBlockArea - 1)), Error);
}

// The frame of makeSamples() moved to (x, y).
FrameSamples moved(FrameSamples f, int32_t x, int32_t y) {
  for (BlockOrigin& block : f.blocks) block = {block.x + x, block.y + y};
  for (FrameTile& tile : f.tiles) tile.rect = {tile.rect.x0 + x, tile.rect.y0 + y, tile.rect.x1 + x, tile.rect.y1 + y};
  return f;
}

// Each part is what a film of nothing else gives, whatever its neighbours hold.
TEST_F(FilmAovTest, NothingReachesAcrossBorders) {
  constexpr FilterKind kFilter = FilterKind::BlackmanHarris;
  constexpr float kRadius = 1.5f;
  const std::vector<int32_t> columns{-32, 0, 21}, rows{-16, 0, 37};
  const PixelRect window{-20, -9, 18, 37};
  Film film(device(), FilmArea{columns, rows, window}, kFilter, kRadius, 2, 2);
  for (size_t r = 0; r + 1 < rows.size(); ++r) {
    const int32_t height = rows[r + 1] - rows[r];
    std::vector<FrameSamples> parts;
    std::vector<FrameImages> alone, found;
    for (size_t c = 0; c + 1 < columns.size(); ++c) {
      const int32_t width = columns[c + 1] - columns[c];
      parts.push_back(makeSamples(width, height, 2, 2, 16, 16));
      alone.push_back(filmImages(device(), parts[c], kFilter, kRadius, 100));
      found.push_back(emptyImages(width, height, 2));
    }
    for (int32_t y = 0; y < height; y += 16)
      for (size_t c = 0; c + 1 < columns.size(); ++c) {
        const FrameSamples part = moved(parts[c], columns[c], rows[r]);
        for (const FrameTile& tile : part.tiles) {
          if (tile.rect.y0 != rows[r] + y) continue;
          film.beginTile(tile.rect);
          addBatch(device(), film, part, tile.first_block, tile.blocks);
          FilmImages images = film.finishTile();
          if (images.rect.area() == 0) continue;
          EXPECT_TRUE(images.rect.x0 >= window.x0 && images.rect.y0 >= window.y0);
          EXPECT_TRUE(images.rect.x1 <= window.x1 && images.rect.y1 <= window.y1);
          images.rect = {images.rect.x0 - columns[c], images.rect.y0 - rows[r], images.rect.x1 - columns[c],
                         images.rect.y1 - rows[r]};
          place(found[c], images);
        }
      }
    for (size_t c = 0; c + 1 < columns.size(); ++c)
      for (size_t i = 0; i < found[c].set.size(); ++i) {
        const int32_t width = columns[c + 1] - columns[c];
        const int32_t x = columns[c] + int32_t(i) % width, y = rows[r] + int32_t(i) / width;
        const bool shown = x >= window.x0 && x < window.x1 && y >= window.y0 && y < window.y1;
        ASSERT_EQ(found[c].set[i], shown ? 1u : 0u) << x << ", " << y;
        if (!shown) continue;
        ASSERT_EQ(std::memcmp(&found[c].composite[i], &alone[c].composite[i], sizeof(Vec3f)), 0) << x << ", " << y;
        ASSERT_EQ(std::memcmp(&found[c].normal[i], &alone[c].normal[i], sizeof(Vec3f)), 0) << x << ", " << y;
        ASSERT_EQ(found[c].depth[i], alone[c].depth[i]) << x << ", " << y;
      }
  }
  EXPECT_THROW(film.beginTile({-32, -16, -16, 0}), Error);  // once only
}

TEST_F(FilmAovTest, TilesDoNotLieAcrossBorders) {
  Film film(device(), FilmArea{{-32, 0, 21}, {0, 40}, {-5, 0, 21, 40}}, FilterKind::Box, 0.5f, 1, 1);
  EXPECT_THROW(film.beginTile({-32, 0, 16, 16}), Error);
  EXPECT_THROW(film.beginTile({-32, 0, 0, 41}), Error);
  film.beginTile({-32, 0, 0, 40});
  EXPECT_THROW(film.beginTile({0, 0, 21, 40}), Error);  // the one before is not finished
  EXPECT_EQ(film.finishTile().rect.x0, -5);
}

}  // namespace
}  // namespace encore
