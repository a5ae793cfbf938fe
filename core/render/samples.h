// Where shading rays and antialiasing rays start (§2.1), in the window that is rendered.
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
  std::vector<BlockOrigin> blocks;    // all of them: every one has seeds
  std::vector<BlockOrigin> rendered;  // those with antialiasing samples that reach the window
};

// Tiles that the window needs, in row order. Pixels are the same in every window, to the last bit:
//  - The image's tiles are anchored at its origin. Those of the overscan begin at the image's borders and lie around
//    it, so that no tile lies on both sides of a border, and filters do not reach across one either.
//  - All of a tile's seeds are shaded, however little of it the window shows; and all samples of a block are traced.
// Settings::window is that of a valid Settings, or empty.
std::vector<ReuseTile> reuseTiles(const Settings& settings);
// What the film of these tiles covers.
FilmArea filmArea(const Settings& settings);
PixelRect windowOf(const Settings& settings);
// Antialiasing samples of a block.
uint64_t blockSamples(const Settings& settings, BlockOrigin block);

// Rays of some blocks, in block order. ends[b] is the end of block b's rays.
struct BlockRays {
  std::vector<FirstHit> first;
  std::vector<uint32_t> ends;
};

// Shading rays of each block: the points of a scrambled (0, 2)-sequence over it with an index below
// shadingRayCount(), so that any rate is stratified and the points of a lower rate are among those of a higher
// one. FirstHit::sample is the index; points of the image's blocks that lie outside of it are left out.
BlockRays generateShadingRays(const Settings& settings, std::span<const BlockOrigin> blocks, float rate);

// kBlockArea * rate, rounded up or down by chance, so that its mean over blocks is exact. The same chance for
// every rate: not falling in it.
uint32_t shadingRayCount(const Settings& settings, BlockOrigin block, float rate);
// The most that there can be.
uint32_t mostShadingRays(float rate);

}  // namespace encore
