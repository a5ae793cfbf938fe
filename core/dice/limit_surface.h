// Limit surfaces of base faces, through OpenSubdiv's Far (topology) and Bfr (surfaces).
#pragma once

#include <opensubdiv/bfr/refinerSurfaceFactory.h>
#include <opensubdiv/bfr/surface.h>
#include <opensubdiv/far/topologyRefiner.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <span>
#include <vector>

#include "core/dice/tessellation.h"
#include "core/scene/math.h"
#include "core/scene/mesh.h"

namespace encore {

// Indices of one face-varying primvar per face corner: they say where its surface has seams.
struct FaceVaryingChannel {
  int32_t value_count = 0;
  std::vector<int32_t> indices;
};

// The connected base mesh. Safe to read from many threads.
class LimitTopology {
 public:
  // Throws Error(Scene) with the mesh's path when OpenSubdiv cannot use the topology.
  LimitTopology(const Mesh& mesh, std::span<const FaceVaryingChannel> channels);

  OpenSubdiv::Far::TopologyLevel base() const { return refiner_->GetLevel(0); }
  // False for holes, and for faces at a boundary that interpolateBoundary "none" leaves out.
  bool hasLimit(int32_t face) const { return has_limit_[face] != 0; }
  DomainShape shape() const { return shape_; }
  // A face of the scheme's own kind is one primitive; others are one quad per corner, which meet in the
  // face's middle.
  bool isSplit(int32_t face) const { return shape_ == DomainShape::Quad && base().GetFaceVertices(face).size() != 4; }

 private:
  friend class LimitSurface;
  using Cache = OpenSubdiv::Bfr::SurfaceFactoryCacheThreaded<std::shared_mutex, std::shared_lock<std::shared_mutex>,
                                                             std::unique_lock<std::shared_mutex>>;
  using Factory = OpenSubdiv::Bfr::RefinerSurfaceFactory<Cache>;

  DomainShape shape_;
  std::unique_ptr<OpenSubdiv::Far::TopologyRefiner> refiner_;
  std::unique_ptr<Factory> factory_;
  std::vector<uint8_t> has_limit_;
};

// The surface over one face of values that are given per point or per face-varying index. Evaluated in
// double, so that lengths can be measured far from the prototype's origin. One per thread, bound to face
// after face.
class LimitSurface {
 public:
  using Index = int32_t;

  // kind: Vertex, Varying or FaceVarying. values: width floats per element; they must outlive the surface.
  LimitSurface(const LimitTopology& topology, Interpolation kind, int32_t channel, const float* values, int width);

  void bind(int32_t face);

  // Coordinates of a primitive of the face: of its quad at `corner` if the face is split.
  // out: width values; so are the derivatives by u and v, up to a positive factor.
  void evaluate(int32_t corner, ParamCoord at, double* out) const;
  void evaluate(int32_t corner, ParamCoord at, double* out, double* du, double* dv) const;
  // A point on edge `edge` of the face (from its vertex `edge` to the next), t in [0, 1].
  void evaluateEdge(int32_t edge, double t, double* out) const;

  // Of a surface of positions (core/dice/poses.h): width / 3 of them, as they are output.
  size_t poses() const { return size_t(width_) / 3; }
  void positions(int32_t corner, ParamCoord at, Vec3f* out) const;
  void edgePositions(int32_t edge, double t, Vec3f* out) const;

 private:
  ParamCoord toFace(int32_t corner, ParamCoord at) const;

  const LimitTopology& topology_;
  Interpolation kind_;
  int32_t channel_;
  const float* values_;
  int width_;
  OpenSubdiv::Bfr::Surface<double> surface_;
  std::vector<double> patch_points_;
};

}  // namespace encore
