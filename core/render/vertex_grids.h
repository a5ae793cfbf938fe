// Faces split and diced for vertex shading, as Reyes does it (Cook, Carpenter & Catmull 1987): a face that is large on
// the film is halved until each part is one uniform grid of micropolygons.
//
// Unlike whole Reyes grids, vertices are shaded by tiles of 4 × 4, and only where a sample asks for one of a tile:
// kinder to the method than what it is compared with in the paper (Hou et al. 2010 shade whole grids), and a tile's
// rays still fill packets. A tile depends on nothing but its face, the camera and the settings.
#pragma once

#include <tbb/concurrent_unordered_map.h>

#include <array>
#include <atomic>
#include <bit>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "core/path/path.h"
#include "core/render/face_shape.h"
#include "core/render/shading_rates.h"
#include "core/render/vertex_views.h"

namespace encore {

inline constexpr uint32_t kTileSide = 4;  // vertices
inline constexpr uint32_t kTileVertices = kTileSide * kTileSide;
// Micropolygons along a grid's side: 16 vertices, which are whole tiles. RenderMan's grids are of 16 × 16.
inline constexpr uint32_t kMaxGridCells = 15;
// Wide beams see coarser grids, each level with micropolygons of twice the side (Christensen et al. 2006).
inline constexpr uint32_t kGridLevels = 8;

// What is kept at vertices: what each layer shows of them, and the radiance that shade() returns, which direct
// samples see through the absorption weight of the vertex and secondary hits through that of their path.
inline constexpr uint32_t kShadedValues = kMaxLayers;
inline constexpr uint32_t kVertexValues = kMaxLayers + 1;

struct VertexTile {
  std::atomic<uint8_t> requested{0};   // bit per kind of value
  std::atomic<uint8_t> shaded_for{0};  // bit per layer that has asked for shaded radiance
  uint16_t used = 0;                   // bit per vertex that some point of the face is interpolated from
  std::array<std::unique_ptr<std::array<Vec3f, kTileVertices>>, kVertexValues> values;
};

// A rectangle of a face's (u, v) domain: split further, or a grid.
struct VertexGrid {
  enum class Split : uint8_t { None, U, V, Both };

  Vec2f origin{0, 0}, size{1, 1};
  Split split = Split::None;
  bool diagonal = false;                // only its half below the diagonal, towards its origin, belongs to the face
  uint8_t nu = 1, nv = 1;               // micropolygons along u and v; equal where diagonal
  std::unique_ptr<VertexTile[]> tiles;  // of a grid, u fastest
  std::unique_ptr<VertexGrid[]> owned_children;  // 2 or 4, the second half along u next to the first
  std::atomic<VertexGrid*> children{nullptr};    // the same, once they are there

  uint32_t tilesAcross() const { return nu / kTileSide + 1; }
  uint32_t tileCount() const { return tilesAcross() * (nv / kTileSide + 1u); }
  Vec2f vertexUv(uint32_t i, uint32_t j) const {
    return {origin.x + size.x * (float(i) / float(nu)), origin.y + size.y * (float(j) / float(nv))};
  }
};

class VertexFace;

// A tile that is to be computed. Ordered by what it is, not by where it lies in memory.
struct TileRequest {
  const VertexFace* face = nullptr;
  VertexGrid* grid = nullptr;
  uint32_t tile = 0;  // within the grid
};
bool operator<(const TileRequest& a, const TileRequest& b);

// The micropolygon that a point lies in. grid null: no surface.
struct GridCell {
  const VertexFace* face = nullptr;
  VertexGrid* grid = nullptr;
  uint8_t i = 0, j = 0;
  float fu = 0, fv = 0;  // within the micropolygon, in [0, 1]

  // Asks for the tiles that interpolate() needs; those nobody has asked for before are appended to requests.
  // Thread-safe with a list per thread.
  void request(uint32_t value, std::vector<TileRequest>& requests) const;
  void markShadedFor(Layer layer) const;
  // Bilinear; linear in the halved micropolygons along the diagonal of a triangular face.
  Vec3f interpolate(uint32_t value) const;

 private:
  bool halved() const { return grid->diagonal && uint32_t(i) + j + 1 == grid->nu; }
  bool needs(int corner) const;
  VertexTile& tile(int corner) const;
  uint32_t slot(int corner) const;
};

// One side of a primitive of an instance, at one level.
class VertexFace {
 public:
  // pixel_area: of a micropolygon of level 0. hit: any on the face.
  VertexFace(const Scene& scene, const DicedMesh& mesh, const VertexViews& views, const Hit& hit, SurfaceKey key,
             float pixel_area, uint32_t level);

  SurfaceKey key() const { return key_; }
  uint32_t level() const { return level_; }
  // The one that the face's point at (u, v), or at a hit, lies in.
  GridCell cell(Vec2f uv);
  GridCell cell(const Hit& hit);
  // Points of the vertices of a tile, as hits that lack t; not valid where the vertex is not used.
  std::array<Hit, kTileVertices> vertices(const TileRequest& tile) const;
  // Key of the tile's random numbers: below 2^31.
  uint32_t randomKey(const TileRequest& tile) const;
  const VertexGrid& root() const { return root_; }
  uint64_t memoryBytes() const { return sizeof(*this) + shape_.memoryBytes(); }

 private:
  void plan(VertexGrid& grid) const;
  VertexGrid* expand(VertexGrid& grid);
  Vec3f worldPoint(Vec2f uv) const;

  const DicedMesh& mesh_;
  const VertexViews& views_;
  FaceShape shape_;
  Affine3f to_world_;
  Hit hit_;
  SurfaceKey key_;
  uint32_t level_;
  float side_pixels_;  // of a micropolygon
  std::mutex mutex_;   // of expand()
  VertexGrid root_;
};

// All faces that have been asked for.
class VertexGrids {
 public:
  // Keeps references. Throws Error(Internal) where a mesh's triangles are not in the order of their primitives.
  VertexGrids(const Scene& scene, const Settings& settings, const DicedMeshes& diced, const VertexViews& views);

  // key: that of the hit's SurfacePoint. level: below kGridLevels. Thread-safe.
  GridCell cell(const Hit& hit, SurfaceKey key, uint32_t level = 0);
  // Calls visit(tile) for every tile that exists.
  template <class Visit>
  void forEachTile(const Visit& visit) const {
    for (const Faces& faces : faces_)
      for (const auto& entry : faces) forEachTileOf(entry.second->root(), visit);
  }
  uint64_t memoryBytes() const;
  void clear() {
    for (Faces& faces : faces_) faces.clear();
  }

 private:
  using Faces = tbb::concurrent_unordered_map<uint64_t, std::unique_ptr<VertexFace>>;

  template <class Visit>
  static void forEachTileOf(const VertexGrid& grid, const Visit& visit) {
    if (const VertexGrid* children = grid.children.load(std::memory_order_acquire)) {
      const int count = grid.split == VertexGrid::Split::Both ? 4 : 2;
      for (int k = 0; k < count; ++k) forEachTileOf(children[k], visit);
    }
    if (grid.tiles)
      for (uint32_t t = 0; t < grid.tileCount(); ++t) visit(grid.tiles[t]);
  }

  const Scene& scene_;
  DicedMeshes diced_;
  const VertexViews& views_;
  ShadingRates rates_;
  std::array<Faces, kGridLevels> faces_;
};

}  // namespace encore
