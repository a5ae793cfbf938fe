// The film against its twins, on images of one tile.
#include "core/film/film.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/scene/error.h"
#include "tests/core/film_samples.h"
#include "tests/core/twins/film_twin.h"

namespace encore {
namespace {

// Relative to the sum of the values' sizes that went in: all values here are of the order of 1.
void expectNear(double value, double sum, double weight, size_t pixel, const char* what) {
  const double expected = weight != 0 ? sum / weight : 0;
  ASSERT_NEAR(value, expected, 1e-5 * std::max(1.0, std::abs(expected))) << what << ", pixel " << pixel;
}

void expectTwin(const FilmImages& images, const TwinImages& twin) {
  ASSERT_EQ(images.layers.size(), twin.layers.size());
  for (size_t i = 0; i < twin.weight.size(); ++i) {
    expectNear(images.alpha[i], twin.alpha[i], twin.weight[i], i, "alpha");
    for (int c = 0; c < 3; ++c) {
      expectNear(images.normal[i][c], twin.normal[i][c], twin.weight[i], i, "normal");
      for (size_t l = 0; l < twin.layers.size(); ++l) {
        expectNear(images.layers[l][i][c], twin.layers[l][i][c], twin.weight[i], i, "layer");
      }
    }
  }
}

TEST_F(FilmTest, AgreesWithForwardSplatting) {
  // All radii where they differ most (the box's borders, the default), two elsewhere: kernels take a
  // while to compile.
  const std::pair<FilterKind, std::vector<float>> cases[] = {{FilterKind::Box, {0.5f, 1, 1.5f, 2, 2.7f}},
                                                             {FilterKind::BlackmanHarris, {0.5f, 1, 1.5f, 2, 2.7f}},
                                                             {FilterKind::Gaussian, {1, 1.5f}},
                                                             {FilterKind::Mitchell, {1.5f, 2}}};
  const FrameSamples f = makeSamples(37, 21, 5, 1);
  for (const auto& [kind, radii] : cases) {
    for (const float radius : radii) {
      SCOPED_TRACE(testing::Message() << "filter " << int(kind) << ", radius " << radius);
      uint64_t non_finite = 1;
      const FilmImages images = filmImages(device(), f, kind, radius, f.blocks.size(), &non_finite);
      expectTwin(images, twinImages(f, kind, radius));
      expectSameBits(images, wholeFrameImages(f, kind, radius));
      EXPECT_EQ(non_finite, 0u);
      if (HasFatalFailure()) return;
    }
  }
}

TEST_F(FilmTest, WidestFilterAndImagesSmallerThanIt) {
  const FrameSamples f = makeSamples(3, 2, 4, 1);
  expectTwin(filmImages(device(), f, FilterKind::Gaussian, 8, 1), twinImages(f, FilterKind::Gaussian, 8));
  const FrameSamples g = makeSamples(1, 40, 1, 2);
  expectTwin(filmImages(device(), g, FilterKind::Mitchell, 2, 2), twinImages(g, FilterKind::Mitchell, 2));
}

TEST_F(FilmTest, SeveralHundredSamplesPerPixel) {
  const FrameSamples f = makeSamples(17, 5, 400, 1);
  expectTwin(filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, 2),
             twinImages(f, FilterKind::BlackmanHarris, 1.5f));
}

TEST_F(FilmTest, BoxOfOnePixelIsTheMeanOfItsSamples) {
  FrameSamples f = makeSamples(16, 16, 2, 1);
  for (size_t s = 0; s < f.slots(); ++s) {
    f.position[s] = s % 2 == 0 ? 0u : 0xffffffffu;  // both ends of [0, 1)²
    f.shade[0][s] = kShadeNone;
    f.throughput[0][s] = Vec3f{1, 1, 1} * float(s);
  }
  const FilmImages images = filmImages(device(), f, FilterKind::Box, 0.5f, 1);
  for (size_t i = 0; i < 256; ++i) EXPECT_EQ(images.layers[0][i].x, 2 * float(i) + 0.5f) << i;
}

TEST_F(FilmTest, ConstantStaysConstant) {
  FrameSamples f = makeSamples(37, 21, 9, 1);
  const Vec3f constant{0.1f, 1.7f, 1234.5f};
  f.radiance = {constant};
  for (size_t s = 0; s < f.slots(); ++s) {
    f.shade[0][s] = s % 2 ? 0 : kShadeNone;
    f.throughput[0][s] = s % 2 ? Vec3f{1, 1, 1} : constant;
    f.coverage[s] = 1;
  }
  for (const FilterKind kind : kFilters) {
    const FilmImages images = filmImages(device(), f, kind, 1.5f, 4);
    for (size_t i = 0; i < images.alpha.size(); ++i) {
      ASSERT_NEAR(images.alpha[i], 1, 2e-6) << int(kind);
      for (int c = 0; c < 3; ++c) ASSERT_NEAR(images.layers[0][i][c], constant[c], 2e-6f * constant[c]) << int(kind);
    }
  }
}

TEST_F(FilmTest, BatchesDoNotChangeABit) {
  const FrameSamples f = makeSamples(53, 37, 4, 2);  // 12 blocks
  const FilmImages whole = filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, 12);
  for (const size_t batch : {1u, 2u, 5u, 11u}) {
    SCOPED_TRACE(batch);
    expectSameBits(filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, batch), whole);
  }
}

TEST_F(FilmTest, BatchesOfMoreBlocksThanAreSplattedAtOnce) {
  const FrameSamples f = makeSamples(16 * 14, 16 * 10, 1, 1);  // 140 blocks
  const FilmImages whole = filmImages(device(), f, FilterKind::Mitchell, 1.5f, 140);
  expectSameBits(filmImages(device(), f, FilterKind::Mitchell, 1.5f, 9), whole);
  expectTwin(whole, twinImages(f, FilterKind::Mitchell, 1.5f));
}

TEST_F(FilmTest, HostCopiesDoNotChangeABit) {
  const FrameSamples f = makeSamples(20, 20, 3, 1);
  const auto staged = Device::create({.validation = true, .staging = true});
  expectSameBits(filmImages(*staged, f, FilterKind::Gaussian, 1.5f, 3),
                 filmImages(device(), f, FilterKind::Gaussian, 1.5f, 3));
}

TEST_F(FilmTest, CompositeIsTheSumOfTheLayersToTheLastBit) {
  const FrameSamples f = makeSamples(37, 21, 3, 3);
  const FilmImages images = filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, 6);
  std::vector<Vec3f> sum = images.layers[0];
  for (size_t i = 0; i < sum.size(); ++i) sum[i] = sum[i] + images.layers[1][i] + images.layers[2][i];
  expectSameBits(images.composite, sum, "composite");
  EXPECT_NE(images.layers[0][5], images.layers[1][5]);
}

TEST_F(FilmTest, SamplesThatAreNotFiniteAreCountedAndLeftOut) {
  FrameSamples f = makeSamples(20, 20, 4, 2), without = f;
  std::vector<size_t> used;
  for (size_t s = 0; s < f.slots(); ++s) {
    if (f.inside(s)) used.push_back(s);
  }
  const auto spoil = [&](uint32_t layer, size_t which, Vec3f throughput, uint32_t shade) {
    const size_t s = used[which];
    f.throughput[layer][s] = throughput;
    f.shade[layer][s] = shade;
    without.throughput[layer][s] = {};
    without.shade[layer][s] = kShadeNone;
  };
  f.radiance.push_back({1, kInfinity, 1});
  f.radiance.push_back({1, 1, kNan});
  spoil(0, 3, {kNan, 0, 0}, kShadeNone);
  spoil(0, 50, {0, kInfinity, 0}, kShadeNone);
  spoil(0, 51, {0, 0, -kInfinity}, kShadeNone);
  spoil(1, 600, {1, 0, 1}, 51);                  // 0 * infinity
  spoil(1, 700, {1, 1, 0}, 52);                  // NaN * 0
  spoil(1, 900, {3e38f, 3e38f, 1}, kShadeNone);  // finite, for the next line to overflow
  f.radiance.push_back({100, 1, 1});
  f.shade[1][used[900]] = 53;
  f.normal[used[20]].z = kNan;
  without.normal[used[20]] = {};
  without.coverage[used[20]] = 0;
  uint64_t count = 0, none = 1;
  const FilmImages images = filmImages(device(), f, FilterKind::Gaussian, 2.0f, 4, &count);
  expectSameBits(images, filmImages(device(), without, FilterKind::Gaussian, 2.0f, 4, &none));
  EXPECT_EQ(count, 7u);
  EXPECT_EQ(none, 0u);
  for (const Vec3f& pixel : images.composite) ASSERT_TRUE(isFinite(pixel));
}

TEST_F(FilmTest, AWideFilterCountsASpoiltSampleOnce) {
  FrameSamples f = makeSamples(16, 16, 1, 1);
  f.throughput[0][100] = {kNan, kNan, kNan};
  uint64_t count = 0;
  filmImages(device(), f, FilterKind::BlackmanHarris, 2.7f, 1, &count);
  EXPECT_EQ(count, 1u);
}

TEST_F(FilmTest, DepthIsTheSmallest) {
  Film film(device(), 4, 3, FilterKind::Box, 0.5f, 1, 1);
  film.beginTile({0, 0, 4, 3});
  const BlockOrigin block[] = {{0, 0}};
  std::vector<float> depth(kBlockArea, kInfinity);
  for (const float value : {5.0f, 3.0f, 4.0f, kNan}) {
    depth[2 * kBlockPixels + 1] = value;
    depth[4] = depth[3 * kBlockPixels] = 1;  // outside
    film.addDepth(block, depth);
  }
  const FilmImages images = film.finishTile();
  for (size_t i = 0; i < 12; ++i) EXPECT_EQ(images.depth[i], i == 9 ? 3.0f : kInfinity) << i;
}

TEST_F(FilmTest, PixelsWithoutSamplesAreZero) {
  const FrameSamples f = makeSamples(40, 40, 2, 1);
  Film film(device(), 40, 40, FilterKind::Gaussian, 1.5f, 1, 2);
  film.beginTile({0, 0, 40, 40});
  addBatch(device(), film, f, 0, 1);  // the upper right block only
  const FilmImages images = film.finishTile();
  EXPECT_EQ(images.composite[0], Vec3f{});
  EXPECT_EQ(images.alpha[0], 0.0f);
  EXPECT_GT(images.composite[39].x, 0.0f);
  EXPECT_TRUE(isFinite(images.composite[39]));
}

template <class F>
void expectError(ErrorKind kind, F&& f) {
  try {
    f();
    ADD_FAILURE() << "no Error";
  } catch (const Error& error) {
    EXPECT_EQ(int(error.kind()), int(kind)) << error.what();
  }
}

TEST_F(FilmTest, MisuseIsAnError) {
  FrameSamples f = makeSamples(16, 16, 2, 1);
  for (const float radius : {0.0f, -1.0f, 8.5f, kNan}) {
    expectError(ErrorKind::Setting, [&] { Film(device(), 4, 4, FilterKind::Box, radius, 1, 1); });
  }
  f.shade[0][77] = kShadeNotFound;  // a failure that nobody served
  expectError(ErrorKind::Internal, [&] { filmImages(device(), f, FilterKind::Box, 0.5f, 1); });
  f.shade[0][77] = uint32_t(f.radiance.size());
  expectError(ErrorKind::Internal, [&] { filmImages(device(), f, FilterKind::Box, 0.5f, 1); });
  f.shade[0][77] = 0;
  Film other(device(), 16, 16, FilterKind::Box, 0.5f, 1, 3);  // expects three samples per pixel
  other.beginTile({0, 0, 16, 16});
  expectError(ErrorKind::Internal, [&] { addBatch(device(), other, f, 0, 1); });
}

TEST_F(FilmTest, BlocksMustLieWithinTheTile) {
  const FrameSamples f = makeSamples(40, 40, 1, 1, 16, 16);
  Film film(device(), 40, 40, FilterKind::Box, 0.5f, 1, 1, true);
  expectError(ErrorKind::Internal, [&] { addBatch(device(), film, f, 0, 1); });  // before any tile
  film.beginTile(f.tiles[0].rect);
  addBatch(device(), film, f, 0, 1);
  expectError(ErrorKind::Internal, [&] { addBatch(device(), film, f, 1, 1); });
  expectError(ErrorKind::Internal, [&] { addBatch(device(), film, f, f.tiles[3].first_block, 1); });
  expectError(ErrorKind::Internal, [&] { film.addEvaluation(0, 16, 0); });
  const BlockOrigin across[] = {{8, 0}};
  expectError(ErrorKind::Internal, [&] { film.addDepth(across, std::vector<float>(kBlockArea)); });
  expectError(ErrorKind::Internal, [&] { film.addDepth(std::span(f.blocks).first(1), std::vector<float>(255)); });
  film.finishTile();
  expectError(ErrorKind::Internal, [&] { film.finishTile(); });
}

TEST_F(FilmTest, DeviceMemoryIsAsPlannedAndBounded) {
  EXPECT_EQ(Film::partialBytes(1u << 20, 1.5f), Film::partialBytes(1u << 30, 1.5f));
  EXPECT_LT(Film::partialBytes(1u << 30, 8.0f), 128u << 20);
  const FrameSamples f = makeSamples(16 * 7, 16 * 5, 1, 2);
  for (const float radius : {0.5f, 1.5f}) {
    for (const size_t batch : {1u, 10u, 35u}) {
      const uint64_t before = device().allocatedBytes();
      Film film(device(), f.width, f.height, FilterKind::Box, radius, 2, 1);
      film.beginTile(f.tiles[0].rect);
      for (size_t first = 0; first < 35; first += batch)
        addBatch(device(), film, f, first, std::min(batch, 35 - first));
      const uint64_t used = device().allocatedBytes() - before;
      EXPECT_LE(used, Film::partialBytes(batch, radius) + 4 * 4096);  // pages
      EXPECT_GE(used, Film::partialBytes(batch, radius));
    }
  }
}

}  // namespace
}  // namespace encore
