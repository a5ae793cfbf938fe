// Points on the lens, and the random numbers of a camera's samples.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "core/scene/math.h"
#include "core/scene/random.h"

namespace encore {

// The unit disk from the unit square, keeping areas and neighbourhoods (Shirley & Chiu, "A Low Distortion Map Between
// Disk and Square", JGT 1997).
inline Vec2f concentricDisk(Vec2f u) {
  const float x = 2 * u.x - 1, y = 2 * u.y - 1;
  if (x == 0 && y == 0) return {0, 0};
  const bool flat = std::abs(x) > std::abs(y);
  const float r = flat ? x : y;
  const float phi = flat ? kPi / 4 * (y / x) : kPi / 2 - kPi / 4 * (x / y);
  return {r * std::cos(phi), r * std::sin(phi)};
}

// Corners of a regular polygon on the unit circle, counter-clockwise from `rotation` radians, the first one twice.
// Empty for fewer than three: a disk.
inline std::vector<Vec2f> apertureCorners(uint32_t blades, float rotation) {
  std::vector<Vec2f> corners;
  if (blades < 3) return corners;
  for (uint32_t i = 0; i <= blades; ++i) {
    const float phi = rotation + 2 * kPi * float(i % blades) / float(blades);
    corners.push_back({std::cos(phi), std::sin(phi)});
  }
  return corners;
}
// Uniform in the polygon: one of its triangles around the centre, and a point in it.
inline Vec2f polygonPoint(std::span<const Vec2f> corners, Vec2f u) {
  const uint32_t blades = uint32_t(corners.size() - 1);
  const float along = u.x * float(blades);
  const uint32_t blade = std::min(uint32_t(along), blades - 1);
  const float t = std::min(along - float(blade), 1.0f);
  return (corners[blade] * (1 - t) + corners[blade + 1] * t) * std::sqrt(u.y);
}

// Numbers of one pixel's (or block's) samples: an Owen-scrambled Sobol point on the lens and one in time, of the same
// index. Both are shuffled by themselves, so that any 2^k samples in a row stratify in each and neither follows the
// other.
class CameraRandom {
 public:
  CameraRandom(uint32_t seed, uint32_t pixel) : keys_(pcg4d(pixel, seed, uint32_t(RandomUse::Camera), 0)) {}
  Vec2f lens(uint32_t index) const { return sobol2(index, keys_[0]); }
  float time(uint32_t index) const { return sobol2(index, keys_[1]).x; }

 private:
  std::array<uint32_t, 4> keys_;
};

// Of each of the n × n strata of a pixel, by rows, its place along a Z curve: samples that follow each other fill
// squares of the film, so that those of a square stratify on the lens and in time.
std::vector<uint32_t> strataRanks(uint32_t n);

}  // namespace encore
