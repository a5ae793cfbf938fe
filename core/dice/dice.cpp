#include "core/dice/dice.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "core/dice/displacement.h"
#include "core/dice/edge_length.h"
#include "core/dice/micropolygon_cap.h"
#include "core/dice/subdivision.h"
#include "core/dice/undiced.h"

namespace encore {
namespace {

bool hasArea(const std::vector<Vec3f>& positions, const uint32_t* v) {
  const Vec3d p = toDouble(positions[v[0]]);
  return cross(toDouble(positions[v[1]]) - p, toDouble(positions[v[2]]) - p) != Vec3d{0, 0, 0};
}

// Triangles that never have area cannot be hit, but could be divided by. Primitives keep their numbers.
void dropDegenerate(DicedMesh& mesh) {
  size_t kept = 0;
  for (size_t i = 0; i < mesh.triangleCount(); ++i) {
    const uint32_t* v = &mesh.triangles[3 * i];
    bool has_area = hasArea(mesh.positions, v);
    for (size_t key = 0; key < mesh.motion_positions.size() && !has_area; ++key)
      has_area = hasArea(mesh.motion_positions[key], v);
    if (!has_area) continue;
    for (int k = 0; k < 3; ++k) mesh.triangles[3 * kept + k] = v[k];
    mesh.triangle_primitive[kept++] = mesh.triangle_primitive[i];
  }
  mesh.triangles.resize(3 * kept);
  mesh.triangle_primitive.resize(kept);
}

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

  DicedMesh dice() { return subdivision_ ? subdivision_->dice() : undicedMesh(mesh_); }

 private:
  const Mesh& mesh_;
  std::optional<SubdivisionDicer> subdivision_;
};

// The meshes of a scene under one cap. Every mesh is counted, whatever fails, so that errors do not depend on threads;
// only what fits is made.
class SceneDicer {
 public:
  SceneDicer(const Scene& scene, const Settings& settings, Patterns* patterns)
      : scene_(scene),
        cap_(settings.max_micropolygons),
        lengths_(resolvedEdgeLengths(scene, settings)),
        source_(patterns ? displacementOf(*patterns) : nullptr),
        counts_(scene.meshes.size(), 0),
        errors_(scene.meshes.size()),
        diced_(scene.meshes.size()) {}

  std::vector<DicedMesh> dice() {
    std::vector<std::vector<int32_t>> displacing(scene_.meshes.size());  // materials of faces
    for (size_t i = 0; i < scene_.meshes.size() && source_; ++i)
      if (lengths_[i] > 0) displacing[i] = displacingMaterials(scene_.meshes[i], *source_);
    tbb::parallel_for(size_t{0}, scene_.meshes.size(), [&](size_t i) {
      if (lengths_[i] > 0 && displacing[i].empty()) tryTo(i, [&] { diceStill(i); });
    });
    // One after the other, because patterns are; each in parallel.
    for (size_t i = 0; i < scene_.meshes.size(); ++i)
      if (!displacing[i].empty()) tryTo(i, [&] { diceDisplaced(i, std::move(displacing[i])); });
    for (const auto& error : errors_)
      if (error) std::rethrow_exception(error);
    checkCap();
    return std::move(diced_);
  }

 private:
  template <class Body>
  void tryTo(size_t i, const Body& body) {
    try {
      body();
    } catch (...) {
      errors_[i] = std::current_exception();
    }
  }

  void diceStill(size_t i) {
    Dicer dicer(scene_.meshes[i], lengths_[i], cap_);
    counts_[i] = dicer.micropolygons();
    if (total_.fetch_add(counts_[i]) + counts_[i] > cap_) return;
    diced_[i] = dicer.dice();
    dropDegenerate(diced_[i]);
  }

  void diceDisplaced(size_t i, std::vector<int32_t> materials) {
    DisplacedDicer dicer(scene_.meshes[i], std::move(materials), lengths_[i], cap_, *source_);
    diced_[i] = dicer.dice(cap_ - std::min(cap_, total_.load()));
    dropDegenerate(diced_[i]);
    counts_[i] = dicer.micropolygons();
    total_ += counts_[i];
  }

  void checkCap() const {
    if (total_ <= cap_) return;
    const size_t most = size_t(std::max_element(counts_.begin(), counts_.end()) - counts_.begin());
    throw overMicropolygonCap(
        scene_.meshes[most], "the scene makes " + std::to_string(total_) + " micropolygons, more than the cap of " +
                                 std::to_string(cap_) + "; this mesh makes the most, " + std::to_string(counts_[most]) +
                                 ", with an edge length of " + lengthText(lengths_[most]) + " in prototype space");
  }

  const Scene& scene_;
  uint64_t cap_;
  std::vector<float> lengths_;
  std::unique_ptr<DisplacementSource> source_;
  std::vector<uint64_t> counts_;
  std::vector<std::exception_ptr> errors_;
  std::vector<DicedMesh> diced_;
  std::atomic<uint64_t> total_ = 0;
};

}  // namespace

DicedMesh diceMesh(const Mesh& mesh, float edge_length, uint64_t max_micropolygons) {
  DicedMesh diced = Dicer(mesh, edge_length, max_micropolygons).dice();
  dropDegenerate(diced);
  return diced;
}

std::vector<DicedMesh> diceScene(const Scene& scene, const Settings& settings, Patterns* patterns) {
  return SceneDicer(scene, settings, patterns).dice();
}

}  // namespace encore
