// The film against its twin: forward splatting in double precision, sample by sample.
#include "core/film/film.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "core/scene/error.h"
#include "core/scene/random.h"
#include "kernels/film/filter_values.h"

namespace encore {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr FilterKind kFilters[] = {FilterKind::Box, FilterKind::Gaussian, FilterKind::Mitchell,
                                   FilterKind::BlackmanHarris};

// One device for all tests of this program.
class FilmTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { device_ = Device::create({.validation = true}); }
  static void TearDownTestSuite() { device_.reset(); }
  static Device& device() { return *device_; }

 private:
  static inline std::shared_ptr<Device> device_;
};

float random(uint32_t index, uint32_t dimension) { return toUnit(pcg4d(index, dimension, 0, 0)[0]); }

// The samples of a whole frame, on the host, in the order of its blocks.
struct FrameSamples {
  uint32_t width = 0, height = 0, samples_per_pixel = 0, layers = 0;
  std::vector<BlockOrigin> blocks;
  std::vector<uint32_t> position;
  std::vector<float> coverage;
  std::vector<Vec3f> normal;
  std::vector<std::vector<Vec3f>> throughput;  // per layer
  std::vector<std::vector<uint32_t>> shade;
  std::vector<Vec3f> radiance;

  size_t slots() const { return position.size(); }
  BlockOrigin pixelOf(size_t slot) const {
    const size_t pixel = slot / samples_per_pixel % kBlockArea;
    const BlockOrigin& block = blocks[slot / samples_per_pixel / kBlockArea];
    return {block.x + uint32_t(pixel % kBlockPixels), block.y + uint32_t(pixel / kBlockPixels)};
  }
  bool inside(size_t slot) const { return pixelOf(slot).x < width && pixelOf(slot).y < height; }
};

// Blocks column by column, from the right: the film must not assume an order. Slots of pixels outside the
// image hold what must never be read.
FrameSamples makeSamples(uint32_t width, uint32_t height, uint32_t samples_per_pixel, uint32_t layers) {
  FrameSamples f{width, height, samples_per_pixel, layers, {}, {}, {}, {}, {}, {}, {}};
  for (uint32_t x = (width + kBlockPixels - 1) / kBlockPixels; x-- > 0;) {
    for (uint32_t y = 0; y < height; y += kBlockPixels) f.blocks.push_back({x * kBlockPixels, y});
  }
  const size_t slots = f.blocks.size() * kBlockArea * samples_per_pixel;
  f.position.resize(slots);
  f.coverage.resize(slots);
  f.normal.resize(slots);
  f.throughput.assign(layers, std::vector<Vec3f>(slots));
  f.shade.assign(layers, std::vector<uint32_t>(slots, kShadeNone));
  for (uint32_t i = 0; i < 50; ++i) f.radiance.push_back({3 * random(i, 90), 3 * random(i, 91), 3 * random(i, 92)});
  for (uint32_t s = 0; s < slots; ++s) {
    const bool inside = f.inside(s);
    f.position[s] = pcg4d(s, 1, 0, 0)[0];
    if (s % 7 == 0) f.position[s] &= 0xffff0000;   // on the pixel's left border
    if (s % 11 == 0) f.position[s] &= 0x0000ffff;  // on its upper border
    f.coverage[s] = inside ? (random(s, 2) < 0.7f ? 1.0f : 0.0f) : kNan;
    f.normal[s] = inside ? Vec3f{random(s, 3) - 0.5f, random(s, 4), -random(s, 5)} : Vec3f{kNan, 1, 1};
    for (uint32_t l = 0; l < layers; ++l) {
      f.throughput[l][s] = inside ? Vec3f{random(s, 10 + l), random(s, 20 + l), random(s, 30 + l)} : Vec3f{kInfinity};
      if (random(s, 40 + l) < 0.8f) f.shade[l][s] = uint32_t(random(s, 50 + l) * 50);
      if (!inside) f.shade[l][s] = 12345;
    }
  }
  return f;
}

template <class T>
Buffer<T> upload(Device& device, const std::vector<T>& all, size_t first, size_t count, const char* name) {
  Buffer<T> buffer(device, count, name);
  std::copy_n(all.begin() + ptrdiff_t(first), count, buffer.host().begin());
  buffer.toDevice();
  return buffer;
}

// Adds blocks [first, first + count) of the frame as one batch.
void addBatch(Device& device, Film& film, const FrameSamples& f, size_t first, size_t count) {
  const size_t per_block = size_t(kBlockArea) * f.samples_per_pixel;
  const size_t slot = first * per_block, slots = count * per_block;
  const auto blocks = std::span(f.blocks).subspan(first, count);
  FilmSamples shared;
  shared.position = upload(device, f.position, slot, slots, "position");
  shared.coverage = upload(device, f.coverage, slot, slots, "coverage");
  shared.normal = upload(device, f.normal, slot, slots, "normal");
  const Buffer<Vec3f> radiance = upload(device, f.radiance, 0, f.radiance.size(), "radiance");
  film.addShared(blocks, shared);
  for (uint32_t layer = 0; layer < f.layers; ++layer) {
    AaSamples aa;
    aa.count = uint32_t(slots);
    aa.samples_per_pixel = f.samples_per_pixel;
    aa.throughput = upload(device, f.throughput[layer], slot, slots, "throughput");
    aa.shade = upload(device, f.shade[layer], slot, slots, "shade");
    film.addLayer(layer, blocks, shared, aa, radiance);
  }
}

// Renders the frame in batches of so many blocks.
FilmImages filmImages(Device& device, const FrameSamples& f, FilterKind kind, float radius, size_t batch,
                      uint64_t* non_finite = nullptr) {
  Film film(device, f.width, f.height, kind, radius, f.layers, f.samples_per_pixel);
  for (size_t first = 0; first < f.blocks.size(); first += batch) {
    addBatch(device, film, f, first, std::min(batch, f.blocks.size() - first));
  }
  if (non_finite) *non_finite = film.nonFiniteSamples();
  return film.resolve();
}

// The twin: every sample goes to every pixel near it.
struct TwinImages {
  std::vector<std::vector<Vec3d>> layers;
  std::vector<double> alpha, weight;
  std::vector<Vec3d> normal;
};

TwinImages twinImages(const FrameSamples& f, FilterKind kind, float radius) {
  const size_t pixels = size_t(f.width) * f.height;
  TwinImages t{std::vector(f.layers, std::vector<Vec3d>(pixels)), std::vector<double>(pixels),
               std::vector<double>(pixels), std::vector<Vec3d>(pixels)};
  const int reach = int(std::ceil(radius)) + 1;
  for (size_t s = 0; s < f.slots(); ++s) {
    if (!f.inside(s)) continue;
    const BlockOrigin pixel = f.pixelOf(s);
    const double x = pixel.x + (f.position[s] & 0xffff) / 65536.0, y = pixel.y + (f.position[s] >> 16) / 65536.0;
    for (int j = std::max(0, int(pixel.y) - reach); j <= std::min(int(f.height) - 1, int(pixel.y) + reach); ++j) {
      for (int i = std::max(0, int(pixel.x) - reach); i <= std::min(int(f.width) - 1, int(pixel.x) + reach); ++i) {
        const double weight = double(filterWeight(kind, radius, float(i + 0.5 - x))) *
                              double(filterWeight(kind, radius, float(j + 0.5 - y)));
        const size_t to = size_t(j) * f.width + size_t(i);
        t.weight[to] += weight;
        t.alpha[to] += weight * double(f.coverage[s]);
        t.normal[to] += toDouble(f.normal[s]) * weight;
        for (uint32_t l = 0; l < f.layers; ++l) {
          Vec3d value = toDouble(f.throughput[l][s]);
          if (f.shade[l][s] != kShadeNone) value *= toDouble(f.radiance[f.shade[l][s]]);
          t.layers[l][to] += value * weight;
        }
      }
    }
  }
  return t;
}

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

template <class T>
void expectSameBits(const std::vector<T>& a, const std::vector<T>& b, const char* what) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(T)), 0) << what;
}

void expectSameBits(const FilmImages& a, const FilmImages& b) {
  ASSERT_EQ(a.layers.size(), b.layers.size());
  for (size_t l = 0; l < a.layers.size(); ++l) expectSameBits(a.layers[l], b.layers[l], "layer");
  expectSameBits(a.composite, b.composite, "composite");
  expectSameBits(a.alpha, b.alpha, "alpha");
  expectSameBits(a.normal, b.normal, "normal");
}

// Textbook formulas in double precision, x in pixels inside the radius.
double textbookWeight(FilterKind kind, double radius, double x) {
  const double t = std::abs(x) / radius, s = 2 * t, pi = 3.14159265358979323846;
  switch (kind) {
    case FilterKind::Box:
      return 1;
    case FilterKind::Gaussian:
      return std::exp(-4.5 * t * t) - std::exp(-4.5);
    case FilterKind::Mitchell:
      return s < 1 ? (7 * s * s * s - 12 * s * s + 16.0 / 3) / 6
                   : (-7.0 / 3 * s * s * s + 12 * s * s - 20 * s + 32.0 / 3) / 6;
    default:
      return 0.35875 + 0.48829 * std::cos(pi * t) + 0.14128 * std::cos(2 * pi * t) + 0.01168 * std::cos(3 * pi * t);
  }
}

TEST(Filter, FollowsItsFormulaInsideTheRadius) {
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.0f, 1.5f, 2.0f, 2.7f, 8.0f}) {
      for (int i = -999; i <= 999; ++i) {
        const float x = radius * float(i) / 1000;
        ASSERT_NEAR(filterWeight(kind, radius, x), textbookWeight(kind, double(radius), double(x)), 2e-6)
            << int(kind) << " " << radius << " " << x;
      }
    }
  }
}

TEST(Filter, IsZeroAtAndBeyondTheRadius) {
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.5f, 2.7f}) {
      for (const float beyond : {1.0f, 1.0001f, 2.0f, 100.0f}) {
        EXPECT_EQ(filterWeight(kind, radius, -radius * beyond), 0.0f);
        const bool half_open = kind == FilterKind::Box && beyond == 1.0f;
        EXPECT_EQ(filterWeight(kind, radius, radius * beyond), half_open ? 1.0f : 0.0f);
      }
    }
  }
}

TEST(Filter, PadCoversTheReachAndNoMore) {
  EXPECT_EQ(filterPad(0.25f), 0u);
  EXPECT_EQ(filterPad(0.5f), 0u);
  EXPECT_EQ(filterPad(0.51f), 1u);
  EXPECT_EQ(filterPad(1.5f), 1u);
  EXPECT_EQ(filterPad(2.0f), 2u);
  EXPECT_EQ(filterPad(2.7f), 3u);
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.0f, 1.5f, 2.0f, 2.7f}) {
      for (int i = 0; i < 4096; ++i) {  // the first pixels that pad leaves out, left and right
        const float beyond = float(filterPad(radius)) + 1, position = float(i) / 4096;
        ASSERT_EQ(filterWeight(kind, radius, beyond + 0.5f - position), 0.0f);
        ASSERT_EQ(filterWeight(kind, radius, -beyond + 0.5f - position), 0.0f);
      }
    }
  }
}

TEST_F(FilmTest, KernelsHaveTheSameWeightsToTheLastBit) {
  const uint32_t count = 20000;
  Buffer<float> distances(device(), count, "distances"), weights(device(), count, "weights");
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.5f, 2.7f}) {
      for (uint32_t i = 0; i < count; ++i) distances.host()[i] = radius * (float(i) / (count / 2) - 1) * 1.1f;
      distances.host()[0] = radius;
      distances.host()[1] = -radius;
      distances.toDevice();
      const Kernel kernel(
          device(), "filter_values", kFilterValuesSpirv,
          {{uint32_t(kind), std::bit_cast<uint32_t>(radius), std::bit_cast<uint32_t>(1 / radius), filterPad(radius)}});
      struct Arguments {
        uint64_t distances, weights;
        uint32_t count;
      };
      Commands commands(device());
      commands.dispatch(kernel, groupsFor(count, 64), Arguments{distances.address(), weights.address(), count});
      commands.run();
      weights.toHost();
      for (uint32_t i = 0; i < count; ++i) {
        const float expected = filterWeight(kind, radius, distances.host()[i]);
        ASSERT_EQ(std::bit_cast<uint32_t>(weights.host()[i]), std::bit_cast<uint32_t>(expected))
            << int(kind) << " " << radius << " " << distances.host()[i] << " " << weights.host()[i] << " " << expected;
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
      expectTwin(filmImages(device(), f, kind, radius, f.blocks.size(), &non_finite), twinImages(f, kind, radius));
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
  spoil(1, 600, {1, 0, 1}, 50);                  // 0 * infinity
  spoil(1, 700, {1, 1, 0}, 51);                  // NaN * 0
  spoil(1, 900, {3e38f, 3e38f, 1}, kShadeNone);  // finite, for the next line to overflow
  f.radiance.push_back({100, 1, 1});
  f.shade[1][used[900]] = 52;
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
  Film film(device(), 4, 3, FilterKind::Box, 0.5f, 0, 1);
  film.addDepth(1, 2, 5.0f);
  film.addDepth(1, 2, 3.0f);
  film.addDepth(1, 2, 4.0f);
  film.addDepth(1, 2, kNan);
  film.addDepth(4, 0, 1.0f);  // outside
  film.addDepth(0, 3, 1.0f);
  const FilmImages images = film.resolve();
  for (size_t i = 0; i < 12; ++i) EXPECT_EQ(images.depth[i], i == 9 ? 3.0f : kInfinity) << i;
}

TEST_F(FilmTest, PixelsWithoutSamplesAreZero) {
  const FrameSamples f = makeSamples(40, 40, 2, 1);
  Film film(device(), 40, 40, FilterKind::Gaussian, 1.5f, 1, 2);
  addBatch(device(), film, f, 0, 1);  // the upper right block only
  const FilmImages images = film.resolve();
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
  expectError(ErrorKind::Internal, [&] { addBatch(device(), other, f, 0, 1); });
}

TEST_F(FilmTest, DeviceMemoryIsAsPlannedAndBounded) {
  EXPECT_EQ(Film::partialBytes(1u << 20, 1.5f), Film::partialBytes(1u << 30, 1.5f));
  EXPECT_LT(Film::partialBytes(1u << 30, 8.0f), 128u << 20);
  const FrameSamples f = makeSamples(16 * 14, 16 * 10, 1, 1);
  for (const size_t batch : {1u, 10u, 140u}) {
    const uint64_t before = device().allocatedBytes();
    Film film(device(), f.width, f.height, FilterKind::Gaussian, 1.5f, 1, 1);
    for (size_t first = 0; first < 140; first += batch) addBatch(device(), film, f, first, batch);
    EXPECT_LE(device().allocatedBytes() - before, Film::partialBytes(batch, 1.5f) + 4 * 4096);  // pages
  }
}

}  // namespace
}  // namespace encore
