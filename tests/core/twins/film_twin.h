// Twins of the film: forward splatting in double precision, and the film of a whole frame in the film's own
// order of additions.
#pragma once

#include <array>

#include "tests/core/film_samples.h"

namespace encore {

// Every sample goes to every pixel near it.
struct TwinImages {
  std::vector<std::vector<Vec3d>> layers;
  std::vector<double> alpha, weight;
  std::vector<Vec3d> normal;
};

inline TwinImages twinImages(const FrameSamples& f, FilterKind kind, float radius) {
  const size_t pixels = size_t(f.width) * size_t(f.height);
  TwinImages t{std::vector(f.layers, std::vector<Vec3d>(pixels)), std::vector<double>(pixels),
               std::vector<double>(pixels), std::vector<Vec3d>(pixels)};
  const int reach = int(std::ceil(radius)) + 1;
  for (size_t s = 0; s < f.slots(); ++s) {
    if (!f.inside(s)) continue;
    const BlockOrigin pixel = f.pixelOf(s);
    const double x = pixel.x + (f.position[s] & 0xffff) / 65536.0, y = pixel.y + (f.position[s] >> 16) / 65536.0;
    for (int j = std::max(0, int(pixel.y) - reach); j <= std::min(int(f.height) - 1, int(pixel.y) + reach); ++j) {
      for (int i = std::max(0, int(pixel.x) - reach); i <= std::min(int(f.width) - 1, int(pixel.x) + reach); ++i) {
        const double weight = double(filterWeight(kind, radius, float(i + 0.5 - x))) *
                              double(filterWeight(kind, radius, float(j + 0.5 - y)));
        const size_t to = size_t(j) * size_t(f.width) + size_t(i);
        t.weight[to] += weight;
        t.alpha[to] += weight * double(f.coverage[s]);
        t.normal[to] += toDouble(f.normal[s]) * weight;
        for (uint32_t l = 0; l < f.layers; ++l) {
          Vec3d value = toDouble(f.throughput[l][s]);
          if (f.shade[l][s] != kShadeNone) value *= toDouble(f.radiance[f.shade[l][s]]);
          t.layers[l][to] += value * weight;
        }
      }
    }
  }
  return t;
}

// Channels of a sample: normal, coverage, weight, then those of the layers.
inline std::vector<float> sampleChannels(const FrameSamples& f, size_t s) {
  std::vector<float> channels = {f.normal[s].x, f.normal[s].y, f.normal[s].z, f.coverage[s], 1};
  for (uint32_t l = 0; l < f.layers; ++l) {
    Vec3f value = f.throughput[l][s];
    if (f.shade[l][s] != kShadeNone) value *= f.radiance[f.shade[l][s]];
    channels.insert(channels.end(), {value.x, value.y, value.z});
  }
  return channels;
}

// Adds one block to planes of the whole frame: down each column of pixels into the columns around it, then those
// columns from left to right into the block's padded image, then that image into the frame.
inline void addBlock(const FrameSamples& f, size_t block, FilterKind kind, float radius,
                     std::vector<std::vector<float>>& planes) {
  const int pad = int(filterPad(radius)), taps = 2 * pad + 1, size = int(kBlockPixels), padded = size + 2 * pad;
  const auto at = [&](size_t channel, int tap, int row, int column) {
    return ((channel * size_t(taps) + size_t(tap)) * size_t(padded) + size_t(row)) * size_t(size) + size_t(column);
  };
  std::vector<float> columns(planes.size() * size_t(taps * padded * size));
  const size_t first = block * kBlockArea * f.samples_per_pixel;
  for (size_t s = first; s < first + kBlockArea * f.samples_per_pixel; ++s) {
    if (!f.inside(s)) continue;
    const int pixel = int((s - first) / f.samples_per_pixel), x = pixel % size, y = pixel / size;
    const float px = float(f.position[s] & 0xffff) / 65536, py = float(f.position[s] >> 16) / 65536;
    const std::vector<float> value = sampleChannels(f, s);
    for (int j = 0; j < taps; ++j) {
      for (int i = 0; i < taps; ++i) {
        const float weight = filterWeight(kind, radius, float(i - pad) + 0.5f - px) *
                             filterWeight(kind, radius, float(j - pad) + 0.5f - py);
        for (size_t c = 0; c < value.size(); ++c) columns[at(c, i, y + j, x)] += weight * value[c];
      }
    }
  }
  const int left = int(f.blocks[block].x) - pad, top = int(f.blocks[block].y) - pad;
  for (size_t c = 0; c < planes.size(); ++c) {
    for (int row = std::max(0, -top); row < padded && top + row < int(f.height); ++row) {
      for (int x = std::max(0, -left); x < padded && left + x < int(f.width); ++x) {
        float sum = 0;
        for (int from = std::max(0, x - 2 * pad); from <= std::min(size - 1, x); ++from) {
          sum += columns[at(c, x - from, row, from)];
        }
        planes[c][size_t(top + row) * size_t(f.width) + size_t(left + x)] += sum;
      }
    }
  }
}

// The film of a whole frame, block after block: what the film must give to the last bit. Samples must be finite.
inline FilmImages wholeFrameImages(const FrameSamples& f, FilterKind kind, float radius) {
  FilmImages images = emptyImages(f.width, f.height, f.layers);
  const size_t pixels = images.alpha.size();
  std::vector<std::vector<float>> planes(5 + 3 * f.layers, std::vector<float>(pixels));
  for (size_t block = 0; block < f.blocks.size(); ++block) addBlock(f, block, kind, radius, planes);
  for (size_t i = 0; i < pixels; ++i) {
    const auto divide = [&](size_t c) { return planes[4][i] != 0 ? planes[c][i] / planes[4][i] : 0; };
    images.normal[i] = {divide(0), divide(1), divide(2)};
    images.alpha[i] = divide(3);
    for (uint32_t l = 0; l < f.layers; ++l) {
      images.layers[l][i] = {divide(5 + 3 * l), divide(6 + 3 * l), divide(7 + 3 * l)};
      images.composite[i] += images.layers[l][i];
    }
  }
  for (size_t i = 0; i < f.depth.size(); ++i) {
    const BlockOrigin at = f.pixelOf(i * f.samples_per_pixel);
    if (at.x < f.width && at.y < f.height) images.depth[size_t(at.y) * size_t(f.width) + size_t(at.x)] = f.depth[i];
  }
  return images;
}

}  // namespace encore
