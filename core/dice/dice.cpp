#include "core/dice/dice.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <optional>
#include <string>

#include "core/dice/edge_length.h"
#include "core/dice/micropolygon_cap.h"
#include "core/dice/subdivision.h"
#include "core/dice/undiced.h"

namespace encore {
namespace {

// A mesh whose cost is known, and which is not yet made.
class Dicer {
 public:
  Dicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons) : mesh_(mesh) {
    if (mesh.scheme == SubdivisionScheme::None) {
      if (mesh.face_vertex_counts.size() > max_micropolygons)
        throw overMicropolygonCap(mesh, std::to_string(mesh.face_vertex_counts.size()) +
                                            " undiced faces are more than the cap of " +
                                            std::to_string(max_micropolygons) + " micropolygons");
      return;
    }
    // Faces of bilinear meshes are as flat as they come: finer grids would only help where they are to be
    // bent or measured later, so dicing them is left to an explicit wish.
    const bool undiced = mesh.scheme == SubdivisionScheme::Bilinear && !(mesh.target_edge_length_world > 0);
    subdivision_.emplace(mesh, undiced ? std::numeric_limits<float>::infinity() : edge_length, max_micropolygons);
  }

  uint64_t micropolygons() const {
    return subdivision_ ? subdivision_->micropolygons() : mesh_.face_vertex_counts.size();
  }

  DicedMesh dice() const {
    DicedMesh diced = subdivision_ ? subdivision_->dice() : undicedMesh(mesh_);
    dropDegenerate(diced);
    return diced;
  }

 private:
  // Triangles without area cannot be hit, but could be divided by. Primitives keep their numbers.
  static void dropDegenerate(DicedMesh& mesh) {
    size_t kept = 0;
    for (size_t i = 0; i < mesh.triangleCount(); ++i) {
      const uint32_t* v = &mesh.triangles[3 * i];
      const Vec3d p = toDouble(mesh.positions[v[0]]);
      const Vec3d area = cross(toDouble(mesh.positions[v[1]]) - p, toDouble(mesh.positions[v[2]]) - p);
      if (area == Vec3d{0, 0, 0}) continue;
      for (int k = 0; k < 3; ++k) mesh.triangles[3 * kept + k] = v[k];
      mesh.triangle_primitive[kept++] = mesh.triangle_primitive[i];
    }
    mesh.triangles.resize(3 * kept);
    mesh.triangle_primitive.resize(kept);
  }

  const Mesh& mesh_;
  std::optional<SubdivisionDicer> subdivision_;
};

}  // namespace

DicedMesh diceMesh(const Mesh& mesh, float edge_length, uint64_t max_micropolygons) {
  return Dicer(mesh, edge_length, max_micropolygons).dice();
}

std::vector<DicedMesh> diceScene(const Scene& scene, const Settings& settings) {
  const std::vector<float> lengths = resolvedEdgeLengths(scene, settings);
  const uint64_t cap = settings.max_micropolygons;
  std::vector<DicedMesh> diced(scene.meshes.size());
  std::vector<uint64_t> counts(scene.meshes.size(), 0);
  std::vector<std::exception_ptr> errors(scene.meshes.size());
  // Every mesh is counted, whatever fails, so that errors do not depend on threads; only what fits is made.
  std::atomic<uint64_t> total = 0;
  tbb::parallel_for(size_t{0}, scene.meshes.size(), [&](size_t i) {
    if (!(lengths[i] > 0)) return;
    try {
      const Dicer dicer(scene.meshes[i], lengths[i], cap);
      counts[i] = dicer.micropolygons();
      if (total.fetch_add(counts[i]) + counts[i] <= cap) diced[i] = dicer.dice();
    } catch (...) {
      errors[i] = std::current_exception();
    }
  });
  for (const auto& error : errors)
    if (error) std::rethrow_exception(error);
  if (total > cap) {
    const size_t most = size_t(std::max_element(counts.begin(), counts.end()) - counts.begin());
    throw overMicropolygonCap(scene.meshes[most],
                              "the scene makes " + std::to_string(total) + " micropolygons, more than the cap of " +
                                  std::to_string(cap) + "; this mesh makes the most, " + std::to_string(counts[most]) +
                                  ", with an edge length of " + lengthText(lengths[most]) + " in prototype space");
  }
  return diced;
}

}  // namespace encore
