// Lights as UsdLux describes them, resolved to radiance and world-space shape.
#pragma once

#include <string>

#include "core/scene/math.h"

namespace encore {

struct Light {
  enum class Kind { Distant, Rect, Sphere, Dome };
  Kind kind = Kind::Distant;
  std::string path;
  // Distant with angle 0 (no extent): irradiance on a surface that faces it. All others: radiance.
  Vec3f radiance{1, 1, 1};
  float diffuse = 1, specular = 1;  // multipliers of UsdLuxLightAPI

  // Distant: direction in which light travels (unit), and full angle of the disk in radians.
  Vec3f direction{0, 0, -1};
  float angle_radians = 0;
  // Rect: centre and half-edges; emits towards cross(half_u, half_v) * -1, that is along local -Z.
  // Sphere: centre and radius.
  Vec3d centre{0, 0, 0};
  Vec3f half_u{0.5f, 0, 0}, half_v{0, 0.5f, 0};
  float radius = 0.5f;
};

}  // namespace encore
