// Triangles in world space: what all hits on one triangle of one instance share, at one time if it moves, computed
// once.
#pragma once

#include <vector>

#include "core/trace/trace_scene.h"

namespace encore {

struct TracedInstance;
struct Placement;
struct TracedMesh;
struct DicedMesh;

// Of a point, which is a sphere, a triangle that touches it at one hit, and holds no other.
class TracedTriangle {
 public:
  TracedTriangle() = default;
  // Precondition: hit.valid(). Keeps pointers into the scene.
  TracedTriangle(const TraceScene& trace, const Hit& hit);

  bool holds(const Hit& hit) const {
    return triangle_ == hit.triangle && mesh_ == hit.mesh && instance_index_ == hit.instance &&
           (!moves_ || time_ == hit.time);
  }
  int32_t material() const { return material_; }
  // As TraceScene's, for hits on this triangle.
  SurfacePoint surface(const Hit& hit, Vec3f direction) const;
  Vec3f positionError(const Hit& hit, const SurfacePoint& point);
  // SurfacePoint::barycentricChange(), rounded earlier.
  Vec2f barycentricChange(Vec3f dp) {
    if (!has_gradients_) fillGradients();
    return {dot(of_b1_, dp), dot(of_b2_, dp)};
  }

 private:
  void fillSphere(const TraceScene::Impl& scene, const TracedMesh& mesh, const Hit& hit);
  Vec3f positionErrorAt(const Placement& place, const Hit& hit, const SurfacePoint& point) const;
  Vec3f movingPositionError(const Hit& hit, const SurfacePoint& point);
  void fillPlaneError(const Placement& place);
  void fillGradients();

  uint32_t instance_index_ = kNoInstance, mesh_ = 0, triangle_ = 0;
  uint32_t primitive_ = 0;  // within the prototype
  int32_t material_ = 0;
  bool degenerate_ = false;  // ng depends on the ray
  bool smooth_ = false;
  bool moves_ = false;  // all below is that of time_
  bool thin_ = false;
  float time_ = 0;
  bool has_plane_error_ = false, has_gradients_ = false;  // filled when first asked for
  const TracedInstance* instance_ = nullptr;
  const DicedMesh* deforming_ = nullptr;  // null: its shape stays
  Vec3f p0_, edge1_, edge2_;              // of the prototype
  Vec3f e1_, e2_, ng_;
  Vec3f n_, dn1_, dn2_;  // not of unit length; only where smooth
  Vec2f uv_, duv1_, duv2_, scale_;
  Vec3f plane_error_;
  Vec3f of_b1_, of_b2_;  // gradients of the barycentric coordinates
};

// Triangles that were met lately: neighbouring paths share most of them. Not thread-safe: one for each thread.
class TriangleCache {
 public:
  explicit TriangleCache(const TraceScene& trace) : trace_(trace), triangles_(kTriangles) {}

  // Until the next call. Precondition: hit.valid().
  TracedTriangle& triangle(const Hit& hit) {
    TracedTriangle& t = triangles_[slotOf(hit)];
    if (!t.holds(hit)) t = TracedTriangle(trace_, hit);
    return t;
  }

 private:
  static constexpr uint32_t kTriangles = 256;
  static uint32_t slotOf(const Hit& hit) {
    return ((hit.triangle * 0x9e3779b1u) ^ (hit.mesh * 0x85ebca77u) ^ (hit.instance * 0xc2b2ae3du)) >> 24;
  }
  static_assert(kTriangles == 1u << 8);

  const TraceScene& trace_;
  std::vector<TracedTriangle> triangles_;
};

}  // namespace encore
