// Vertex shading, to be compared with: shading at the vertices of micropolygons, interpolated at antialiasing samples
// (Hou, Qin, Li, Guo & Zhou, "Micropolygon ray tracing with defocus and motion blur", SIGGRAPH 2010, after Reyes).
// Reflection and refraction are part of shading: a vertex follows the path of its layer once, and what that path
// meets is interpolated from vertices of the same cache (Christensen, Fong, Laur & Batali, "Ray tracing for the movie
// 'Cars'", 2006).
//
// The choices:
// - A micropolygon covers about 1 / shading rate pixels (the rate of the direct layer; one grid for all layers),
//   as the camera sees the face. Secondary hits use the same grids, or coarser ones by powers of two where the
//   beam of their path is wider than the camera's would be there.
// - Every vertex is shaded once per frame, whole tiles at a time (vertex_grids.h). Faces share no vertices, nor do
// levels.
// - At secondary hits the radiance of the vertices, shaded as if seen from the camera, is interpolated, and the
//   weight of absorption is that of the secondary ray. Vertices that turn away from the camera are shaded as
//   if seen from the mirror image of its direction.
// - Vertices beyond the border of a polygon stand at its nearest point.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "core/path/path.h"
#include "core/render/vertex_grids.h"
#include "core/render/vertex_views.h"

namespace encore {

class VertexShading {
 public:
  // Keeps references to what the context refers to and to diced (what context.trace was built from).
  VertexShading(const ShadeContext& context, const CameraRays& camera, const DicedMeshes& diced);
  VertexShading(const VertexShading&) = delete;
  VertexShading& operator=(const VertexShading&) = delete;

  // Radiance of antialiasing samples in one layer: interpolated, or that of a light or the background where they are
  // seen directly; 0 where the surface feeds nothing into the layer. first, ends: as in tracePaths().
  // A sample's radiance depends on nothing but its first hit. Not to be called from several threads at once.
  void shadeLayer(Layer layer, std::span<const FirstHit> first, std::span<const uint32_t> ends,
                  std::span<Vec3f> radiance);

  // Shading evaluations (vertices given to shade()) that the layer was the first to need, in the order of layers,
  // whatever the order of batches: their sum is that of all vertices shaded. Secondary hits count for the layer of
  // their path.
  uint64_t evaluations(Layer layer) const { return count(layer, kShadedValues); }
  // Vertices at which the layer itself was evaluated: for reflection and refraction a path each.
  uint64_t vertices(Layer layer) const { return count(layer, uint32_t(layer)); }
  uint64_t memoryBytes() const;  // of the cache; takes time
  // Empties the cache, which else holds the whole frame. Radiance stays the same; vertices that are needed again are
  // shaded and counted again.
  void evict();

 private:
  // Vertices of some tiles, tile after tile.
  struct Batch {
    std::vector<FirstHit> first;
    std::vector<uint32_t> view;  // that shows first's film position
    std::vector<uint8_t> slot;   // within the tile
    std::vector<uint32_t> ends;  // of each tile
  };

  uint32_t beamLevel(const PathVertex& vertex) const;
  GridCell seenCell(Layer layer, const FirstHit& first, Vec3f& radiance);
  void evaluate(Layer layer, std::span<const TileRequest> tiles);
  void evaluateDirect(std::span<const TileRequest> tiles);
  void evaluateBounces(Layer layer, std::span<const TileRequest> tiles);
  void shadeTiles(std::span<const TileRequest> tiles);
  Batch collect(std::span<const TileRequest> tiles) const;
  void addVertex(const Hit& hit, uint32_t side, uint32_t key, uint32_t slot, Batch& batch) const;
  std::vector<PathVertex> follow(Layer layer, const Batch& batch) const;
  PathVertex shadedVertex(const FirstHit& first, uint32_t view) const;
  void store(uint32_t value, std::span<const TileRequest> tiles, const Batch& batch, std::span<const Vec3f> radiance);
  uint64_t count(Layer layer, uint32_t value) const;
  bool counts(const VertexTile& tile, Layer layer, uint32_t value) const;

  const Settings settings_;     // in which lights hide no vertices
  const ShadeContext context_;  // with them
  const CameraRays camera_;
  std::vector<Light> camera_lights_;
  std::vector<std::array<uint8_t, kMaxLayers>> feeds_;  // per material and layer
  VertexViews views_;
  VertexGrids grids_;
  std::array<std::array<uint64_t, kVertexValues>, kMaxLayers> evicted_{};  // counts before evict()
};

}  // namespace encore
