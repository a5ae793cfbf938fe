// What the files of core/trace share; not for other rooms.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "core/trace/embree_api.h"
#include "core/trace/motion.h"
#include "core/trace/packets.h"
#include "core/trace/parameter_scale.h"
#include "core/trace/trace_cache_impl.h"
#include "core/trace/trace_scene.h"

namespace encore {

// A mesh in its place within a prototype.
struct TracedMesh {
  const Mesh* mesh = nullptr;
  const DicedMesh* diced = nullptr;
  uint32_t first_primitive = 0;  // of the mesh, within the prototype
};

struct TracedPrototype {
  std::shared_ptr<const BuiltPrototype> built;  // null: no instance places it
  std::vector<TracedMesh> meshes;
  uint32_t primitives = 0;
  bool in_motion = false;  // some instance of it moves
};

// Where an instance stands at one time.
struct Placement {
  Affine3f to_world, to_prototype;
  // Rows of the matrix that bounds, per world axis and unit of |world coordinates| + |translation|, how far
  // Embree's transform of a ray into prototype space may err, seen in world space.
  Vec3f ray_error_x, ray_error_y, ray_error_z;
};

struct TracedInstance {
  uint32_t prototype = 0;
  int32_t material = -1, link_group = -1;  // as Instance's
  bool traceable = true;                   // else left out; see TraceScene::untraceable()
  float largest_origin = 0;                // of rays, so that they stay in Embree's range in prototype space
  Placement still;
  std::vector<Affine3f> keys;  // to_world at uniform times, and `still` is not to be looked at; empty: it is still

  bool moves() const { return !keys.empty(); }
};

struct TraceScene::Impl {
  Impl(const Scene& scene_, DicedMeshes diced_, TraceCache* cache)
      : scene(scene_),
        diced(std::move(diced_)),
        device(cache ? cache->impl().device : std::make_shared<embree::Device>()),
        half_packets(device->prefersHalfPackets()) {}

  const Scene& scene;
  DicedMeshes diced;
  std::shared_ptr<embree::Device> device;
  bool half_packets;            // see embree::Query
  bool moves = false;           // rays have times
  bool filtered = false;        // some geometry has a filter
  std::vector<uint8_t> passes;  // per material: hits of shadow rays are recorded
  std::vector<TracedPrototype> prototypes;
  std::vector<TracedInstance> instances;
  embree::Scene top;
  std::unique_ptr<ParameterScales> scales;  // null: parameters are as diced
  float diagonal = 0;
  float largest_origin = embree::kLargestCoordinate;  // of rays

  const TracedMesh& meshOf(const Hit& hit) const {
    return prototypes[instances[hit.instance].prototype].meshes[hit.mesh];
  }
  embree::Query query(Coherence coherence) const { return {coherence, largest_origin, half_packets}; }
  Vec2f parameterScale(uint32_t instance, uint32_t primitive) const {
    return scales ? scales->scale(instance, primitive) : Vec2f{1, 1};
  }
  void addInstances();
  void build(const std::vector<std::vector<uint8_t>>& may_pass, TraceCache* cache);
  PrototypeKey prototypeKey(uint32_t index, const std::vector<uint8_t>& may_pass) const;
  void addMeshes(uint32_t index);
  void buildPrototype(uint32_t index, const std::vector<uint8_t>& may_pass);
  void buildTop();
  // Per prototype and mesh in it: some shadow rays have to look at what they hit there.
  std::vector<std::vector<uint8_t>> meshesThatMayPass() const;
};

// Bound on the relative error of n rounded operations in a row (Higham; PBR 4th ed., eq. 6.17).
constexpr double roundingGamma(int n) { return n * 0x1p-24 / (1 - n * 0x1p-24); }

inline Vec3f componentMax(Vec3f a, Vec3f b) { return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}; }

TracedInstance makeInstance(const Instance& instance);
// Index into Scene::materials. primitive: of the mesh.
int32_t resolveMaterial(const TracedInstance& instance, const TracedMesh& mesh, uint32_t primitive);
int32_t materialOfTriangle(const TracedInstance& instance, const TracedMesh& mesh, uint32_t triangle);
inline uint32_t resolveLinkGroup(const TracedInstance& instance, const TracedMesh& mesh) {
  return instance.link_group >= 0 ? uint32_t(instance.link_group) : mesh.mesh->link_group;
}

// The vertices of a triangle.
struct Corners {
  uint32_t i0, i1, i2;
  Corners(const DicedMesh& mesh, uint32_t triangle)
      : i0(mesh.triangles[3 * size_t{triangle}]),
        i1(mesh.triangles[3 * size_t{triangle} + 1]),
        i2(mesh.triangles[3 * size_t{triangle} + 2]) {}

  // value0 + b1 * (value1 - value0) + b2 * (value2 - value0): exact where the three agree.
  template <class T>
  T interpolate(const std::vector<T>& values, float b1, float b2) const {
    const T v0 = values[i0];
    return v0 + ((values[i1] - v0) * b1 + (values[i2] - v0) * b2);
  }
  // The vertices' values at a time; motion: at uniform times, empty: they stay.
  std::array<Vec3f, 3> at(float time, const std::vector<Vec3f>& values,
                          const std::vector<std::vector<Vec3f>>& motion) const {
    if (motion.empty()) return {values[i0], values[i1], values[i2]};
    const KeyTime key(time, motion.size());
    const std::vector<Vec3f>&a = motion[key.first], &b = motion[key.first + 1];
    return {key.between(a[i0], b[i0]), key.between(a[i1], b[i1]), key.between(a[i2], b[i2])};
  }
};

// How far Embree's vertices of a deforming mesh may be from Corners::at(), prototype space.
Vec3f vertexError(const DicedMesh& mesh, const Corners& corners, float time);

// A triangle of an instance at a time, in prototype space, and where the instance stands.
class PlacedTriangle {
 public:
  PlacedTriangle(const TracedInstance& instance, const DicedMesh& mesh, const Corners& corners, float time)
      : moving_(instance.moves() ? std::optional(placementAt(instance, time)) : std::nullopt),
        place_(moving_ ? *moving_ : instance.still) {
    const std::array<Vec3f, 3> p = corners.at(time, mesh.positions, mesh.motion_positions);
    p0 = p[0], edge1 = p[1] - p[0], edge2 = p[2] - p[0];
  }
  PlacedTriangle(const PlacedTriangle&) = delete;
  PlacedTriangle& operator=(const PlacedTriangle&) = delete;

  const Placement& place() const { return place_; }

  Vec3f p0, edge1, edge2;

 private:
  std::optional<Placement> moving_;
  const Placement& place_;
};

// A triangle in prototype space, scaled so that its longest edge component is 1: cross products and their
// squares then neither underflow nor overflow, however small micropolygons are.
struct LocalTriangle {
  Vec3f e1, e2;  // scaled
  Vec3f normal;  // e1 × e2
  float scale;   // true size / scaled size

  LocalTriangle(Vec3f edge1, Vec3f edge2)
      : scale(std::max(maxComponent(absolute(edge1)), maxComponent(absolute(edge2)))) {
    const float factor = scale > 0 ? 1 / scale : 0;
    e1 = edge1 * factor, e2 = edge2 * factor;
    normal = cross(e1, e2);
  }

  float planeError() const;
};

// e1, e2: of the triangle, in world space; uv1, uv2: change of the parameters along them.
ParameterGradients parameterGradients(Vec2f uv1, Vec2f uv2, Vec3f e1, Vec3f e2, Vec2f scale);
ParameterGradients parameterGradients(const DicedMesh& mesh, const Corners& corners, Vec3f e1, Vec3f e2, Vec2f scale);

}  // namespace encore
