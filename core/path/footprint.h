// Parametric footprints (§2.4's r) of paths that were absorbed, and what keys say of them.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/path/differentials.h"
#include "core/path/path.h"

namespace encore {

// Some control of reuse reads footprints.
inline bool needsFootprints(const Settings& settings) {
  return settings.footprint_reuse != FootprintReuse::Ignore || settings.max_reuse_distance > 0;
}

// Time or direction are part of the reuse distance (§5).
inline bool needsAspect(const Settings& settings) {
  return settings.method == Method::Reuse && (settings.reuse_time_weight > 0 || settings.reuse_direction_weight > 0);
}
// direction: of the ray that arrived, unit.
inline Vec4f aspectOf(const Settings& settings, Vec3f direction, float time) {
  const Vec3f d = direction * settings.reuse_direction_weight;
  return {d.x, d.y, d.z, time * settings.reuse_time_weight};
}

// The key that shading is reused within. With FootprintReuse::Octaves the upper 6 bits of the instance tell
// footprints of different octaves apart; instances are below kOctaveInstances.
inline constexpr int kLeastOctave = -56, kLargestOctave = 6;
inline constexpr uint32_t kOctaveInstances = 1u << 26;
inline SurfaceKey reuseKey(SurfaceKey key, float footprint, FootprintReuse reuse) {
  if (reuse != FootprintReuse::Octaves || key.instance == kNoInstance) return key;
  // Not a number counts as the least, as what is 0 does.
  const int octave = footprint > 0 ? std::clamp(std::ilogb(footprint), kLeastOctave, kLargestOctave) : kLeastOctave;
  return {key.instance | uint32_t(octave - kLeastOctave) << 26, key.primitive_side};
}

}  // namespace encore
