#include "core/dice/dice.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "core/dice/curves.h"
#include "core/dice/dice_cache.h"
#include "core/dice/displacement.h"
#include "core/dice/edge_length.h"
#include "core/dice/micropolygon_cap.h"
#include "core/dice/spheres.h"
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
    if (mesh.shape == Shape::Points) {
      spheres_ = spheresOf(mesh, max_micropolygons);
      return;
    }
    if (mesh.shape == Shape::Curves) {
      curves_.emplace(mesh, edge_length, max_micropolygons);
      return;
    }
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
    if (spheres_) return spheres_->micropolygons;
    if (curves_) return curves_->micropolygons();
    return subdivision_ ? subdivision_->micropolygons() : mesh_.face_vertex_counts.size();
  }

  DicedMesh dice() {
    if (spheres_) return std::move(*spheres_);
    if (curves_) return curves_->dice();
    return subdivision_ ? subdivision_->dice() : undicedMesh(mesh_);
  }

 private:
  const Mesh& mesh_;
  std::optional<SubdivisionDicer> subdivision_;
  std::optional<CurveDicer> curves_;
  std::optional<DicedMesh> spheres_;
};

// Still faces of these are triangulated as they are.
bool ignoresLength(const Mesh& mesh) {
  if (mesh.shape != Shape::Faces) return mesh.shape == Shape::Points;
  return mesh.scheme == SubdivisionScheme::None ||
         (mesh.scheme == SubdivisionScheme::Bilinear && !(mesh.target_edge_length_world > 0));
}

// The meshes of a scene under one cap. Every mesh is counted, whatever fails, so that errors do not depend on threads;
// only what fits is made.
class SceneDicer {
 public:
  SceneDicer(const Scene& scene, const Settings& settings, Patterns* patterns, DiceCache* cache)
      : scene_(scene),
        cap_(settings.max_micropolygons),
        lengths_(resolvedEdgeLengths(scene, settings)),
        patterns_(patterns),
        cache_(cache),
        source_(patterns ? displacementOf(*patterns) : nullptr),
        displacing_(scene.meshes.size()),
        counts_(scene.meshes.size(), 0),
        errors_(scene.meshes.size()),
        diced_(scene.meshes.size(), std::make_shared<const DicedMesh>()) {}

  DicedMeshes dice() {
    for (size_t i = 0; i < scene_.meshes.size() && source_; ++i)
      if (lengths_[i] > 0 && scene_.meshes[i].shape == Shape::Faces)
        displacing_[i] = displacingMaterials(scene_.meshes[i], *source_);
    findKept();
    tbb::parallel_for(size_t{0}, scene_.meshes.size(), [&](size_t i) {
      if (lengths_[i] > 0 && displacing_[i].empty()) tryTo(i, [&] { diceStill(i); });
    });
    // One after the other, because patterns are; each in parallel.
    for (size_t i = 0; i < scene_.meshes.size(); ++i)
      if (!displacing_[i].empty()) tryTo(i, [&] { diceDisplaced(i); });
    keep();
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

  // Looks up what the scene before has left.
  void findKept() {
    if (!cache_) return;
    keys_.resize(scene_.meshes.size());
    kept_.resize(scene_.meshes.size());
    textures_.resize(scene_.meshes.size());
    for (size_t i = 0; i < scene_.meshes.size(); ++i)
      if (lengths_[i] > 0) keys_[i] = keyOf(i);
    cache_->retain(keys_);
    for (size_t i = 0; i < scene_.meshes.size(); ++i) kept_[i] = cache_->find(keys_[i]);
  }

  DiceKey keyOf(size_t i) {
    const Mesh& mesh = scene_.meshes[i];
    if (!mesh.identity) return {};
    if (displacing_[i].empty()) return {mesh.identity.get(), ignoresLength(mesh) ? 0 : lengths_[i], cap_, {}};
    DiceKey key{mesh.identity.get(), lengths_[i], cap_, {}};
    int32_t known = -1;
    for (const int32_t material : std::set<int32_t>(displacing_[i].begin(), displacing_[i].end())) {
      if (material < 0) continue;
      PatternFingerprint print = patterns_->fingerprint(PatternPart::Displacement, material);
      if (print.text.empty()) return {};
      key.displacement += print.text;
      textures_[i].insert(textures_[i].end(), print.textures.begin(), print.textures.end());
      known = material;
    }
    // Where all faces are displaced alike, the material is all there is to say.
    if (!std::all_of(displacing_[i].begin(), displacing_[i].end(), [&](int32_t m) { return m == known; }))
      key.displacement.append(reinterpret_cast<const char*>(displacing_[i].data()),
                              displacing_[i].size() * sizeof(int32_t));
    return key;
  }

  const DiceCache::Entry* keptOf(size_t i) const { return cache_ ? kept_[i] : nullptr; }

  void diceStill(size_t i) {
    if (const DiceCache::Entry* kept = keptOf(i)) {
      diced_[i] = kept->mesh, counts_[i] = kept->micropolygons;
      total_ += counts_[i];
      return;
    }
    Dicer dicer(scene_.meshes[i], lengths_[i], cap_);
    counts_[i] = dicer.micropolygons();
    if (total_.fetch_add(counts_[i]) + counts_[i] > cap_) return;
    set(i, dicer.dice());
  }

  void diceDisplaced(size_t i) {
    const uint64_t budget = cap_ - std::min(cap_, total_.load());
    if (const DiceCache::Entry* kept = keptOf(i); kept && kept->micropolygons <= budget) {
      diced_[i] = kept->mesh, counts_[i] = kept->micropolygons;
      for (const auto& texture : kept->textures) texture->reused();
    } else {
      DisplacedDicer dicer(scene_.meshes[i], std::move(displacing_[i]), lengths_[i], cap_, *source_);
      set(i, dicer.dice(budget));
      counts_[i] = dicer.micropolygons();
    }
    total_ += counts_[i];
  }

  void set(size_t i, DicedMesh&& diced) {
    dropDegenerate(diced);
    diced_[i] = std::make_shared<const DicedMesh>(std::move(diced));
  }

  // Leaves what was diced to the scene that follows. What the cap has cut off is not there to be kept.
  void keep() {
    if (!cache_) return;
    for (size_t i = 0; i < scene_.meshes.size(); ++i) {
      if (!(lengths_[i] > 0) || errors_[i] || (kept_[i] && kept_[i]->mesh == diced_[i])) continue;
      cache_->countDiced();
      if (total_ <= cap_)
        cache_->add(std::move(keys_[i]), {diced_[i], counts_[i], scene_.meshes[i].identity, std::move(textures_[i])});
    }
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
  Patterns* patterns_;
  DiceCache* cache_;
  std::unique_ptr<DisplacementSource> source_;
  std::vector<std::vector<int32_t>> displacing_;  // materials of faces; empty: not displaced
  std::vector<uint64_t> counts_;
  std::vector<std::exception_ptr> errors_;
  std::vector<DicedMeshes::Pointer> diced_;
  std::atomic<uint64_t> total_ = 0;
  // Only with a cache.
  std::vector<DiceKey> keys_;
  std::vector<const DiceCache::Entry*> kept_;
  std::vector<std::vector<std::shared_ptr<const TextureSource>>> textures_;  // that the key names
};

}  // namespace

DicedMesh diceMesh(const Mesh& mesh, float edge_length, uint64_t max_micropolygons) {
  DicedMesh diced = Dicer(mesh, edge_length, max_micropolygons).dice();
  dropDegenerate(diced);
  return diced;
}

DicedMeshes diceScene(const Scene& scene, const Settings& settings, Patterns* patterns, DiceCache* cache) {
  return SceneDicer(scene, settings, patterns, cache).dice();
}

}  // namespace encore
