// What the primitives of a subdivision mesh share: vertices and edges, each evaluated once, on the face of
// the lowest index that holds it, so that neighbours copy the same bits (§3.4: no cracks). Positions are those of all
// poses (core/dice/poses.h).
#pragma once

#include <cstdint>
#include <vector>

#include "core/dice/limit_surface.h"
#include "core/scene/math.h"

namespace encore {

// One side of a primitive, as a run of points along a shared edge.
struct PrimitiveSide {
  uint32_t edge = 0;
  uint32_t first = 0;  // point of the edge where the side begins
  int32_t step = 1;    // +1: runs along the edge; -1: against it
  uint32_t count = 1;  // segments
};

class SharedEdges {
 public:
  SharedEdges(const LimitTopology& topology, size_t poses);

  // Calls visit(edge, curve) for every edge that the face owns; curve(t, out) gives the limit positions at t in
  // [0, 1] along the edge's own direction. surface: of positions, bound to the face.
  template <class Visit>
  void visitOwnedEdges(int32_t face, const LimitSurface& surface, const Visit& visit) const;
  bool ownsDicedEdge(int32_t face) const;
  bool isOwned(uint32_t edge, int32_t face) const {
    return edge < base_edges_ ? edge_owner_[edge] == face : inner_face_[edge - base_edges_] == uint32_t(face);
  }
  uint32_t edgeCount() const { return uint32_t(rate_.size()); }
  // Evaluates the vertices that the face owns.
  void placeCorners(int32_t face, const LimitSurface& surface);

  // Whether the middle of the edge is a vertex, because a split face has it.
  bool hasMiddle(uint32_t edge) const { return has_middle_[edge] != 0; }
  uint32_t rate(uint32_t edge) const { return rate_[edge]; }
  void setRate(uint32_t edge, uint32_t rate) { rate_[edge] = rate; }
  // Empty: uniform.
  const Parameters& edgeParameters(uint32_t edge) const { return parameters_[edge]; }
  // parameters: as many as the edge's rate says and one more, or empty: uniform. points: positions at the
  // inner ones. Edges with a middle have it among them.
  void setPoints(uint32_t edge, Parameters parameters, std::vector<Vec3f> points) {
    parameters_[edge] = std::move(parameters);
    points_[edge] = std::move(points);
  }

  PrimitiveSide side(int32_t face, int32_t corner, int side) const;
  // The side's own parameters, from 0 to 1. Replaces the contents of out.
  void parameters(const PrimitiveSide& side, Parameters& out) const;
  Vec3f point(const PrimitiveSide& side, uint32_t i, size_t pose) const {
    return edgePoint(side.edge, indexOf(side, i), pose);
  }

  // Places where primitives meet, numbered from 0: base points, middles of faces, and the points of edges between
  // their ends. Valid until rates change. Throws Error(Memory) where 32 bits do not suffice.
  void numberPlaces();
  uint32_t placeCount() const { return place_count_; }
  uint32_t place(const PrimitiveSide& side, uint32_t i) const { return edgePlace(side.edge, indexOf(side, i)); }

 private:
  static uint32_t indexOf(const PrimitiveSide& side, uint32_t i) {
    return uint32_t(int64_t(side.first) + int64_t(side.step) * i);
  }
  bool isForward(int32_t face, int32_t k) const;
  uint32_t middleIndex(uint32_t edge) const;
  Vec3f edgePoint(uint32_t edge, uint32_t i, size_t pose) const;
  uint32_t edgePlace(uint32_t edge, uint32_t i) const;

  const LimitTopology& topology_;
  size_t poses_;
  uint32_t base_edges_ = 0;
  // Edges: those of the base mesh, then for every split face one from the middle of each of its edges to
  // its own middle.
  std::vector<uint32_t> rate_;
  std::vector<uint8_t> has_middle_;
  std::vector<Parameters> parameters_;
  std::vector<std::vector<Vec3f>> points_;
  std::vector<int32_t> edge_owner_;    // base edges: face, or -1
  std::vector<uint32_t> inner_first_;  // per face: its first inner edge
  std::vector<uint32_t> inner_base_;   // per inner edge: the base edge it starts on
  std::vector<uint32_t> inner_face_;   // per inner edge: its face
  std::vector<int32_t> corner_owner_;  // base points: face, or -1
  std::vector<Vec3f> corners_;         // limit positions of base points
  std::vector<Vec3f> middles_;         // limit positions of the middles of faces; used for split ones
  std::vector<uint32_t> first_place_;  // per edge: of its points between the ends
  uint32_t place_count_ = 0;
};

template <class Visit>
void SharedEdges::visitOwnedEdges(int32_t face, const LimitSurface& surface, const Visit& visit) const {
  const auto edges = topology_.base().GetFaceEdges(face);
  for (int32_t k = 0; k < edges.size(); ++k) {
    if (edge_owner_[edges[k]] != face) continue;
    const bool forward = isForward(face, k);
    visit(uint32_t(edges[k]), [&](double t, Vec3f* p) { surface.edgePositions(k, forward ? t : 1 - t, p); });
  }
  if (!topology_.isSplit(face)) return;
  for (int32_t k = 0; k < edges.size(); ++k)
    visit(inner_first_[face] + uint32_t(k), [&](double t, Vec3f* p) { surface.positions(k, {1, t}, p); });
}

}  // namespace encore
