// Made-up samples of whole frames, and how tests put them through the film.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "core/film/film.h"
#include "core/scene/random.h"

namespace encore {

inline constexpr float kInfinity = std::numeric_limits<float>::infinity();
inline constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
inline constexpr FilterKind kFilters[] = {FilterKind::Box, FilterKind::Gaussian, FilterKind::Mitchell,
                                          FilterKind::BlackmanHarris};

// One device for all tests of a program.
class FilmTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { device_ = Device::create({.validation = true}); }
  static void TearDownTestSuite() { device_.reset(); }
  static Device& device() { return *device_; }

 private:
  static inline std::shared_ptr<Device> device_;
};

inline float randomUnit(uint32_t index, uint32_t dimension) { return toUnit(pcg4d(index, dimension, 0, 0)[0]); }

struct FrameTile {
  PixelRect rect;
  size_t first_block = 0, blocks = 0;
};

// The samples of a whole frame, on the host, in the order of its blocks.
struct FrameSamples {
  int32_t width = 0, height = 0;
  uint32_t samples_per_pixel = 0, layers = 0;
  std::vector<FrameTile> tiles;
  std::vector<BlockOrigin> blocks;
  std::vector<uint32_t> position;
  std::vector<float> coverage;
  std::vector<Vec3f> normal;
  std::vector<std::vector<Vec3f>> throughput;  // per layer
  std::vector<std::vector<uint32_t>> shade;
  std::vector<Vec3f> radiance;
  std::vector<float> depth;  // per pixel of the blocks

  size_t slots() const { return position.size(); }
  BlockOrigin pixelOf(size_t slot) const {
    const size_t pixel = slot / samples_per_pixel % kBlockArea;
    const BlockOrigin& block = blocks[slot / samples_per_pixel / kBlockArea];
    return {block.x + int32_t(pixel % kBlockPixels), block.y + int32_t(pixel / kBlockPixels)};
  }
  bool inside(size_t slot) const { return pixelOf(slot).x < width && pixelOf(slot).y < height; }
};

// Tiles in row order; in each its blocks column by column, from the right: the film must not assume an order.
inline void cutIntoTiles(FrameSamples& f, int32_t tile_width, int32_t tile_height) {
  const int32_t side = int32_t(kBlockPixels);
  for (int32_t y = 0; y < f.height; y += tile_height) {
    for (int32_t x = 0; x < f.width; x += tile_width) {
      const PixelRect rect{x, y, std::min(x + tile_width, f.width), std::min(y + tile_height, f.height)};
      const size_t first = f.blocks.size();
      for (int32_t bx = (rect.x1 - 1) / side * side + side; bx > x;) {
        bx -= side;
        for (int32_t by = y; by < rect.y1; by += side) f.blocks.push_back({bx, by});
      }
      f.tiles.push_back({rect, first, f.blocks.size() - first});
    }
  }
}

// Slots of pixels outside the image hold what must never count. tile_*: multiples of kBlockPixels.
inline FrameSamples makeSamples(int32_t width, int32_t height, uint32_t samples_per_pixel, uint32_t layers,
                                int32_t tile_width = 1 << 20, int32_t tile_height = 1 << 20) {
  FrameSamples f{width, height, samples_per_pixel, layers, {}, {}, {}, {}, {}, {}, {}, {}, {}};
  cutIntoTiles(f, tile_width, tile_height);
  const size_t slots = f.blocks.size() * kBlockArea * samples_per_pixel;
  f.position.resize(slots);
  f.coverage.resize(slots);
  f.normal.resize(slots);
  f.throughput.assign(layers, std::vector<Vec3f>(slots));
  f.shade.assign(layers, std::vector<uint32_t>(slots, kShadeNone));
  f.depth.resize(f.blocks.size() * kBlockArea);
  for (uint32_t i = 0; i < f.depth.size(); ++i) {
    f.depth[i] = randomUnit(i, 80) < 0.2f ? kInfinity : randomUnit(i, 81);
    if (!f.inside(size_t(i) * samples_per_pixel)) f.depth[i] = -1;
  }
  for (uint32_t i = 0; i < 51; ++i) {
    f.radiance.push_back({3 * randomUnit(i, 90), 3 * randomUnit(i, 91), 3 * randomUnit(i, 92)});
  }
  for (uint32_t s = 0; s < slots; ++s) {
    const bool inside = f.inside(s);
    f.position[s] = pcg4d(s, 1, 0, 0)[0];
    if (s % 7 == 0) f.position[s] &= 0xffff0000;   // on the pixel's left border
    if (s % 11 == 0) f.position[s] &= 0x0000ffff;  // on its upper border
    f.coverage[s] = inside ? (randomUnit(s, 2) < 0.7f ? 1.0f : 0.0f) : kNan;
    f.normal[s] = inside ? Vec3f{randomUnit(s, 3) - 0.5f, randomUnit(s, 4), -randomUnit(s, 5)} : Vec3f{kNan, 1, 1};
    for (uint32_t l = 0; l < layers; ++l) {
      f.throughput[l][s] =
          inside ? Vec3f{randomUnit(s, 10 + l), randomUnit(s, 20 + l), randomUnit(s, 30 + l)} : Vec3f{kInfinity};
      if (randomUnit(s, 40 + l) < 0.8f) f.shade[l][s] = uint32_t(randomUnit(s, 50 + l) * 51);
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
inline void addBatch(Device& device, Film& film, const FrameSamples& f, size_t first, size_t count) {
  const size_t per_block = size_t(kBlockArea) * f.samples_per_pixel;
  const size_t slot = first * per_block, slots = count * per_block;
  const auto blocks = std::span(f.blocks).subspan(first, count);
  FilmSamples shared;
  shared.position = upload(device, f.position, slot, slots, "position");
  shared.coverage = upload(device, f.coverage, slot, slots, "coverage");
  shared.normal = upload(device, f.normal, slot, slots, "normal");
  const Buffer<Vec3f> radiance = upload(device, f.radiance, 0, f.radiance.size(), "radiance");
  film.addDepth(blocks, std::span(f.depth).subspan(first * kBlockArea, count * kBlockArea));
  for (uint32_t layer = 0; layer < f.layers; ++layer) {
    AaSamples aa;
    aa.count = uint32_t(slots);
    aa.samples_per_pixel = f.samples_per_pixel;
    aa.throughput = upload(device, f.throughput[layer], slot, slots, "throughput");
    aa.shade = upload(device, f.shade[layer], slot, slots, "shade");
    if (layer == 0) film.addFirstLayer(blocks, shared, aa, radiance);
    if (layer != 0) film.addLayer(layer, blocks, shared, aa, radiance);
  }
}

// An image of the whole frame; `set` counts how often each pixel was put in place.
struct FrameImages : FilmImages {
  std::vector<uint32_t> set;
};

inline FrameImages emptyImages(int32_t width, int32_t height, uint32_t layers) {
  const size_t pixels = size_t(width) * size_t(height);
  FrameImages images;
  images.rect = {0, 0, width, height};
  images.layers.assign(layers, std::vector<Vec3f>(pixels));
  images.composite.resize(pixels);
  images.alpha.resize(pixels);
  images.depth.assign(pixels, kInfinity);
  images.normal.resize(pixels);
  images.set.resize(pixels);
  return images;
}

inline void place(FrameImages& frame, const FilmImages& part) {
  const PixelRect& r = part.rect;
  ASSERT_EQ(part.composite.size(), r.area());
  for (size_t i = 0; i < r.area(); ++i) {
    const size_t to = (size_t(r.y0) + i / r.width()) * frame.rect.width() + size_t(r.x0) + i % r.width();
    for (size_t l = 0; l < frame.layers.size(); ++l) frame.layers[l][to] = part.layers[l][i];
    frame.composite[to] = part.composite[i];
    frame.alpha[to] = part.alpha[i];
    frame.depth[to] = part.depth[i];
    frame.normal[to] = part.normal[i];
    ++frame.set[to];
  }
}

// Renders the frame, tile by tile, in batches of so many blocks.
inline FrameImages filmImages(Device& device, const FrameSamples& f, FilterKind kind, float radius, size_t batch,
                              uint64_t* non_finite = nullptr) {
  Film film(device, uint32_t(f.width), uint32_t(f.height), kind, radius, f.layers, f.samples_per_pixel);
  FrameImages images = emptyImages(f.width, f.height, f.layers);
  for (const FrameTile& tile : f.tiles) {
    film.beginTile(tile.rect);
    for (size_t first = 0; first < tile.blocks; first += batch) {
      addBatch(device, film, f, tile.first_block + first, std::min(batch, tile.blocks - first));
    }
    place(images, film.finishTile());
  }
  if (non_finite) *non_finite = film.nonFiniteSamples();
  for (const uint32_t times : images.set) EXPECT_EQ(times, 1u);
  return images;
}

template <class T>
void expectSameBits(const std::vector<T>& a, const std::vector<T>& b, const char* what) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(std::memcmp(&a[i], &b[i], sizeof(T)), 0) << what << ", pixel " << i;
  }
}

inline void expectSameBits(const FilmImages& a, const FilmImages& b) {
  ASSERT_EQ(a.layers.size(), b.layers.size());
  for (size_t l = 0; l < a.layers.size(); ++l) expectSameBits(a.layers[l], b.layers[l], "layer");
  expectSameBits(a.composite, b.composite, "composite");
  expectSameBits(a.alpha, b.alpha, "alpha");
  expectSameBits(a.normal, b.normal, "normal");
  expectSameBits(a.depth, b.depth, "depth");
}

}  // namespace encore
