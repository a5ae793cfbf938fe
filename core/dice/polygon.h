// Planar coordinates and triangles of polygons with any number of corners.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene/math.h"

namespace encore {

struct PlanePoint {
  double x = 0, y = 0;
};

// Twice the vector area; its direction is the normal of the best-fit plane, seen counterclockwise
// (Newell's method). Zero for degenerate polygons.
Vec3d newellNormal(std::span<const Vec3f> corners);

// Coordinates in the best-fit plane, counterclockwise; x runs along the longest edge. All zero when the
// polygon has no area.
std::vector<PlanePoint> projectToPlane(std::span<const Vec3f> corners);

// Scales and moves points into [0, 1]², the longer side of their bounds to 1: distances keep their
// proportions.
std::vector<Vec2f> scaledToBounds(std::span<const PlanePoint> points);

// Ear clipping of a counterclockwise polygon, concave and with collinear or touching corners: n - 2
// triangles, 3 indices each. Self-intersecting and degenerate polygons get some triangulation, too.
std::vector<uint32_t> earClip(std::span<const PlanePoint> points);

// A polygon as triangles over its own corners, and the corners' parametric coordinates.
struct TriangulatedPolygon {
  std::vector<Vec2f> uv;
  std::vector<uint32_t> triangles;
};
// Triangles: (u, v) = (0,0) (1,0) (0,1). Quads: (0,0) (1,0) (1,1) (0,1), cut from corner 0 to corner 2 unless that
// would fold a concave quad, which is cut from 1 to 3. More corners: ear clipping; (u, v) are coordinates in the
// best-fit plane, the longer side of their bounds scaled to 1.
TriangulatedPolygon triangulate(std::span<const Vec3f> corners);

// No corner turns the wrong way, up to rounding. Degenerate polygons are convex.
bool isConvex(std::span<const Vec3f> corners);

}  // namespace encore
