#include "core/render/samples.h"

#include <tbb/parallel_for.h>

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

void antialiasPixel(const Settings& settings, uint32_t x, uint32_t y, std::span<FirstHit> first,
                    std::span<uint32_t> position) {
  const uint32_t n = settings.samples;
  const bool inside = x < settings.width && y < settings.height;
  const uint32_t pixel = y * settings.width + x;
  for (uint32_t s = 0; s < n * n; ++s) {
    const auto random = pcg4d(pixel, s, uint32_t(RandomUse::FilmPosition), settings.seed);
    const uint32_t fx = std::min(65535u, uint32_t((float(s % n) + toUnit(random[0])) / float(n) * 65536.0f));
    const uint32_t fy = std::min(65535u, uint32_t((float(s / n) + toUnit(random[1])) / float(n) * 65536.0f));
    position[s] = fy << 16 | fx;
    FirstHit& f = first[s];
    f.film_x = float(x) + float(fx) * 0x1p-16f;
    f.film_y = float(y) + float(fy) * 0x1p-16f;
    f.pixel = pixel;
    f.sample = s;
    f.active = inside;
  }
}

}  // namespace

std::vector<ReuseTile> reuseTiles(const Settings& settings) {
  std::vector<ReuseTile> tiles;
  const uint32_t side = settings.reuse_tile_pixels;
  for (uint32_t ty = 0; ty < settings.height; ty += side)
    for (uint32_t tx = 0; tx < settings.width; tx += side) {
      ReuseTile& tile = tiles.emplace_back();
      for (uint32_t y = ty; y < std::min(ty + side, settings.height); y += kBlockPixels)
        for (uint32_t x = tx; x < std::min(tx + side, settings.width); x += kBlockPixels) tile.blocks.push_back({x, y});
    }
  return tiles;
}

BlockRays generateShadingRays(const Settings& settings, std::span<const BlockOrigin> blocks) {
  BlockRays rays;
  for (const BlockOrigin block : blocks) {
    const uint32_t key = blockKey(settings, block);
    const auto random = pcg4d(key, 0, uint32_t(RandomUse::Seed), settings.seed);
    // Rounds the expected number up or down by chance, so that its mean over blocks is exact.
    const float expected = settings.shading_rate * float(kBlockArea);
    const uint32_t count = uint32_t(std::floor(expected + toUnit(random[0])));
    for (uint32_t j = 0; j < count; ++j) {
      const Vec2f p = sobol2(j, random[1]);
      FirstHit f;
      f.film_x = float(block.x) + p.x * float(kBlockPixels);
      f.film_y = float(block.y) + p.y * float(kBlockPixels);
      f.pixel = key;
      f.sample = j;
      f.active = f.film_x < float(settings.width) && f.film_y < float(settings.height);
      if (f.active) rays.first.push_back(f);
    }
    rays.ends.push_back(uint32_t(rays.first.size()));
  }
  return rays;
}

BlockRays generateAntialiasRays(const Settings& settings, std::span<const BlockOrigin> blocks,
                                std::span<uint32_t> position) {
  const size_t per_pixel = size_t(settings.samples) * settings.samples;
  const size_t per_block = per_pixel * kBlockArea;
  BlockRays rays;
  rays.first.resize(blocks.size() * per_block);
  for (size_t b = 1; b <= blocks.size(); ++b) rays.ends.push_back(uint32_t(b * per_block));
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
    for (uint32_t p = 0; p < kBlockArea; ++p) {
      const size_t slot = b * per_block + p * per_pixel;
      antialiasPixel(settings, blocks[b].x + p % kBlockPixels, blocks[b].y + p / kBlockPixels,
                     std::span(rays.first).subspan(slot, per_pixel), position.subspan(slot, per_pixel));
    }
  });
  return rays;
}

}  // namespace encore
