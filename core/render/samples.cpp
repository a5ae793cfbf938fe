#include "core/render/samples.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/path/antialiasing_samples.h"
#include "core/scene/random.h"

namespace encore {
namespace {

constexpr float kEverywhere = std::numeric_limits<float>::infinity();

// Numbers of a block: [0] rounds its count of shading rays, [1] scrambles their positions.
std::array<uint32_t, 4> blockRandom(const Settings& settings, BlockOrigin block) {
  return pcg4d(blockKey(settings, block), 0, uint32_t(RandomUse::Seed), settings.seed);
}

int32_t floorDivide(int32_t a, int32_t b) { return a / b - (a % b < 0 ? 1 : 0); }

// What lies between two borders, along one axis.
struct Part {
  int32_t begin, end;              // whole tiles
  int32_t reach_begin, reach_end;  // of the window's filters
};

// begin, end: of the window along the axis. size: of the image.
std::vector<Part> partsOf(int32_t begin, int32_t end, int32_t size, const Settings& settings) {
  const int32_t side = int32_t(settings.reuse_tile_pixels), pad = int32_t(filterPad(settings.filter_radius_pixels));
  constexpr int32_t kFar = 1 << 30;
  // Where each part begins and ends, and a corner of its tiles.
  const std::array<std::array<int32_t, 3>, 3> all{{{-kFar, 0, 0}, {0, size, 0}, {size, kFar, size}}};
  std::vector<Part> parts;
  for (const auto& [first, last, anchor] : all) {
    const int32_t from = std::max(begin, first), to = std::min(end, last);
    if (from >= to) continue;
    const int32_t reach_begin = std::max(from - pad, first), reach_end = std::min(to + pad, last);
    parts.push_back({anchor + floorDivide(reach_begin - anchor, side) * side,
                     std::min(last, anchor - floorDivide(anchor - reach_end, side) * side), reach_begin, reach_end});
  }
  return parts;
}

std::vector<Part> columnsOf(const Settings& settings) {
  const PixelRect window = windowOf(settings);
  return partsOf(window.x0, window.x1, int32_t(settings.width), settings);
}
std::vector<Part> rowsOf(const Settings& settings) {
  const PixelRect window = windowOf(settings);
  return partsOf(window.y0, window.y1, int32_t(settings.height), settings);
}

std::vector<int32_t> bordersOf(const std::vector<Part>& parts) {
  std::vector<int32_t> borders{parts.front().begin};
  for (const Part& part : parts) borders.push_back(part.end);
  return borders;
}

ReuseTile tileOf(PixelRect rect, const Part& column, const Part& row) {
  ReuseTile tile{rect, {}, {}};
  const int32_t side = int32_t(kBlockPixels);
  for (int32_t y = rect.y0; y < rect.y1; y += side)
    for (int32_t x = rect.x0; x < rect.x1; x += side) {
      tile.blocks.push_back({x, y});
      if (x < column.reach_end && x + side > column.reach_begin && y < row.reach_end && y + side > row.reach_begin)
        tile.rendered.push_back({x, y});
    }
  return tile;
}

}  // namespace

PixelRect windowOf(const Settings& settings) {
  const Window& w = settings.window;
  if (w.empty()) return {0, 0, int32_t(settings.width), int32_t(settings.height)};
  return {w.x0, w.y0, w.x1, w.y1};
}

uint64_t blockSamples(const Settings& settings, BlockOrigin block) { return BlockLayout(block, settings).length(); }

FilmArea filmArea(const Settings& settings) {
  return {bordersOf(columnsOf(settings)), bordersOf(rowsOf(settings)), windowOf(settings)};
}

std::vector<ReuseTile> reuseTiles(const Settings& settings) {
  const std::vector<Part> columns = columnsOf(settings), rows = rowsOf(settings);
  const int32_t side = int32_t(settings.reuse_tile_pixels);
  std::vector<ReuseTile> tiles;
  for (const Part& row : rows)
    for (int32_t y = row.begin; y < row.end; y += side)
      for (const Part& column : columns)
        for (int32_t x = column.begin; x < column.end; x += side)
          tiles.push_back(tileOf({x, y, std::min(x + side, column.end), std::min(y + side, row.end)}, column, row));
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
    const float end_x = isOfImage(block.x, settings.width) ? float(settings.width) : kEverywhere;
    const float end_y = isOfImage(block.y, settings.height) ? float(settings.height) : kEverywhere;
    for (uint32_t j = 0; j < count; ++j) {
      const Vec2f p = points.point(j);
      FirstHit f;
      f.film_x = float(block.x) + p.x * float(kBlockPixels);
      f.film_y = float(block.y) + p.y * float(kBlockPixels);
      f.pixel = blockKey(settings, block);
      f.sample = j;
      if (f.film_x < end_x && f.film_y < end_y) rays.first.push_back(f);
    }
    rays.ends.push_back(uint32_t(rays.first.size()));
  }
  return rays;
}

}  // namespace encore
