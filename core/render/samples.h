// Where shading rays and antialiasing rays start (§2.1).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/film/film.h"
#include "core/path/path.h"

namespace encore {

// A reuse tile: the blocks, in row order, whose samples search each other's shading (design: Reuse tile).
struct ReuseTile {
  std::vector<BlockOrigin> blocks;
};
// Tiles of the image in row order, anchored at its origin; every block of the image is in exactly one.
std::vector<ReuseTile> reuseTiles(const Settings& settings);

// Rays of some blocks, in block order. ends[b] is the end of block b's rays.
struct BlockRays {
  std::vector<FirstHit> first;
  std::vector<uint32_t> ends;
};

// Shading rays: the first 256 · shading_rate points of a scrambled (0, 2)-sequence over each block, so
// that any rate is stratified and the points of a lower rate are among those of a higher one.
BlockRays generateShadingRays(const Settings& settings, std::span<const BlockOrigin> blocks);

// Antialiasing rays: samples × samples jittered strata in every pixel, in slot order (core/reuse), with
// the inactive slots of pixels outside of the image. position receives the offsets within the pixels in
// units of 2^-16: film and ray use the same rounded numbers.
BlockRays generateAntialiasRays(const Settings& settings, std::span<const BlockOrigin> blocks,
                                std::span<uint32_t> position);

}  // namespace encore
