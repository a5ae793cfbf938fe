// Where things are between the keys of their motion: linear interpolation at uniform times, as Embree's.
#pragma once

#include <cstddef>

#include "core/scene/math.h"

namespace encore {

struct Placement;
struct TracedInstance;

// The two keys around a time in [0, 1], and the weight of the second. In float, as Embree finds them.
struct KeyTime {
  size_t first;
  float weight;

  // keys: two or more.
  KeyTime(float time, size_t keys) {
    const float segments = float(keys - 1), scaled = time * segments;
    const float whole = std::clamp(std::floor(scaled), 0.0f, segments - 1);
    first = size_t(whole), weight = scaled - whole;
  }
  // Rounded once: exact where the keys agree.
  Vec3f between(Vec3f a, Vec3f b) const {
    return toFloat(toDouble(a) * (1 - double(weight)) + toDouble(b) * double(weight));
  }
  Affine3f between(const Affine3f& a, const Affine3f& b) const {
    return {between(a.ex, b.ex), between(a.ey, b.ey), between(a.ez, b.ez), between(a.origin, b.origin)};
  }
};

// Precondition of all: the instance moves.
Affine3f worldAt(const TracedInstance& instance, float time);
Placement placementAt(const TracedInstance& instance, float time);  // ray_error_* are left out
void addRayError(Placement& placement);
// How far the matrix that Embree interpolates may be from worldAt(), entry by entry.
Affine3f keyError(const TracedInstance& instance, float time);

}  // namespace encore
