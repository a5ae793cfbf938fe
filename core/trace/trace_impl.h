// What the files of core/trace share; not for other rooms.
#pragma once

#include <memory>
#include <vector>

#include "core/trace/embree_api.h"
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
  Impl(const Scene& scene_, const std::vector<DicedMesh>& diced_) : scene(scene_), diced(diced_) {}

  const Scene& scene;
  const std::vector<DicedMesh>& diced;
  embree::Device device;
  std::vector<TracedPrototype> prototypes;
  std::vector<TracedInstance> instances;
  embree::Scene top;
  float diagonal = 0;
  float largest_origin = embree::kLargestCoordinate;  // of rays

  const TracedMesh& meshOf(const Hit& hit) const {
    return prototypes[instances[hit.instance].prototype].meshes[hit.mesh];
  }
  void buildPrototype(uint32_t index);
  void buildTop();
};

// Bound on the relative error of n rounded operations in a row (Higham; PBR 4th ed., eq. 6.17).
constexpr double roundingGamma(int n) { return n * 0x1p-24 / (1 - n * 0x1p-24); }

TracedInstance makeInstance(const Instance& instance);

}  // namespace encore
