// Arbitrary output variables: what the film keeps besides layers, alpha, depth and normals.
#pragma once

#include <cstdint>
#include <string>

namespace encore {

// Pixels [x0, x1) × [y0, y1) of the plane of the image, whose upper left pixel is (0, 0).
struct Window {
  int32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  bool empty() const { return x1 <= x0 || y1 <= y0; }
  friend bool operator==(const Window&, const Window&) = default;
};

// A property of the camera's first hits (behind what they pass straight through). Filtered ones are weighted means
// over the samples that hit something, premultiplied by alpha; the others are those of the closest sample of the
// pixel, the one whose depth the depth image has.
struct Aov {
  enum class Kind {
    Position,     // 3, world space, unfiltered
    EyePosition,  // 3, camera space, unfiltered
    EyeNormal,    // 3, camera space, filtered, not of unit length
    Primvar,      // components, of Mesh::primvars, texture coordinates or display_color by name, filtered
    PrimId,       // 1, index of the mesh among Scene::meshes, unfiltered; -1: nothing was hit
    InstanceId,   // 1, index of the instance, as PrimId
    ElementId,    // 1, base face, curve or point within its mesh, as PrimId
  };
  Kind kind = Kind::Position;
  std::string name;         // what the images call it; unique
  std::string primvar;      // Kind::Primvar: its name
  uint32_t components = 3;  // Kind::Primvar: 1 to 4
};

}  // namespace encore
