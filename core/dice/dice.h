// Base faces → primitives and micropolygons (§3.4): subdivision surfaces become grids on the limit
// surface whose edges are at most a target length in world space; polygons stay as they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "core/scene/math.h"
#include "core/scene/scene.h"

namespace encore {

class DiceCache;
class Patterns;

// Triangles of one mesh, ready to trace. Every primitive owns its vertices, so that everything is per
// vertex; positions along an edge that two primitives share are bit-identical (no cracks).
// Triangles wind so that cross(p1 - p0, p2 - p0) points to the outside (orientation respected).
struct DicedMesh {
  std::vector<Vec3f> positions;               // prototype space
  std::vector<Vec3f> normals;                 // per vertex, unit, outside; empty: faceted
  std::vector<Vec2f> uv;                      // parametric coordinates within the primitive, in [0, 1]²
  std::vector<std::vector<Vec2f>> texcoords;  // per vertex, in the order of Mesh::texcoords
  std::vector<Vec3f> display_color;           // per vertex, or empty
  std::vector<std::vector<Vec4f>> primvars;   // per vertex, in the order of Mesh::primvars
  // At uniform times over the shutter, as many as Mesh::motion_points; empty: still. positions and normals are those
  // of the frame's time. Normals are empty where the mesh is faceted.
  std::vector<std::vector<Vec3f>> motion_positions, motion_normals;
  std::vector<uint32_t> triangles;           // 3 indices per triangle
  std::vector<uint32_t> triangle_primitive;  // per triangle
  std::vector<uint32_t> primitive_face;      // per primitive: base face (before quadrangulation)
  uint64_t micropolygons = 0;                // quads of grids, and undiced faces as one each
  uint64_t lost_displacements = 0;           // values that were not finite, and count as 0

  // Of points, which are primitives each, and instead of all that is per vertex, triangle or primitive above: centres
  // and radii; a negative radius: there is nothing. texcoords, display_color and primvars are per sphere, or one value
  // for all of them.
  std::vector<Vec4f> spheres;
  std::vector<std::vector<Vec4f>> motion_spheres;  // as motion_positions

  size_t triangleCount() const { return triangle_primitive.size(); }
  size_t primitiveCount() const { return spheres.empty() ? primitive_face.size() : spheres.size(); }
};

// The diced meshes of a scene, in the order of Scene::meshes. Copies share them.
class DicedMeshes {
 public:
  using Pointer = std::shared_ptr<const DicedMesh>;
  class Iterator {
   public:
    using iterator_category = std::forward_iterator_tag;
    using value_type = DicedMesh;
    using difference_type = std::ptrdiff_t;
    using pointer = const DicedMesh*;
    using reference = const DicedMesh&;

    Iterator() = default;
    explicit Iterator(const Pointer* at) : at_(at) {}
    reference operator*() const { return **at_; }
    pointer operator->() const { return at_->get(); }
    Iterator& operator++() { return ++at_, *this; }
    Iterator operator++(int) { return Iterator(at_++); }
    bool operator==(const Iterator&) const = default;

   private:
    const Pointer* at_ = nullptr;
  };

  DicedMeshes() = default;
  DicedMeshes(std::vector<Pointer> meshes) : meshes_(std::move(meshes)) {}  // none of them null
  DicedMeshes(std::vector<DicedMesh> meshes) {
    for (DicedMesh& mesh : meshes) meshes_.push_back(std::make_shared<const DicedMesh>(std::move(mesh)));
  }

  size_t size() const { return meshes_.size(); }
  const DicedMesh& operator[](size_t i) const { return *meshes_[i]; }
  const DicedMesh& at(size_t i) const { return *meshes_.at(i); }
  const Pointer& shared(size_t i) const { return meshes_[i]; }
  Iterator begin() const { return Iterator(meshes_.data()); }
  Iterator end() const { return Iterator(meshes_.data() + meshes_.size()); }

 private:
  std::vector<Pointer> meshes_;
};

// Largest factor by which the transform stretches a vector (its largest singular value).
float largestScale(const Affine3d& transform);

// The edge length, in world space, of subdivision meshes without their own:
//   max(min(mesh / 128, base_edge / 4), min(scene / 4096, mesh / 64)).
// mesh / 128 draws a sphere with some 230 edges around; base_edge / 4 keeps thin parts of large meshes
// round; scene / 4096 is a pixel of a 4K frame that shows everything, and finer would be wasted on the
// many small things of a large scene, but a huge ground must not coarsen a mesh below mesh / 64.
// Independent of the camera, so that a shot dices alike in every frame.
// mesh_diagonal_world, scene_diagonal_world: diagonals of the bounding boxes (the mesh's own box times its
// largest scale, so that turning it changes nothing). base_edge_world: mean length of the base faces' edges.
// The result is > 0 and finite when mesh_diagonal_world is; 1 when it is not.
float defaultEdgeLength(float mesh_diagonal_world, float scene_diagonal_world,
                        float base_edge_world = std::numeric_limits<float>::infinity());

// Dices one mesh. edge_length: target length in prototype space (world length / largest scale), > 0; edges
// of grids keep it within 1e-5 of itself and float rounding of positions (the strips that join neighbours
// of different rates, and diagonals, may be longer).
// Bilinear meshes are diced only where they have a target_edge_length_world of their own. Curves: see
// core/dice/curves.h. Points are not diced: core/trace takes spheres.
// Throws Error(Memory) that names the mesh and the edge length when it would make more than
// max_micropolygons, Error(Scene) when OpenSubdiv cannot use the topology.
// Precondition: validateMesh(mesh).
DicedMesh diceMesh(const Mesh& mesh, float edge_length, uint64_t max_micropolygons);

// Dices every mesh of the scene at its resolved edge length, in parallel, deterministically. Rates hold at all times
// of the shutter, so that topology is constant.
// patterns: displace meshes whose materials say so (§3.4): vertices that faces share move to one place, whatever
// their texture coordinates say on each face, and normals are those of the displaced surface. Polygons that are not
// subdivided are diced where they are displaced. An instance that overrides the material does not change the
// displacement, which is that of the mesh's own materials. Null: nothing is displaced. Edges of displaced grids keep
// the length within 5 %, unless the displacement is so steep that a rate of 8 times the undisplaced one is not enough,
// or so rough that three rounds of measuring miss some of it. Meshes whose every face is undiced ignore the length;
// meshes that no instance shows come back empty. Returned in the order of scene.meshes. max_micropolygons bounds the
// sum over the meshes. Errors as diceMesh: that of the first mesh that has one.
// cache: meshes that are in it are taken from there, and it holds those of this scene afterwards. Null: none.
DicedMeshes diceScene(const Scene& scene, const Settings& settings, Patterns* patterns = nullptr,
                      DiceCache* cache = nullptr);

}  // namespace encore
