// The acceleration structure: one scene per prototype, one level of instances. Embree stays in the .cpp
// and in embree_api.h.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "core/dice/dice.h"
#include "core/scene/scene.h"
#include "core/trace/ray.h"

namespace encore {

class TraceCache;

// What is known at a hit, in world space.
struct SurfacePoint {
  Vec3f position;
  Vec3f position_error;    // per axis bound on the rounding error of position (Pharr et al., PBR §6.8)
  Vec3f ng, ns;            // unit geometric and shading normal, both towards the outside
  uint32_t side = 0;       // 0: the ray arrived from outside, 1: from inside (the back)
  uint32_t primitive = 0;  // within the instance's prototype
  Vec2f uv;                // within the primitive, in [0, 1]²
  int32_t material = 0;    // index into Scene::materials
  Vec3f e1, e2;            // world-space edges of the triangle from its first vertex
  Vec3f dn1, dn2;          // change of ns over e1 and e2 (0 where faceted): for curvature
  bool thin = false;       // Mesh::thin_walled
  float time = 0;          // of the hit

  SurfaceKey key(uint32_t instance) const { return {instance, primitive << 1 | side}; }
  // Origin of a ray that leaves towards `direction`: beyond the rounding error, on the side it leaves to.
  Vec3f offsetOrigin(Vec3f direction) const;
  // Change of the barycentric coordinates (b1, b2) for a step dp on the tangent plane.
  Vec2f barycentricChange(Vec3f dp) const;
};

// Values of interpolated primvars at a hit and their change over the footprint.
struct TexcoordPoint {
  Vec2f st, dstdx, dstdy;
};

// What lies along a shadow ray that may let light pass, on its way from the surface to the light.
inline constexpr uint32_t kRecordedHits = 8;
struct ShadowHits {
  bool occluded = false;  // by something opaque; hits have no meaning then
  bool overflow = false;  // there may be more hits beyond the last one: ask again with ShadowQuery::resume
  uint32_t count = 0;
  std::array<Hit, kRecordedHits> hits;  // the first `count`: all there are, or the nearest; nearest first
};
// What a batch of shadow rays has to know of the scene's materials and lights.
struct ShadowQuery {
  // Per ray: Light::shadow_groups of its light, or null: all cast shadows. Empty: null for all.
  std::span<const std::vector<uint8_t>* const> groups;
  // results hold what the last call found for the same rays, all of which overflowed and were not occluded; they are
  // replaced by the hits that follow, exactly. (Moving a ray's tnear to the last hit's t instead is as good unless
  // more than kRecordedHits lie at one distance: those that there was no room for are then lost.)
  bool resume = false;
};

class TraceScene {
 public:
  // Keeps a reference to the scene, which must outlive it. Builds with the threads of the TBB arena
  // it is called in; the result does not depend on them.
  // world_space_parameters: uv and footprints are scaled to each primitive's extents in the world, by factors in
  // (0, 1] of which the larger is 1.
  // passes: per material, 1 where shadow rays must be told of hits on it instead of ending there; empty: none.
  // Geometry gets filters only where some such material, or a light with shadow groups, asks for them.
  // cache: prototypes that are in it are taken from there, and it holds those of this scene afterwards. Null: none.
  TraceScene(const Scene& scene, DicedMeshes diced, bool world_space_parameters = false,
             std::span<const uint8_t> passes = {}, TraceCache* cache = nullptr);
  ~TraceScene();

  // Traces rays in order, 16 to a packet (the last one partly filled). Thread-safe.
  // hits.size() == rays.size().
  void intersect(std::span<const Ray> rays, std::span<Hit> hits, Coherence coherence) const;
  // occluded[i] = 1 if anything lies within (tnear, tfar) of rays[i], else 0. Thread-safe.
  void occluded(std::span<const Ray> rays, std::span<uint8_t> occluded, Coherence coherence) const;

  // The same for rays that some surfaces let pass, or that lights' shadow groups concern. Exactly what a loop over
  // all triangles would find: hits are ordered by (t, instance, mesh, triangle), and t is that of double precision,
  // whatever rays share a packet, so that hits are neither lost nor repeated when a ray is resumed. A ray through an
  // edge or a vertex that triangles of one mesh share, and that face it alike, crosses one surface there: the first of
  // these hits stands for all. Of a silhouette edge it meets both sides. results.size() == rays.size(). Thread-safe.
  void shadows(std::span<const Ray> rays, const ShadowQuery& query, std::span<ShadowHits> results,
               Coherence coherence) const;
  bool needsShadowHits() const;  // else occluded() says all there is to know

  // Precondition: hit.valid(). direction: of the ray that made it. with_error false leaves position_error 0,
  // which is a third of the work: for points that no ray will leave from.
  SurfacePoint surface(const Hit& hit, Vec3f direction, bool with_error = true) const;
  // SurfacePoint::position_error of a point that surface() made without it.
  Vec3f positionError(const Hit& hit, const SurfacePoint& point) const;
  int32_t material(const Hit& hit) const;  // index into Scene::materials, as in surface()
  // The named texture coordinates at the hit; slot from texcoordSlot(). Slot -1: zeros.
  TexcoordPoint texcoord(const Hit& hit, const SurfacePoint& point, int32_t slot, Vec3f dpdx, Vec3f dpdy) const;
  // Slot of the texture coordinates `name` of the mesh that was hit, or of its instance (those do not change over the
  // surface), or -1. It holds for hits on the same mesh of the same instance.
  int32_t texcoordSlot(const Hit& hit, const std::string& name) const;
  Vec3f displayColor(const Hit& hit) const;  // 0.18 grey where neither mesh nor instance has one
  // Slot of Mesh::primvars or Instance::primvars, as texcoordSlot(), or -1, and its value there.
  int32_t primvarSlot(const Hit& hit, const std::string& name) const;
  Vec4f primvar(const Hit& hit, int32_t slot) const;
  // dp/ds and dp/dt of the texture coordinates at the hit, world space, not of unit length; false where they have
  // none (no coordinates, or constant ones).
  bool tangents(const Hit& hit, const SurfacePoint& point, int32_t texcoord_slot, Vec3f& dpds, Vec3f& dpdt) const;
  Vec3f worldPosition(Vec3f position) const;   // of a point of the scene: Scene::origin added
  Vec3f objectPosition(const Hit& hit) const;  // in the prototype's space, at the hit's time
  uint32_t linkGroup(const Hit& hit) const;
  uint32_t element(const Hit& hit) const;  // base face, curve or point within its Mesh
  // A triangle in world space at a time, and their number, for lights that are made of them. instance, mesh,
  // triangle: as in Hit.
  uint32_t meshCount(uint32_t instance) const;
  uint32_t triangleCount(uint32_t instance, uint32_t mesh) const;
  std::array<Vec3f, 3> triangle(uint32_t instance, uint32_t mesh, uint32_t triangle, float time) const;
  // Average length of the change of the parametric (u, v) over a pixel step (§2.4's r).
  float parametricFootprint(const Hit& hit, const SurfacePoint& point, Vec3f dpdx, Vec3f dpdy) const;

  uint64_t primitiveCount() const;     // summed over instances: Table 1's #prims
  uint64_t micropolygonCount() const;  // diced once per prototype: Table 1's #mpoly
  uint64_t memoryBytes() const;
  // Instances that are left out because their scale is beyond single precision (below about 1e-9).
  std::vector<uint32_t> untraceable() const;
  float diagonal() const;  // of the world-space bounding box; 0 for an empty scene

 private:
  friend class PacketTracer;
  friend class TracedTriangle;
  friend struct ShadowRecorder;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Sets flush-to-zero and denormals-are-zero on this thread, as Embree asks, and restores them.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  uint32_t saved_;
};

}  // namespace encore
