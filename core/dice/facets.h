// Polygons that are not subdivided, as faces that can be diced: for displacement.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/mesh.h"

namespace encore {

struct Facets {
  Mesh mesh;                   // of scheme bilinear, which leaves faces as flat as they are
  std::vector<uint32_t> face;  // per face of mesh: that of the original
  // Authored normals of the frame, then of the keys if they have their own; empty: the faces'.
  std::vector<Primvar<Vec3f>> normals;
};

// Faces stay what they are, except concave ones: bilinear dicing would fold them, so that they are cut into triangles
// as undiced ones are. Every point of the mesh stays one point. Precondition: the scheme is none.
Facets diceableFacets(const Mesh& mesh);

}  // namespace encore
