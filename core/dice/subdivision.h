// Dicing of one subdivision mesh: rates first, which are cheap to hold, then the grids.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/dice/dice.h"
#include "core/dice/limit_surface.h"
#include "core/dice/primvars.h"
#include "core/dice/shared_edges.h"
#include "core/dice/tessellation.h"
#include "core/scene/mesh.h"

namespace encore {

class SubdivisionDicer {
 public:
  // Finds the rates. Arguments and errors as diceMesh; infinite edge_length: every rate is the least
  // possible. mesh must outlive this.
  SubdivisionDicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons);

  uint64_t micropolygons() const { return micropolygons_; }
  DicedMesh dice() const;

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
  struct Emitter;

  int32_t faceCount() const { return int32_t(first_primitive_.size()) - 1; }
  LimitSurface positionSurface() const;
  Tessellation tessellation(const Primitive& primitive) const;
  void listPrimitives();
  void measure();
  void sampleEdges();
  void refineGrids();
  void refineQuad(Primitive& primitive, const LimitSurface& surface) const;
  void refineTriangle(Primitive& primitive, const LimitSurface& surface) const;
  bool isTooMuch(const Tessellation& t) const;
  void count();

  const Mesh& mesh_;
  double edge_length_;
  double allowed_;  // edge_length_ plus what rounding may add
  uint64_t max_micropolygons_;
  std::vector<FaceVaryingChannel> channels_;
  std::vector<LimitPrimvar<Vec2f>> texcoords_;
  std::vector<LimitPrimvar<Vec3f>> display_color_;  // none or one
  LimitTopology topology_;
  SharedEdges shared_;
  std::vector<Primitive> primitives_;
  std::vector<uint32_t> first_primitive_;  // per face, and the end
  uint64_t micropolygons_ = 0;
};

}  // namespace encore
