// Lights as UsdLux describes them, resolved to radiance and world-space shape. Lights do not move within a frame.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/math.h"

namespace encore {

// Names are UsdLuxDomeLight's.
enum class DomeFormat { LatLong, MirroredBall, Angular, CubeMapVerticalCross };

struct Light {
  enum class Kind { Distant, Rect, Disk, Sphere, Cylinder, Dome, Mesh };
  Kind kind = Kind::Distant;
  std::string path;
  // Distant with angle 0 (no extent): irradiance on a surface that faces it. All others: radiance, which a texture
  // multiplies.
  Vec3f radiance{1, 1, 1};
  float diffuse = 1, specular = 1;  // multipliers of UsdLuxLightAPI
  uint32_t samples = 0;             // rays per shade; 0: the settings'

  // Distant: direction in which light travels (unit), and full angle of the disk in radians.
  Vec3f direction{0, 0, -1};
  float angle_radians = 0;
  // Rect: centre and half-edges; emits towards cross(half_u, half_v) * -1, that is along local -Z.
  // Disk: centre and half-axes of the ellipse, which emits as a rect does.
  // Sphere: centre and radius. Cylinder: centre, half its axis (half_u) and radius; it has no caps.
  Vec3d centre{0, 0, 0};
  Vec3f half_u{0.5f, 0, 0}, half_v{0, 0.5f, 0};
  float radius = 0.5f;
  // Mesh: the triangles of this instance emit on the outside, and it is rendered as well: camera and traced lobes see
  // its radiance beside what its material does (materialSyncMode independent; see docs).
  int32_t instance = -1;

  // Rect: upright and not mirrored where the lit side is seen: its lower left corner at centre + half_u - half_v, as
  // half_u runs to the left there (UsdLuxRectLight: the first pixel at +X, +Y). Dome: by format and axes.
  // Index into Scene::textures; -1: none.
  int32_t texture = -1;
  DomeFormat format = DomeFormat::LatLong;
  // Dome: its local X, Y and Z in world space, unit, at right angles. A latlong image has local +Y at its top row;
  // its middle column looks along local +Z, a quarter of the width further right along -X (OpenEXR's, and Storm's).
  // The other formats: core/shade/light_image.h.
  Vec3f axis_x{1, 0, 0}, axis_y{0, 1, 0}, axis_z{0, 0, 1};

  // UsdLuxShapingAPI, for lights at finite distance; angles are from shaping_axis (unit, the light's -Z).
  bool shaped = false;  // false: the rest is not looked at
  Vec3f shaping_axis{0, 0, -1};
  float focus = 0;
  Vec3f focus_tint{0, 0, 0};
  float cone_angle_radians = kPi / 2;
  float cone_softness = 0;

  // UsdLuxShadowAPI. Negative distance and falloff: none.
  bool shadow_enable = true;
  Vec3f shadow_color{0, 0, 0};
  float shadow_distance = -1, shadow_falloff = -1, shadow_falloff_gamma = 1;

  // By link group (Mesh::link_group): 1 where the light lights, or is shadowed by, prims of the group. Empty: all.
  std::vector<uint8_t> lit_groups, shadow_groups;
};

}  // namespace encore
