// Base faces → primitives and micropolygons (§3.4): subdivision surfaces become grids on the limit
// surface whose edges are at most a target length in world space; polygons stay as they are.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/math.h"
#include "core/scene/scene.h"

namespace encore {

// Triangles of one mesh, ready to trace. Every primitive owns its vertices, so that everything is per
// vertex; positions along an edge that two primitives share are bit-identical (no cracks).
// Triangles wind so that cross(p1 - p0, p2 - p0) points to the outside (orientation respected).
struct DicedMesh {
  std::vector<Vec3f> positions;              // prototype space
  std::vector<Vec3f> normals;                // per vertex, unit, outside; empty: faceted
  std::vector<Vec2f> uv;                     // parametric coordinates within the primitive, in [0, 1]²
  std::vector<std::vector<Vec2f>> texcoords;  // per vertex, in the order of Mesh::texcoords
  std::vector<Vec3f> display_color;          // per vertex, or empty
  std::vector<uint32_t> triangles;           // 3 indices per triangle
  std::vector<uint32_t> triangle_primitive;  // per triangle
  std::vector<uint32_t> primitive_face;      // per primitive: base face (before quadrangulation)
  uint64_t micropolygons = 0;                // quads of grids, and undiced faces as one each

  size_t triangleCount() const { return triangle_primitive.size(); }
  size_t primitiveCount() const { return primitive_face.size(); }
};

// Largest factor by which the transform stretches a vector (its largest singular value).
float largestScale(const Affine3d& transform);

// The edge length of meshes without their own: from the mesh's and the scene's world-space bounding box
// diagonals. Independent of the camera, so that a shot dices alike in every frame.
float defaultEdgeLength(float mesh_diagonal_world, float scene_diagonal_world);

// Dices one mesh. edge_length: target length in prototype space (world length / largest scale), > 0.
// Throws Error(Memory) that names the mesh and the edge length when it would make more than
// max_micropolygons. Precondition: validateMesh(mesh).
DicedMesh diceMesh(const Mesh& mesh, float edge_length, uint64_t max_micropolygons);

// Dices every mesh of the scene at its resolved edge length, in parallel, deterministically.
// Meshes whose every face is undiced ignore the length. Returned in the order of scene.meshes.
std::vector<DicedMesh> diceScene(const Scene& scene, const Settings& settings);

}  // namespace encore
