#include "core/pattern/texture_pyramid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>

namespace encore {
namespace {

// Which texels of a side of `from` one texel of a side of `to` covers, and their shares, which add up to 1.
struct Coverage {
  uint32_t first = 0, count = 0;
  float weight[4] = {};  // from / to is below 3 where to is from / 2 rounded down, or 3 for 3 → 1
};

// In units of 1 / to of a source texel, all overlaps are integers.
Coverage coverage(uint32_t index, uint32_t from, uint32_t to) {
  const uint64_t begin = uint64_t(index) * from, end = begin + from;
  Coverage c;
  c.first = uint32_t(begin / to);
  for (uint64_t i = c.first; i * to < end; ++i) {
    const uint64_t overlap = std::min(end, (i + 1) * to) - std::max(begin, i * to);
    c.weight[c.count++] = float(double(overlap) / double(from));
  }
  return c;
}

void averageRow(std::span<const float> from, PyramidLevel from_size, PyramidLevel to_size, uint32_t y, float* row) {
  const Coverage cy = coverage(y, from_size.height, to_size.height);
  for (uint32_t x = 0; x < to_size.width; ++x) {
    const Coverage cx = coverage(x, from_size.width, to_size.width);
    float sum[4] = {};
    for (uint32_t j = 0; j < cy.count; ++j) {
      const float* texel = &from[(uint64_t(cy.first + j) * from_size.width + cx.first) * 4];
      for (uint32_t i = 0; i < cx.count; ++i, texel += 4)
        for (uint32_t c = 0; c < 4; ++c) sum[c] += cy.weight[j] * cx.weight[i] * texel[c];
    }
    std::copy(sum, sum + 4, row + uint64_t(x) * 4);
  }
}

void storeHalves(std::span<const float> values, std::span<uint16_t> halves) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, values.size(), 1 << 16), [&](const auto& range) {
    for (size_t i = range.begin(); i < range.end(); ++i) halves[i] = toHalf(values[i]);
  });
}

}  // namespace

std::vector<PyramidLevel> pyramidLevels(uint32_t width, uint32_t height) {
  std::vector<PyramidLevel> levels{{width, height}};
  while (levels.back().width > 1 || levels.back().height > 1)
    levels.push_back({std::max(levels.back().width / 2, 1u), std::max(levels.back().height / 2, 1u)});
  return levels;
}

uint16_t toHalf(float value) {
  const uint16_t sign = uint16_t((std::bit_cast<uint32_t>(value) >> 16) & 0x8000u);
  float magnitude = std::abs(value);
  if (!(magnitude < 65504.0f)) magnitude = 65504.0f;
  if (magnitude < 0x1p-14f)  // adding 0.5 leaves the denormal's ten bits, rounded, at the lower end
    return uint16_t(sign | (std::bit_cast<uint32_t>(magnitude + 0.5f) - std::bit_cast<uint32_t>(0.5f)));
  uint32_t bits = std::bit_cast<uint32_t>(magnitude);
  bits += 0xfffu + ((bits >> 13) & 1u);  // half of the last place kept, ties to even
  return uint16_t(sign | ((bits - (112u << 23)) >> 13));
}

void buildPyramid(const Texture& texture, std::span<const std::span<uint16_t>> levels) {
  const std::vector<PyramidLevel> sizes = pyramidLevels(texture.width, texture.height);
  storeHalves(texture.rgba, levels[0]);
  std::span<const float> finer = texture.rgba;
  std::vector<float> kept;  // the memory behind finer, from level 1 on
  for (size_t level = 1; level < sizes.size(); ++level) {
    const PyramidLevel from = sizes[level - 1], to = sizes[level];
    std::vector<float> coarser(to.texels() * 4);
    tbb::parallel_for(0u, to.height,
                      [&](uint32_t y) { averageRow(finer, from, to, y, &coarser[uint64_t(y) * to.width * 4]); });
    storeHalves(coarser, levels[level]);
    kept = std::move(coarser);
    finer = kept;
  }
}

}  // namespace encore
