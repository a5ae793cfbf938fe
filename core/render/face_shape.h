// Points of one primitive by its parametric coordinates: the way back from (u, v) to a triangle, or to a sphere.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/dice/dice.h"

namespace encore {

// A triangle of the mesh and barycentric coordinates of its second and third vertex; of spheres: as Hit.
struct FacePoint {
  uint32_t triangle = 0;
  float b1 = 0, b2 = 0;
};

// Triangles without an area, in (u, v) or in space, count as not there: no ray can hit them.
class FaceShape {
 public:
  // Keeps a reference to the mesh. Precondition: mesh.triangle_primitive ascends.
  FaceShape(const DicedMesh& mesh, uint32_t primitive);

  // Whether the domain is the triangle (0, 0) (1, 0) (0, 1), or within it.
  bool triangular() const { return triangular_; }
  // The point at (u, v); the one of the lowest triangle where several meet. None outside of the face.
  std::optional<FacePoint> find(Vec2f uv) const;
  // The nearest point to (u, v), lengths measured in units of step, on the triangles that reach into the box
  // uv ± step. None where no triangle does.
  std::optional<FacePoint> nearest(Vec2f uv, Vec2f step) const;
  // As find(); outside of the face on the plane of its largest triangle, barycentric coordinates beyond [0, 1].
  FacePoint extrapolate(Vec2f uv) const;
  uint64_t memoryBytes() const { return 4 * (cell_ends_.capacity() + cell_triangles_.capacity()); }

 private:
  struct Triangle {
    Vec2f p0, p1, p2;
  };
  Triangle triangle(uint32_t index) const;
  bool exists(uint32_t index) const;
  void fillCells();
  uint32_t cellOf(float x) const;
  // Calls visit(triangle) at least for each that may reach into [low, high], perhaps several times.
  template <class Visit>
  void visitNear(Vec2f low, Vec2f high, const Visit& visit) const;

  const DicedMesh& mesh_;
  bool sphere_;
  uint32_t begin_ = 0, end_ = 0;  // triangles of the primitive
  uint32_t largest_ = 0;
  bool triangular_ = true;
  // Lists of triangles by cells_ × cells_ cells of the unit square; 0: few enough to look at all of them.
  uint32_t cells_ = 0;
  std::vector<uint32_t> cell_ends_, cell_triangles_;
};

}  // namespace encore
