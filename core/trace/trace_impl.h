// What the files of core/trace share; not for other rooms.
#pragma once

#include <memory>
#include <vector>

#include "core/trace/embree_api.h"
#include "core/trace/packets.h"
#include "core/trace/parameter_scale.h"
#include "core/trace/trace_scene.h"

namespace encore {

// A mesh in its place within a prototype.
struct TracedMesh {
  const Mesh* mesh = nullptr;
  const DicedMesh* diced = nullptr;
  uint32_t first_primitive = 0;  // of the mesh, within the prototype
};

struct TracedPrototype {
  embree::Scene scene;  // null: no instance places it
  std::vector<TracedMesh> meshes;
  uint32_t primitives = 0;
};

struct TracedInstance {
  uint32_t prototype = 0;
  int32_t material = -1;
  bool traceable = true;     // else left out; see TraceScene::untraceable()
  float largest_origin = 0;  // of rays, so that they stay in Embree's range in prototype space
  Affine3f to_world, to_prototype;
  // Rows of the matrix that bounds, per world axis and unit of |world coordinates| + |translation|, how far
  // Embree's transform of a ray into prototype space may err, seen in world space.
  Vec3f ray_error_x, ray_error_y, ray_error_z;
};

struct TraceScene::Impl {
  Impl(const Scene& scene_, const std::vector<DicedMesh>& diced_)
      : scene(scene_), diced(diced_), half_packets(device.prefersHalfPackets()) {}

  const Scene& scene;
  const std::vector<DicedMesh>& diced;
  embree::Device device;
  bool half_packets;  // see embree::Query
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
  void buildPrototype(uint32_t index);
  void buildTop();
};

// Bound on the relative error of n rounded operations in a row (Higham; PBR 4th ed., eq. 6.17).
constexpr double roundingGamma(int n) { return n * 0x1p-24 / (1 - n * 0x1p-24); }

TracedInstance makeInstance(const Instance& instance);
// Index into Scene::materials. primitive: of the mesh.
int32_t resolveMaterial(const TracedInstance& instance, const TracedMesh& mesh, uint32_t primitive);

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

// e1, e2: of the triangle, in world space.
ParameterGradients parameterGradients(const DicedMesh& mesh, const Corners& corners, Vec3f e1, Vec3f e2, Vec2f scale);

}  // namespace encore
