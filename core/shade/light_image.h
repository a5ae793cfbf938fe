// Images that lights emit: decoded once, looked up bilinearly, and sampled by brightness.
//
// Lookups do not know how wide a ray is, so that what is smaller than a pixel of the image never aliases, and an image
// with more pixels than the picture resolves is noisier than a filtered one would be.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/light.h"
#include "core/scene/material.h"
#include "core/scene/math.h"

namespace encore {

// Where a dome's image shows a direction, in the dome's local axes: st in [0, 1]², st = (0, 0) lower left, (1, 1) upper
// right. d: unit.
// - LatLong: s = 1/2 - atan2(d.x, d.z) / 2π, t = 1 - acos(d.y) / π: the centre looks along +Z, further right is -X, the
//   top row is +Y (the OpenEXR specification, which UsdLuxDomeLight names, and Storm).
// - MirroredBall: a mirror ball seen from far along +Z, with +X to the right and +Y up. The centre is +Z, the rim -Z:
//   st = 1/2 + (d.x, d.y) / (2 √(2 + 2 d.z)).
// - Angular: the same, with the distance from the centre in proportion to the angle to +Z: half the width is π.
// - CubeMapVerticalCross: three faces wide, four high. Second row from the top: +X, +Z, -X; +Y above and -Y below +Z;
//   -Z at the bottom, upside down. Each face is seen from inside; neighbours in the cross share their edges.
// Only LatLong is fixed by a specification. The others agree with it where their centres look.
Vec2f domeImagePoint(DomeFormat format, Vec3f d);

class LightImage {
 public:
  // For a rectangle. Negative numbers and those that are not finite become 0. Reads the source if there is one.
  explicit LightImage(const Texture& texture);
  // For a dome. Formats other than LatLong become a latlong image of at least their resolution (2048 rows at most).
  LightImage(const Texture& texture, DomeFormat format);

  // Bilinear, clamped at the border. st = (0, 0): the lower left corner.
  Vec3f at(float s, float t) const;
  Vec3f average() const { return average_; }  // over the image; of a dome: over the sphere
  uint64_t bytes() const;

  // Domes. Directions: unit, in the dome's axes.
  Vec3f towards(Vec3f direction) const;
  bool black() const { return !(total_ > 0); }
  // Density per solid angle is in proportion to the brightness of the pixel, as the lookup averages it.
  // Precondition: not black().
  Vec3f sample(Vec2f u) const;
  float pdf(Vec3f direction) const;

 private:
  void decode(const Texture& texture);
  void resample(const Texture& texture, DomeFormat format);
  void makeDistribution();
  float rowSolidAngle(uint32_t row) const;  // of one of its pixels
  Vec3f pixel(int64_t x, int64_t y) const;
  Vec3f bilinear(float x, float y) const;  // in pixels, the lower left corner of pixel 0 at 0

  uint32_t width_ = 0, height_ = 0;
  bool wraps_ = false;         // around the left and right border
  std::vector<float> pixels_;  // rgb, bottom row first
  Vec3f average_;
  // Domes: running sums of weights within each row (width_ each), and over the rows.
  std::vector<float> in_row_, rows_;
  float total_ = 0;
};

}  // namespace encore
