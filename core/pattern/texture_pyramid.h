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

// Fills levels[i] with the texels of pyramidLevels()[i], four halves each. A texel of a coarser level is the
// mean of the area that it covers of the level before, in linear light and in single precision, so that means
// are preserved for odd sizes too. In parallel; the result does not depend on the number of threads.
void buildPyramid(const Texture& texture, std::span<const std::span<uint16_t>> levels);

}  // namespace encore
