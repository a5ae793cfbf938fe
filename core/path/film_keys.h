// Random number keys of pixels and blocks in the plane of the image. They do not depend on the window.
#pragma once

#include <cstdint>

#include "core/scene/block.h"
#include "core/scene/random.h"
#include "core/scene/settings.h"
#include "shaders/records.h"

namespace encore {

// Keys from here on are those of blocks of seeds, whose samples have no strata; pixels take the lower half.
inline constexpr uint32_t kFirstBlockKey = 0x80000000u;

// Along one axis, of which the image takes [0, size).
inline bool isOfImage(int32_t at, uint32_t size) { return at >= 0 && at < int64_t{size}; }

// 30 bits for a place in the overscan: so few pixels share one that it cannot be seen.
inline uint32_t overscanKey(int32_t x, int32_t y) {
  return pcg4d(uint32_t(x), uint32_t(y), 0, uint32_t(RandomUse::FilmPosition))[0] >> 2;
}

inline uint32_t pixelKey(const Settings& settings, int32_t x, int32_t y) {
  if (isOfImage(x, settings.width) && isOfImage(y, settings.height)) return uint32_t(y) * settings.width + uint32_t(x);
  return overscanKey(x, y);
}

inline uint32_t blockKey(const Settings& settings, BlockOrigin block) {
  if (!isOfImage(block.x, settings.width) || !isOfImage(block.y, settings.height))
    return kFirstBlockKey | overscanKey(block.x, block.y);
  const uint32_t across = (settings.width + kBlockPixels - 1) / kBlockPixels;
  return kFirstBlockKey | (uint32_t(block.y) / kBlockPixels * across + uint32_t(block.x) / kBlockPixels);
}

}  // namespace encore
