// Plain loops in double precision that shaders/pattern/texture.glsl and core/pattern/texture_pyramid.cpp
// must agree with, up to the rounding of texels to half floats.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/scene/material.h"

namespace encore::twin {

using Texel = std::array<double, 4>;

struct Level {
  int width = 0, height = 0;
  std::vector<Texel> texels;
};

// Length that source texel j and target texel i have in common, as a share of the target texel.
inline double overlap(int i, int target, int j, int source) {
  const double begin = std::max(double(i) / target, double(j) / source);
  const double end = std::min(double(i + 1) / target, double(j + 1) / source);
  return std::max(0.0, end - begin) * target;
}

inline Level halve(const Level& finer) {
  Level level{std::max(1, finer.width / 2), std::max(1, finer.height / 2), {}};
  for (int y = 0; y < level.height; ++y)
    for (int x = 0; x < level.width; ++x) {
      Texel sum{};
      for (int j = 0; j < finer.height; ++j) {
        const double weight_y = overlap(y, level.height, j, finer.height);
        for (int i = 0; weight_y > 0 && i < finer.width; ++i) {
          const double weight = weight_y * overlap(x, level.width, i, finer.width);
          for (int c = 0; c < 4; ++c) sum[size_t(c)] += weight * finer.texels[size_t(j * finer.width + i)][size_t(c)];
        }
      }
      level.texels.push_back(sum);
    }
  return level;
}

inline std::vector<Level> pyramid(const Texture& texture) {
  Level finest{int(texture.width), int(texture.height), {}};
  for (size_t i = 0; i < texture.rgba.size(); i += 4)
    finest.texels.push_back({texture.rgba[i], texture.rgba[i + 1], texture.rgba[i + 2], texture.rgba[i + 3]});
  std::vector<Level> levels{finest};
  while (levels.back().width > 1 || levels.back().height > 1) levels.push_back(halve(levels.back()));
  return levels;
}

// Index of the texel that lies at i on an endless line of texels; -1: black.
inline int64_t wrap(int64_t i, int64_t size, WrapMode mode) {
  const auto modulo = [](int64_t a, int64_t b) { return ((a % b) + b) % b; };
  switch (mode) {
    case WrapMode::Black:
      return i < 0 || i >= size ? -1 : i;
    case WrapMode::Clamp:
      return std::clamp<int64_t>(i, 0, size - 1);
    case WrapMode::Repeat:
      return modulo(i, size);
    case WrapMode::Mirror:
      return modulo(i, 2 * size) < size ? modulo(i, 2 * size) : 2 * size - 1 - modulo(i, 2 * size);
  }
  return -1;
}

inline Texel bilinear(const Level& level, double s, double t, WrapMode wrap_s, WrapMode wrap_t) {
  const double x = s * level.width - 0.5, y = t * level.height - 0.5;
  const int64_t x0 = int64_t(std::floor(x)), y0 = int64_t(std::floor(y));
  Texel sum{};
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 2; ++i) {
      const int64_t column = wrap(x0 + i, level.width, wrap_s), row = wrap(y0 + j, level.height, wrap_t);
      if (column < 0 || row < 0) continue;
      const double weight = (i ? x - double(x0) : 1 - (x - double(x0))) * (j ? y - double(y0) : 1 - (y - double(y0)));
      for (size_t c = 0; c < 4; ++c) sum[c] += weight * level.texels[size_t(row * level.width + column)][c];
    }
  return sum;
}

struct Filter {
  double texels_per_footprint;
  int taps_across;
};
inline constexpr Filter kShadingFilter{2, 2}, kPathFilter{1.75, 1};

// The node's output for finite coordinates.
inline Texel evaluate(const std::vector<Level>& levels, const PatternNode& node, Vec2f st, Vec2f dstdx, Vec2f dstdy,
                      Filter filter = kShadingFilter) {
  const auto& m = node.st_transform;
  const double width = levels[0].width, height = levels[0].height;
  const double s = double(m[0]) * st.x + double(m[1]) * st.y + m[2];
  const double t = double(m[3]) * st.x + double(m[4]) * st.y + m[5];
  const double ax = (double(m[0]) * dstdx.x + double(m[1]) * dstdx.y) * width;
  const double ay = (double(m[3]) * dstdx.x + double(m[4]) * dstdx.y) * height;
  const double bx = (double(m[0]) * dstdy.x + double(m[1]) * dstdy.y) * width;
  const double by = (double(m[3]) * dstdy.x + double(m[4]) * dstdy.y) * height;

  // Axes of the ellipse J u, |u| = 1: singular values of J = (a b), and the direction of the longer axis.
  const double p = ax * ax + bx * bx, q = ax * ay + bx * by, r = ay * ay + by * by;
  const bool circle = std::hypot(0.5 * (p - r), q) <= 1e-3 * 0.5 * (p + r);
  const double angle = circle ? std::atan2(ay, ax) : 0.5 * std::atan2(2 * q, p - r);
  const double major =
      std::hypot(std::cos(angle) * ax + std::sin(angle) * ay, std::cos(angle) * bx + std::sin(angle) * by);
  const double minor =
      std::hypot(std::cos(angle) * ay - std::sin(angle) * ax, std::cos(angle) * by - std::sin(angle) * bx);

  const double texel = std::max(std::max(minor, major / 8) / filter.texels_per_footprint, 1.0);
  const double lod = std::min(std::log2(texel), double(levels.size() - 1));
  const int along = int(std::clamp(std::ceil(major / texel - 1e-3), 1.0, 8 * filter.texels_per_footprint));
  const int across = int(std::clamp(std::ceil(minor / texel - 1e-3), 1.0, double(filter.taps_across)));
  const size_t fine = size_t(lod), coarse = std::min(fine + 1, levels.size() - 1);

  Texel sum{};
  for (int tap = 0; tap < along * across; ++tap) {
    const double u = ((tap % along + 0.5) / along - 0.5) * major, v = ((tap / along + 0.5) / across - 0.5) * minor;
    const double at_s = s + (u * std::cos(angle) - v * std::sin(angle)) / width;
    const double at_t = t + (u * std::sin(angle) + v * std::cos(angle)) / height;
    const Texel near = bilinear(levels[fine], at_s, at_t, node.wrap_s, node.wrap_t);
    const Texel far = bilinear(levels[coarse], at_s, at_t, node.wrap_s, node.wrap_t);
    for (size_t c = 0; c < 4; ++c) sum[c] += (near[c] + (far[c] - near[c]) * (lod - double(fine))) / (along * across);
  }
  for (size_t c = 0; c < 4; ++c) sum[c] = sum[c] * node.scale[c] + node.bias[c];
  return sum;
}

// Index into node.udim of the tile at finite coordinates, with a texture, or -1. Where there is none at a border, the
// tile on its left, below, or both.
inline int32_t udimTile(const PatternNode& node, Vec2f st) {
  const auto& m = node.st_transform;
  const float s = m[0] * st.x + m[1] * st.y + m[2], t = m[3] * st.x + m[4] * st.y + m[5];
  const auto at = [&](double column, double row) {
    const double index = column + 10 * row;
    if (column < 0 || column > 9 || row < 0 || index >= double(node.udim.size())) return -1;
    return node.udim[size_t(index)] < 0 ? -1 : int32_t(index);
  };
  const double column = std::floor(s), row = std::floor(t);
  const double left = column == s ? column - 1 : column, below = row == t ? row - 1 : row;
  for (int32_t tile : {at(column, row), at(left, row), at(column, below), at(left, below)})
    if (tile >= 0) return tile;
  return -1;
}

// The node's output within a tile.
inline Texel evaluateUdim(const std::vector<Level>& levels, PatternNode node, int32_t tile, Vec2f st, Vec2f dstdx,
                          Vec2f dstdy) {
  node.st_transform[2] -= float(tile % 10);
  node.st_transform[5] -= float(tile / 10);
  node.wrap_s = node.wrap_t = WrapMode::Clamp;
  return evaluate(levels, node, st, dstdx, dstdy);
}

}  // namespace encore::twin
