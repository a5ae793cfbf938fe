// A perspective camera over the film plane.
#pragma once

#include <string>

#include "core/scene/math.h"

namespace encore {

// Looks along local -Z with +Y up, as UsdGeomCamera. The film window is given in tangents:
// a pixel at NDC (x, y), both in [-1, 1] with y up, looks along
// (centre.x + x * half.x, centre.y + y * half.y, -1).
struct Camera {
  std::string path;
  Affine3d to_world;  // rigid or not: directions are normalized after the transform
  Vec2f half_tangent{0.5f, 0.5f};
  Vec2f centre_tangent{0, 0};  // aperture offsets
  float near_clip = 0;         // distance along -Z, world units
  float far_clip = 1e30f;
};

}  // namespace encore
