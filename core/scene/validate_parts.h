// What the files of Scene::validate() share; not for other rooms.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <string>

#include "core/scene/error.h"
#include "core/scene/scene.h"
#include "core/scene/text.h"

namespace encore::validation {

[[noreturn]] inline void raise(const std::string& where, const std::string& found, const std::string& remedy) {
  throw Error(ErrorKind::Scene, found, where, remedy);
}

inline void checkFinite(bool finite, const std::string& where, const std::string& value) {
  if (!finite) raise(where, "value " + value + " is not finite", "Remove infinite and NaN values");
}

// Invertible whatever the scale: compares the determinant with the volume of a box with edges of the same lengths.
inline void checkTransform(const Affine3d& m, const std::string& where) {
  if (!allFinite(m))
    checkFinite(false, where, text(m.ex) + ", " + text(m.ey) + ", " + text(m.ez) + ", " + text(m.origin));
  const double volume = length(m.ex) * length(m.ey) * length(m.ez), determinant = m.determinant();
  if (!(std::abs(determinant) > 1e-12 * volume) || !std::isfinite(volume))
    raise(where, "the transform cannot be inverted: its determinant is " + text(determinant),
          "Remove scales of 0 and axes that coincide, or make the prim invisible");
}

inline void checkIndex(int64_t index, int64_t lowest, size_t count, const std::string& where,
                       const std::string& things) {
  if (index < lowest || index >= int64_t(count))
    raise(where, "index " + text(index) + " is out of range: " + things + " number " + text(count),
          "Refer to one of the scene's " + things);
}

// Keys of motion: their number, and each of them by check(key, where).
template <class Key, class Check>
void checkKeys(std::span<const Key> keys, const std::string& where, const Check& check) {
  if (keys.empty()) return;
  if (keys.size() < 2 || keys.size() > kMaxMotionKeys)
    raise(where, text(keys.size()) + " motion keys", "Pass from 2 to " + text(kMaxMotionKeys) + " keys, or none");
  for (size_t i = 0; i < keys.size(); ++i) check(keys[i], where + " (motion key " + text(i) + ")");
}

void checkTexture(const Texture& texture);
void checkMaterial(const Material& material, size_t texture_count);
void checkLight(const Light& light, const Scene& scene);

}  // namespace encore::validation
