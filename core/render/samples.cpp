#include "core/render/samples.h"

#include <algorithm>
#include <cmath>

#include "core/scene/random.h"

namespace encore {
namespace {

uint32_t blocksAcross(const Settings& settings) { return (settings.width + kBlockPixels - 1) / kBlockPixels; }

// Blocks take their random keys from the upper half of the range, pixels from the lower.
uint32_t blockKey(const Settings& settings, BlockOrigin block) {
  return 0x80000000u | (block.y / kBlockPixels * blocksAcross(settings) + block.x / kBlockPixels);
}

// Numbers of a block: [0] rounds its count of shading rays, [1] scrambles their positions.
std::array<uint32_t, 4> blockRandom(const Settings& settings, BlockOrigin block) {
  return pcg4d(blockKey(settings, block), 0, uint32_t(RandomUse::Seed), settings.seed);
}

}  // namespace

std::vector<ReuseTile> reuseTiles(const Settings& settings) {
  std::vector<ReuseTile> tiles;
  const uint32_t side = settings.reuse_tile_pixels;
  for (uint32_t ty = 0; ty < settings.height; ty += side)
    for (uint32_t tx = 0; tx < settings.width; tx += side) {
      ReuseTile& tile = tiles.emplace_back();
      tile.rect = {tx, ty, std::min(tx + side, settings.width), std::min(ty + side, settings.height)};
      for (uint32_t y = ty; y < std::min(ty + side, settings.height); y += kBlockPixels)
        for (uint32_t x = tx; x < std::min(tx + side, settings.width); x += kBlockPixels) tile.blocks.push_back({x, y});
    }
  return tiles;
}

uint32_t mostShadingRays(float rate) { return uint32_t(std::ceil(rate * float(kBlockArea))); }

uint32_t shadingRayCount(const Settings& settings, BlockOrigin block, float rate) {
  const float chance = toUnit(blockRandom(settings, block)[0]);
  return std::min(mostShadingRays(rate), uint32_t(std::floor(rate * float(kBlockArea) + chance)));
}

BlockRays generateShadingRays(const Settings& settings, std::span<const BlockOrigin> blocks, float rate) {
  BlockRays rays;
  for (const BlockOrigin block : blocks) {
    const uint32_t count = shadingRayCount(settings, block, rate);
    const Sobol2 points(blockRandom(settings, block)[1]);
    for (uint32_t j = 0; j < count; ++j) {
      const Vec2f p = points.point(j);
      FirstHit f;
      f.film_x = float(block.x) + p.x * float(kBlockPixels);
      f.film_y = float(block.y) + p.y * float(kBlockPixels);
      f.pixel = blockKey(settings, block);
      f.sample = j;
      if (f.film_x < float(settings.width) && f.film_y < float(settings.height)) rays.first.push_back(f);
    }
    rays.ends.push_back(uint32_t(rays.first.size()));
  }
  return rays;
}

}  // namespace encore
