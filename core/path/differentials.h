// Ray differentials (Igehy, "Tracing Ray Differentials", SIGGRAPH 1999): how a ray's origin and direction
// change over a pixel step in x and in y. All lengths in world units per pixel.
#pragma once

#include <cmath>

#include "core/scene/math.h"

namespace encore {

// How the direction of a ray changes over a pixel step.
struct Spread {
  Vec3f x, y;
};

// Eqs. 10-12: the change of the hit at distance t on a plane with normal n, from that of origin and direction.
inline Vec3f transferDifferential(Vec3f dp, Vec3f dd, float t, Vec3f direction, Vec3f n) {
  const Vec3f moved = dp + dd * t;
  return moved - direction * (dot(moved, n) / dot(direction, n));
}
// Eqs. 14-16: change of the reflected direction. dn: change of the unit normal n over the step.
inline Vec3f reflectDifferential(Vec3f direction, Vec3f n, Vec3f dd, Vec3f dn) {
  const float change = dot(dd, n) + dot(direction, dn);
  return dd - (dn * dot(direction, n) + n * change) * 2;
}
// Eq. 17: change of the refracted direction `out`. n: on the side that `direction` comes from;
// eta: far over near index of refraction.
Vec3f refractDifferential(Vec3f direction, Vec3f out, Vec3f n, float eta, Vec3f dd, Vec3f dn);

Vec3f shortened(Vec3f v, float longest);  // the rare part of limited()
// v, shortened to `longest`; zero where it is not finite.
inline Vec3f limited(Vec3f v, float longest) {
  const float half = 0.5f * longest;  // most are far below
  if (std::abs(v.x) <= half && std::abs(v.y) <= half && std::abs(v.z) <= half) return v;
  return shortened(v, longest);
}
// Two unit vectors never differ by more.
inline constexpr float kLargestDirectionChange = 2;

// A rough lobe sends the samples of a pixel into many directions, of which each stands for a part. width: the angle
// (radians) of that part. The principal axes of the spread, seen along the unit vector `direction`, become as long as
// if both widths were convolved: sqrt(axis² + width²). What origins and directions have to do with each other stays.
Spread widened(const Spread& spread, Vec3f direction, float width);

}  // namespace encore
