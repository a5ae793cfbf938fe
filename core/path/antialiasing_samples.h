// Where the antialiasing samples of a block lie: on the film, among its slots, and in its packets.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/scene/block.h"
#include "core/scene/random.h"
#include "core/scene/settings.h"
#include "shaders/records.h"

namespace encore {

// The jittered strata of a pixel; the same in every pixel but for the random numbers.
struct Strata {
  float across;                    // of a pixel
  std::vector<float> column, row;  // of each sample

  explicit Strata(uint32_t samples) : across(float(samples)) {
    for (uint32_t s = 0; s < samples * samples; ++s) {
      column.push_back(float(s % samples));
      row.push_back(float(s / samples));
    }
  }
  uint32_t count() const { return uint32_t(column.size()); }
};

// In units of 2^-16 pixels: film and ray use the same rounded numbers. Signed integers, because vector
// instructions convert no others; all of them are small.
inline uint32_t jittered(float stratum, uint32_t random, float across) {
  const float unit = float(int32_t(random >> 8)) * 0x1p-24f;  // toUnit()
  const int32_t offset = int32_t((stratum + unit) / across * 65536.0f);
  return uint32_t(offset < 65535 ? offset : 65535);
}
inline uint32_t jitteredPosition(float column, float row, float across, uint32_t pixel, uint32_t s, uint32_t seed) {
  const auto random = pcg4d(pixel, s, uint32_t(RandomUse::FilmPosition), seed);
  return jittered(row, random[1], across) << 16 | jittered(column, random[0], across);
}
inline float filmX(uint32_t x, uint32_t position) { return float(x) + float(int32_t(position & 0xffffu)) * 0x1p-16f; }
inline float filmY(uint32_t y, uint32_t position) { return float(y) + float(int32_t(position >> 16)) * 0x1p-16f; }

// Where the samples of a block stand: among its slots, and in the sequence that packets are cut from.
struct BlockLayout {
  uint32_t x0, y0, width, height;  // pixels inside of the image
  uint32_t per_pixel;

  BlockLayout(BlockOrigin block, const Settings& settings)
      : x0(block.x),
        y0(block.y),
        width(block.x < settings.width ? std::min(kBlockPixels, settings.width - block.x) : 0),
        height(block.y < settings.height ? std::min(kBlockPixels, settings.height - block.y) : 0),
        per_pixel(settings.samples * settings.samples) {}

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
