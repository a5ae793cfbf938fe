#include "core/dice/polygon.h"

#include <algorithm>

namespace encore {
namespace {

Vec3d relative(std::span<const Vec3f> corners, size_t i) { return toDouble(corners[i]) - toDouble(corners[0]); }

// Twice the signed area of (a, b, c).
double turn(PlanePoint a, PlanePoint b, PlanePoint c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

bool same(PlanePoint a, PlanePoint b) { return a.x == b.x && a.y == b.y; }

struct Bounds {
  PlanePoint low, high;
  double extent() const { return std::max(high.x - low.x, high.y - low.y); }
};

Bounds boundsOf(std::span<const PlanePoint> points) {
  Bounds b{points[0], points[0]};
  for (const PlanePoint p : points) {
    b.low = {std::min(b.low.x, p.x), std::min(b.low.y, p.y)};
    b.high = {std::max(b.high.x, p.x), std::max(b.high.y, p.y)};
  }
  return b;
}

// The corners that are left, as a ring.
class EarClipper {
 public:
  explicit EarClipper(std::span<const PlanePoint> points)
      : points_(points), next_(points.size()), previous_(points.size()) {
    const double extent = boundsOf(points).extent();
    tolerance_ = 1e-12 * extent * extent;
    for (uint32_t i = 0; i < points.size(); ++i) {
      next_[i] = uint32_t((i + 1) % points.size());
      previous_[i] = uint32_t((i + points.size() - 1) % points.size());
    }
  }

  std::vector<uint32_t> clip() {
    std::vector<uint32_t> triangles;
    uint32_t start = 0;
    for (size_t left = points_.size(); left >= 3; --left) {
      const uint32_t ear = findEar(start, left);
      triangles.insert(triangles.end(), {previous_[ear], ear, next_[ear]});
      next_[previous_[ear]] = next_[ear];
      previous_[next_[ear]] = previous_[ear];
      start = next_[next_[ear]];  // away from the ear, so that no fan of slivers grows
    }
    return triangles;
  }

 private:
  // An ear; else a corner that at least does not turn the wrong way; else any.
  uint32_t findEar(uint32_t start, size_t left) const {
    uint32_t i = start;
    for (size_t k = 0; k < left; ++k, i = next_[i])
      if (isEar(i)) return i;
    i = start;
    for (size_t k = 0; k < left; ++k, i = next_[i])
      if (std::abs(turnAt(i)) <= tolerance_) return i;
    i = start;
    for (size_t k = 0; k < left; ++k, i = next_[i])
      if (turnAt(i) > 0) return i;
    return start;
  }

  double turnAt(uint32_t i) const { return turn(points_[previous_[i]], points_[i], points_[next_[i]]); }

  // Convex, and its cut from a to c runs inside: no other corner lies in or on the triangle, except where a
  // corner of the triangle itself is passed twice (bridges to holes), and no edge crosses the cut.
  bool isEar(uint32_t i) const {
    if (!(turnAt(i) > tolerance_)) return false;
    const PlanePoint a = points_[previous_[i]], b = points_[i], c = points_[next_[i]];
    for (uint32_t k = next_[next_[i]]; k != previous_[i]; k = next_[k]) {
      const PlanePoint p = points_[k];
      if (!same(p, a) && !same(p, b) && !same(p, c) && turn(a, b, p) >= -tolerance_ && turn(b, c, p) >= -tolerance_ &&
          turn(c, a, p) >= -tolerance_)
        return false;
    }
    for (uint32_t k = next_[i]; k != previous_[i]; k = next_[k]) {
      const PlanePoint p = points_[k], q = points_[next_[k]];
      if (turn(a, c, p) * turn(a, c, q) < 0 && turn(p, q, a) * turn(p, q, c) < 0) return false;
    }
    return true;
  }

  std::span<const PlanePoint> points_;
  std::vector<uint32_t> next_, previous_;
  double tolerance_ = 0;
};

Vec3d turnedArea(std::span<const Vec3f> p, int a, int b, int c) {
  const Vec3d origin = toDouble(p[a]);
  return cross(toDouble(p[b]) - origin, toDouble(p[c]) - origin);
}

// Whether the cut from corner k to corner k + 2 leaves no triangle that faces away from the quad.
bool cutsCleanly(std::span<const Vec3f> p, Vec3d normal, int k) {
  return dot(turnedArea(p, k, k + 1, k + 2), normal) >= 0 && dot(turnedArea(p, k, k + 2, (k + 3) % 4), normal) >= 0;
}

}  // namespace

Vec3d newellNormal(std::span<const Vec3f> corners) {
  Vec3d sum{0, 0, 0};
  for (size_t i = 1; i + 1 < corners.size(); ++i) sum += cross(relative(corners, i), relative(corners, i + 1));
  return sum;
}

std::vector<PlanePoint> projectToPlane(std::span<const Vec3f> corners) {
  std::vector<PlanePoint> points(corners.size());
  const Vec3d normal = normalize(newellNormal(corners));
  Vec3d longest{0, 0, 0};
  for (size_t i = 0; i < corners.size(); ++i) {
    const Vec3d edge = relative(corners, (i + 1) % corners.size()) - relative(corners, i);
    const Vec3d in_plane = edge - normal * dot(edge, normal);
    if (dot(in_plane, in_plane) > dot(longest, longest)) longest = in_plane;
  }
  if (length(normal) == 0) return points;
  const Vec3d x = normalize(longest), y = cross(normal, x);
  for (size_t i = 0; i < corners.size(); ++i) {
    const Vec3d p = relative(corners, i);
    points[i] = {dot(p, x), dot(p, y)};
  }
  return points;
}

std::vector<Vec2f> scaledToBounds(std::span<const PlanePoint> points) {
  const Bounds bounds = boundsOf(points);
  const double scale = bounds.extent() > 0 ? 1 / bounds.extent() : 0;
  std::vector<Vec2f> scaled;
  for (const PlanePoint p : points)
    scaled.push_back({std::clamp(float((p.x - bounds.low.x) * scale), 0.0f, 1.0f),
                      std::clamp(float((p.y - bounds.low.y) * scale), 0.0f, 1.0f)});
  return scaled;
}

std::vector<uint32_t> earClip(std::span<const PlanePoint> points) { return EarClipper(points).clip(); }

TriangulatedPolygon triangulate(std::span<const Vec3f> corners) {
  if (corners.size() == 3) return {{{0, 0}, {1, 0}, {0, 1}}, {0, 1, 2}};
  if (corners.size() == 4) {
    const Vec3d normal = newellNormal(corners);
    const bool first = cutsCleanly(corners, normal, 0) || !cutsCleanly(corners, normal, 1);
    return {{{0, 0}, {1, 0}, {1, 1}, {0, 1}},
            first ? std::vector<uint32_t>{0, 1, 2, 0, 2, 3} : std::vector<uint32_t>{1, 2, 3, 1, 3, 0}};
  }
  const auto plane = projectToPlane(corners);
  return {scaledToBounds(plane), earClip(plane)};
}

bool isConvex(std::span<const Vec3f> corners) {
  const auto plane = projectToPlane(corners);
  const double extent = boundsOf(plane).extent(), tolerance = 1e-7 * extent * extent;
  for (size_t i = 0; i < plane.size(); ++i)
    if (turn(plane[i], plane[(i + 1) % plane.size()], plane[(i + 2) % plane.size()]) < -tolerance) return false;
  return true;
}

}  // namespace encore
