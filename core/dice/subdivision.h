// Dicing of one subdivision mesh: rates first, which are cheap to hold, then the grids.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/dice/chords.h"
#include "core/dice/dice.h"
#include "core/dice/grids.h"
#include "core/dice/limit_surface.h"
#include "core/dice/poses.h"
#include "core/dice/primvars.h"
#include "core/dice/shared_edges.h"
#include "core/dice/tessellation.h"
#include "core/scene/mesh.h"

namespace encore {

// What only meshes that are displaced ask for.
struct DicingExtras {
  std::vector<uint8_t> diced_faces;  // 0: the face stays as coarse as its neighbours let it; empty: all are diced
  // Stand in for the surface's own normals: one for all poses, one for each, or none. Zero where the surface's count.
  std::vector<Primvar<Vec3f>> normals;
};

class SubdivisionDicer {
 public:
  // Finds the rates. Arguments and errors as diceMesh; infinite edge_length: every rate is the least
  // possible. mesh must outlive this.
  SubdivisionDicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons, DicingExtras extras = {});

  uint64_t micropolygons() const { return micropolygons_; }
  // grids: is told where everything lies; null: nobody asks.
  DicedMesh dice(Grids* grids = nullptr);
  // The edges of grids that were diced and then displaced are measured in all poses. Where one is longer than the
  // target by more than kStretchTolerance, rates rise, for the mesh to be diced anew; false: it may stay as it is.
  // A rate becomes at most kMostStretch times what it was at first: steps in a displacement are never fine enough.
  // Errors as diceMesh.
  bool refine(const DicedMesh& displaced, const Grids& grids);
  static constexpr double kStretchTolerance = 1.05;
  static constexpr uint32_t kMostStretch = 8;

 private:
  struct Lattice {
    Parameters u, v;
  };
  struct Primitive {
    int32_t face = 0;
    int32_t corner = 0;                // of a split face
    uint32_t nu = 1, nv = 1;           // rates asked for inside
    std::unique_ptr<Lattice> lattice;  // its lines, nu and nv segments; none: uniform
  };
  struct FirstRates {
    std::vector<uint32_t> edges, u, v;
  };
  struct Emitter;
  class Stretch;

  int32_t faceCount() const { return int32_t(first_primitive_.size()) - 1; }
  LimitSurface positionSurface() const;
  Tessellation tessellation(const Primitive& primitive) const;
  void findLines(const Primitive& primitive, const Tessellation& t, TessellationLines& lines) const;
  bool isDiced(int32_t face) const { return extras_.diced_faces.empty() || extras_.diced_faces[size_t(face)]; }
  bool isDicedEdge(uint32_t edge, int32_t owner) const;
  void listPrimitives();
  void measure();
  void sampleEdges();
  void refineGrids();
  void refineQuad(Primitive& primitive, const LimitSurface& surface) const;
  void refineTriangle(Primitive& primitive, const LimitSurface& surface) const;
  bool isTooMuch(const Tessellation& t) const;
  void count();
  DicedMesh allocate(size_t vertices, size_t triangles) const;
  void allocate(Grids& grids);
  void stretchEdges(const Stretch& stretch);
  void stretchGrids(const Stretch& stretch);

  const Mesh& mesh_;
  DicingExtras extras_;
  double edge_length_;
  Poses poses_;
  double allowed_;  // edge_length_ plus what rounding may add
  uint64_t max_micropolygons_;
  std::vector<FaceVaryingChannel> channels_;
  std::vector<LimitPrimvar<Vec2f>> texcoords_;
  std::vector<LimitPrimvar<Vec3f>> display_color_;  // none or one
  std::vector<LimitPrimvar<Vec4f>> primvars_;
  std::vector<LimitPrimvar<Vec3f>> normals_;  // DicingExtras::normals
  LimitTopology topology_;
  SharedEdges shared_;
  std::vector<Primitive> primitives_;
  std::vector<uint32_t> first_primitive_;  // per face, and the end
  uint64_t micropolygons_ = 0;
  FirstRates first_rates_;
};

}  // namespace encore
