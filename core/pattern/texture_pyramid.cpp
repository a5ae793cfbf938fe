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

// A row of a level from the rows that source gives of the level before.
void averageRow(const PyramidSource& source, PyramidLevel from, PyramidLevel to, uint32_t y, float* row) {
  const Coverage cy = coverage(y, from.height, to.height);
  std::vector<float> room(uint64_t(from.width) * 4);
  std::fill(row, row + uint64_t(to.width) * 4, 0.0f);
  for (uint32_t j = 0; j < cy.count; ++j) {
    const float* texels = source.row(cy.first + j, room);
    for (uint32_t x = 0; x < to.width; ++x) {
      const Coverage cx = coverage(x, from.width, to.width);
      const float* texel = texels + uint64_t(cx.first) * 4;
      for (uint32_t i = 0; i < cx.count; ++i, texel += 4)
        for (uint32_t c = 0; c < 4; ++c) row[uint64_t(x) * 4 + c] += cy.weight[j] * cx.weight[i] * texel[c];
    }
  }
}

void storeRow(const float* values, uint32_t width, uint32_t y, std::span<uint16_t> level) {
  uint16_t* halves = &level[uint64_t(y) * width * 4];
  for (uint64_t i = 0; i < uint64_t(width) * 4; ++i) halves[i] = toHalf(values[i]);
}

class FloatRows : public PyramidSource {
 public:
  FloatRows(std::span<const float> rgba, uint32_t width) : rgba_(rgba), width_(width) {}
  const float* row(uint32_t y, std::span<float>) const override { return &rgba_[uint64_t(y) * width_ * 4]; }

 private:
  std::span<const float> rgba_;
  uint32_t width_;
};

class HalfRows : public PyramidSource {
 public:
  HalfRows(std::span<const uint16_t> rgba, uint32_t width) : rgba_(rgba), width_(width) {}
  const float* row(uint32_t y, std::span<float> room) const override {
    const uint16_t* halves = &rgba_[uint64_t(y) * width_ * 4];
    for (uint64_t i = 0; i < uint64_t(width_) * 4; ++i) room[i] = fromHalf(halves[i]);
    return room.data();
  }

 private:
  std::span<const uint16_t> rgba_;
  uint32_t width_;
};

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

float fromHalf(uint16_t half) {
  const uint32_t sign = uint32_t(half & 0x8000u) << 16, magnitude = half & 0x7fffu;
  if (magnitude >= 0x7c00u) return std::bit_cast<float>(sign | 0x7f800000u | (magnitude & 0x3ffu) << 13);
  if (magnitude < 0x400u) return std::copysign(float(magnitude) * 0x1p-24f, sign ? -1.0f : 1.0f);
  return std::bit_cast<float>(sign | ((magnitude << 13) + (112u << 23)));
}

void buildPyramid(const PyramidSource& source, uint32_t width, uint32_t height,
                  std::span<const std::span<uint16_t>> levels) {
  const std::vector<PyramidLevel> sizes = pyramidLevels(width, height);
  if (!levels[0].empty())
    tbb::parallel_for(0u, height, [&](uint32_t y) {
      std::vector<float> room(uint64_t(width) * 4);
      storeRow(source.row(y, room), width, y, levels[0]);
    });
  std::vector<float> finer;  // the level before, from level 1 on
  for (size_t level = 1; level < levels.size(); ++level) {
    const PyramidLevel from = sizes[level - 1], to = sizes[level];
    const FloatRows rows(finer, from.width);
    const PyramidSource& before = level == 1 ? source : rows;
    std::vector<float> coarser(to.texels() * 4);
    tbb::parallel_for(0u, to.height, [&](uint32_t y) {
      float* row = &coarser[uint64_t(y) * to.width * 4];
      averageRow(before, from, to, y, row);
      if (!levels[level].empty()) storeRow(row, to.width, y, levels[level]);
    });
    finer = std::move(coarser);
  }
}

void buildPyramid(const Texture& texture, std::span<const std::span<uint16_t>> levels) {
  buildPyramid(FloatRows(texture.rgba, texture.width), texture.width, texture.height, levels);
}

void buildPyramid(std::span<const uint16_t> rgba, uint32_t width, uint32_t height,
                  std::span<const std::span<uint16_t>> levels) {
  buildPyramid(HalfRows(rgba, width), width, height, levels);
}

}  // namespace encore
