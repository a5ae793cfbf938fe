// Where the antialiasing samples of a block lie: on the film, among its slots, and in its packets.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <vector>

#include "core/path/film_keys.h"
#include "core/scene/block.h"
#include "core/scene/random.h"
#include "core/scene/settings.h"
#include "shaders/records.h"

namespace encore {

// The strata of a pixel: samples × samples squares, of which sample s has that in column s % samples and row
// s / samples, and within it a column and a row that no other sample has, so that the samples stratify in x and in y
// alone as well (correlated multi-jittered sampling: Kensler, Pixar TM 13-01). Which ones those are is one of a few
// permutations each, chosen by the pixel.
class Strata {
 public:
  explicit Strata(uint32_t samples)
      : samples_(samples), count_(samples * samples), patterns_(std::bit_floor(std::clamp(4096 / count_, 8u, 64u))) {
    for (uint32_t pattern = 0; pattern < patterns_; ++pattern) {
      const std::vector<uint32_t> across = permutation(2 * pattern), down = permutation(2 * pattern + 1);
      for (uint32_t s = 0; s < count_; ++s) {
        columns_.push_back(float(s % samples * samples + across[s / samples]));
        rows_.push_back(float(s / samples * samples + down[s % samples]));
      }
    }
  }
  uint32_t count() const { return count_; }
  float across() const { return float(count_); }  // columns, and rows, of a pixel

  // The column and the row of each sample of a pixel.
  struct Pattern {
    const float *column, *row;
  };
  Pattern pattern(uint32_t pixel, uint32_t seed) const {
    const auto random = pcg4d(pixel, 0xffffffffu, uint32_t(RandomUse::FilmPosition), seed);
    return {&columns_[size_t(random[0] & (patterns_ - 1)) * count_],
            &rows_[size_t(random[1] & (patterns_ - 1)) * count_]};
  }

 private:
  // Of 0 ... samples - 1 (Fisher & Yates).
  std::vector<uint32_t> permutation(uint32_t index) const {
    std::vector<uint32_t> order(samples_);
    for (uint32_t i = 0; i < samples_; ++i) {
      const uint32_t other = pcg4d(index, i, samples_, 0x5bd1e995u)[0] % (i + 1);
      order[i] = order[other];
      order[other] = i;
    }
    return order;
  }

  uint32_t samples_, count_, patterns_;  // patterns_: a power of two
  std::vector<float> columns_, rows_;    // of every pattern
};

// In units of 2^-16 pixels: film and ray use the same rounded numbers. Signed integers, because vector
// instructions convert no others; all of them are small.
inline uint32_t jittered(float stratum, uint32_t random, float across) {
  const float unit = float(int32_t(random >> 8)) * 0x1p-24f;  // toUnit()
  const int32_t offset = int32_t((stratum + unit) / across * 65536.0f);
  return uint32_t(offset < 65535 ? offset : 65535);
}
// column, row, across: of Strata.
inline uint32_t jitteredPosition(float column, float row, float across, uint32_t pixel, uint32_t s, uint32_t seed) {
  const auto random = pcg4d(pixel, s, uint32_t(RandomUse::FilmPosition), seed);
  return jittered(row, random[1], across) << 16 | jittered(column, random[0], across);
}
inline float filmX(int32_t x, uint32_t position) { return float(x) + float(int32_t(position & 0xffffu)) * 0x1p-16f; }
inline float filmY(int32_t y, uint32_t position) { return float(y) + float(int32_t(position >> 16)) * 0x1p-16f; }

// Where the samples of a block stand: among its slots, and in the sequence that packets are cut from.
struct BlockLayout {
  int32_t x0, y0;
  uint32_t width, height;  // pixels inside of the image; of a block of the overscan, all of them
  uint32_t per_pixel;
  bool of_image;
  uint32_t image_width;

  BlockLayout(BlockOrigin block, const Settings& settings)
      : x0(block.x),
        y0(block.y),
        width(extent(block.x, settings.width)),
        height(extent(block.y, settings.height)),
        per_pixel(settings.samples * settings.samples),
        of_image(isOfImage(block.x, settings.width) && isOfImage(block.y, settings.height)),
        image_width(settings.width) {}

  static uint32_t extent(int32_t at, uint32_t size) {
    return isOfImage(at, size) ? std::min(kBlockPixels, size - uint32_t(at)) : kBlockPixels;
  }
  // pixelKey() of pixels inside.
  uint32_t key(uint32_t px, uint32_t py) const {
    if (!of_image) return overscanKey(x0 + int32_t(px), y0 + int32_t(py));
    return (uint32_t(y0) + py) * image_width + uint32_t(x0) + px;
  }
  bool inside(uint32_t px, uint32_t py) const { return px < width && py < height; }
  uint32_t slots() const { return kBlockArea * per_pixel; }
  uint32_t length() const { return width * height * per_pixel; }  // of the sequence
  // Slot of the block and place in the sequence, one from the other, for pixels inside.
  uint32_t place(uint32_t slot) const {
    const uint32_t pixel = slot / per_pixel, px = pixel % kBlockPixels, py = pixel / kBlockPixels;
    return (py * width + px) * per_pixel + slot % per_pixel;
  }
  uint32_t slot(uint32_t place) const {
    const uint32_t pixel = place / per_pixel, px = pixel % width, py = pixel / width;
    return (py * kBlockPixels + px) * per_pixel + place % per_pixel;
  }
};

}  // namespace encore
