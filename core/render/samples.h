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
  PixelRect rect;
  std::vector<BlockOrigin> blocks;
};
// Tiles of the image in row order, anchored at its origin; every block of the image is in exactly one.
std::vector<ReuseTile> reuseTiles(const Settings& settings);

// Rays of some blocks, in block order. ends[b] is the end of block b's rays.
struct BlockRays {
  std::vector<FirstHit> first;
  std::vector<uint32_t> ends;
};

// Shading rays of each block: the points of a scrambled (0, 2)-sequence over it with an index below
// shadingRayCount(), so that any rate is stratified and the points of a lower rate are among those of a higher
// one. FirstHit::sample is the index; points outside of the image are left out.
BlockRays generateShadingRays(const Settings& settings, std::span<const BlockOrigin> blocks, float rate);

// kBlockArea * rate, rounded up or down by chance, so that its mean over blocks is exact. The same chance for
// every rate: not falling in it.
uint32_t shadingRayCount(const Settings& settings, BlockOrigin block, float rate);
// The most that there can be.
uint32_t mostShadingRays(float rate);

}  // namespace encore
