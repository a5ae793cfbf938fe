// Mip pyramids of textures as half floats: what shaders/pattern/texture.glsl reads.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene/material.h"

namespace encore {

struct PyramidLevel {
  uint32_t width = 0, height = 0;
  uint64_t texels() const { return uint64_t(width) * height; }
};

// Sizes from the texture itself down to 1 × 1; each side is half of the one before, rounded down.
std::vector<PyramidLevel> pyramidLevels(uint32_t width, uint32_t height);

// The nearest half float (ties to even) as bits. Beyond the largest, ±65504, and NaN: the largest.
uint16_t toHalf(float value);

float fromHalf(uint16_t half);  // exact

// Where a pyramid starts: rows of pixels, four channels each, bottom row first.
class PyramidSource {
 public:
  virtual ~PyramidSource() = default;
  // Row y as single precision: memory of the source's own, or `room` (4 floats per pixel), filled. Thread-safe.
  virtual const float* row(uint32_t y, std::span<float> room) const = 0;
};

// Fills levels[i] with the texels of pyramidLevels(width, height)[i], four halves each; levels that are empty are not
// wanted, and those beyond the last are not made. A texel of a coarser level is the mean of the area that it covers of
// the level before, in linear light and in single precision, so that means are preserved for odd sizes too. In
// parallel; the result does not depend on the number of threads.
void buildPyramid(const PyramidSource& source, uint32_t width, uint32_t height,
                  std::span<const std::span<uint16_t>> levels);
// The same from all pixels of a texture. Precondition: it has them.
void buildPyramid(const Texture& texture, std::span<const std::span<uint16_t>> levels);
// The same from half floats.
void buildPyramid(std::span<const uint16_t> rgba, uint32_t width, uint32_t height,
                  std::span<const std::span<uint16_t>> levels);

}  // namespace encore
