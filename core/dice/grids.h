// What displacement has to know of the grids that a DicedMesh is made of.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/scene/math.h"

namespace encore {

// Primitive i owns the vertices from first_vertex[i] to first_vertex[i + 1] and triangles likewise. Those on its
// boundary come first; ring[first_ring[i] + k] is the place of vertex first_vertex[i] + k: vertices that share a place
// are one point of the surface.
struct Grids {
  std::vector<size_t> first_vertex, first_triangle, first_ring;  // per primitive, and the end
  std::vector<uint32_t> ring;
  uint32_t places = 0;
  std::vector<Vec2f> spacing;  // per vertex: from one of the lattice's lines to the next, in (u, v)

  bool authored_normals = false;  // where the mesh has them, normals are not those of the geometry

  size_t ringSize(size_t primitive) const { return first_ring[primitive + 1] - first_ring[primitive]; }
};

}  // namespace encore
