// A perspective or orthographic camera over the film plane, with a lens.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/math.h"

namespace encore {

// Points p of the camera's space with dot(normal, p) + offset < 0 are cut away (UsdGeomCamera clippingPlanes).
struct ClippingPlane {
  Vec3f normal;
  float offset = 0;
};

// Looks along local -Z with +Y up, as UsdGeomCamera. Perspective: the film window is given in tangents; a pixel at
// NDC (x, y), both in [-1, 1] with y up, looks along (centre.x + x * half.x, centre.y + y * half.y, -1).
// Orthographic: the window is given in local units at the camera, and every pixel looks along -Z.
struct Camera {
  enum class Projection { Perspective, Orthographic };

  std::string path;
  Projection projection = Projection::Perspective;
  Affine3d to_world;             // rigid or not: directions are normalized after the transform
  std::vector<Affine3d> motion;  // keys as Instance::motion; empty: still
  Vec2f half_tangent{0.5f, 0.5f};
  Vec2f centre_tangent{0, 0};  // aperture offsets
  float near_clip = 0;         // distance along -Z, world units
  float far_clip = 1e30f;
  std::vector<ClippingPlane> clipping_planes;

  float lens_radius = 0;         // local units; 0: a pinhole
  float focus_distance = 1;      // along -Z, local units; above 0
  uint32_t aperture_blades = 0;  // corners of the aperture; below 3: a disk
  float aperture_rotation_radians = 0;
  float exposure_scale = 1;  // of all radiance that reaches the film
};

}  // namespace encore
