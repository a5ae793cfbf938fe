#include "core/dice/shared_edges.h"

#include <algorithm>
#include <limits>
#include <string>

#include "core/scene/error.h"

namespace encore {

SharedEdges::SharedEdges(const LimitTopology& topology, size_t poses) : topology_(topology), poses_(poses) {
  const auto base = topology.base();
  base_edges_ = uint32_t(base.GetNumEdges());
  edge_owner_.assign(base_edges_, -1);
  has_middle_.assign(base_edges_, 0);
  corner_owner_.assign(size_t(base.GetNumVertices()), -1);
  corners_.resize(corner_owner_.size() * poses);
  middles_.resize(size_t(base.GetNumFaces()) * poses);
  inner_first_.assign(size_t(base.GetNumFaces()), 0);
  for (int32_t face = 0; face < base.GetNumFaces(); ++face) {
    if (!topology.hasLimit(face)) continue;
    const bool split = topology.isSplit(face);
    inner_first_[face] = base_edges_ + uint32_t(inner_base_.size());
    for (const int32_t edge : base.GetFaceEdges(face)) {
      if (edge_owner_[edge] < 0) edge_owner_[edge] = face;
      if (!split) continue;
      has_middle_[edge] = 1;
      inner_base_.push_back(uint32_t(edge));
      inner_face_.push_back(uint32_t(face));
    }
    for (const int32_t point : base.GetFaceVertices(face))
      if (corner_owner_[point] < 0) corner_owner_[point] = face;
  }
  has_middle_.resize(base_edges_ + inner_base_.size(), 0);
  rate_.assign(has_middle_.size(), 1);
  parameters_.resize(has_middle_.size());
  points_.resize(has_middle_.size());
}

void SharedEdges::placeCorners(int32_t face, const LimitSurface& surface) {
  const auto points = topology_.base().GetFaceVertices(face);
  for (int32_t k = 0; k < points.size(); ++k) {
    if (corner_owner_[points[k]] != face) continue;
    surface.edgePositions(k, 0, &corners_[size_t(points[k]) * poses_]);
  }
  if (topology_.isSplit(face)) surface.positions(0, {1, 1}, &middles_[size_t(face) * poses_]);
}

bool SharedEdges::ownsDicedEdge(int32_t face) const {
  const auto edges = topology_.base().GetFaceEdges(face);
  for (int32_t k = 0; k < edges.size(); ++k) {
    if (edge_owner_[edges[k]] == face && rate_[edges[k]] > 1) return true;
    if (topology_.isSplit(face) && rate_[inner_first_[face] + uint32_t(k)] > 1) return true;
  }
  return false;
}

// Whether edge k of the face runs from its first vertex to its second, which is the edge's own direction.
bool SharedEdges::isForward(int32_t face, int32_t k) const {
  const auto base = topology_.base();
  return base.GetFaceVertices(face)[k] == base.GetEdgeVertices(base.GetFaceEdges(face)[k])[0];
}

Vec3f SharedEdges::edgePoint(uint32_t edge, uint32_t i, size_t pose) const {
  if (i > 0 && i < rate_[edge]) return points_[edge][(i - 1) * poses_ + pose];
  if (edge < base_edges_)
    return corners_[size_t(topology_.base().GetEdgeVertices(int(edge))[i == 0 ? 0 : 1]) * poses_ + pose];
  const uint32_t inner = edge - base_edges_, from = inner_base_[inner];
  return i == 0 ? edgePoint(from, middleIndex(from), pose) : middles_[inner_face_[inner] * poses_ + pose];
}

void SharedEdges::numberPlaces() {
  uint64_t next = corner_owner_.size() + uint64_t(topology_.base().GetNumFaces());
  first_place_.clear();
  for (const uint32_t rate : rate_) {
    if (next > std::numeric_limits<uint32_t>::max()) break;
    first_place_.push_back(uint32_t(next));
    next += rate - 1;
  }
  if (next > std::numeric_limits<uint32_t>::max())
    throw Error(ErrorKind::Memory, "the edges of a displaced mesh have more vertices than 32-bit indices reach");
  place_count_ = uint32_t(next);
}

uint32_t SharedEdges::edgePlace(uint32_t edge, uint32_t i) const {
  if (i > 0 && i < rate_[edge]) return first_place_[edge] + i - 1;
  if (edge < base_edges_) return uint32_t(topology_.base().GetEdgeVertices(int(edge))[i == 0 ? 0 : 1]);
  const uint32_t inner = edge - base_edges_, from = inner_base_[inner];
  return i == 0 ? edgePlace(from, middleIndex(from)) : uint32_t(corner_owner_.size()) + inner_face_[inner];
}

PrimitiveSide SharedEdges::side(int32_t face, int32_t corner, int side) const {
  const auto edges = topology_.base().GetFaceEdges(face);
  const int32_t n = edges.size();
  if (!topology_.isSplit(face)) {
    const uint32_t edge = uint32_t(edges[side]), rate = rate_[edge];
    return isForward(face, side) ? PrimitiveSide{edge, 0, 1, rate} : PrimitiveSide{edge, rate, -1, rate};
  }
  // The quad at a corner: half of the edge that leaves it, in to the face's middle, out to the middle of
  // the edge that arrives, and along its second half back.
  const int32_t before = (corner + n - 1) % n;
  const uint32_t inner = inner_first_[face];
  if (side == 1) return {inner + uint32_t(corner), 0, 1, rate_[inner + corner]};
  if (side == 2) return {inner + uint32_t(before), rate_[inner + before], -1, rate_[inner + before]};
  const int32_t k = side == 0 ? corner : before;
  const uint32_t edge = uint32_t(edges[k]), middle = middleIndex(edge), rate = rate_[edge];
  const bool forward = isForward(face, k), towards_end = forward == (side == 3);
  return {edge, side == 3 ? middle : forward ? 0 : rate, forward ? 1 : -1, towards_end ? rate - middle : middle};
}

uint32_t SharedEdges::middleIndex(uint32_t edge) const {
  const Parameters& parameters = parameters_[edge];
  if (parameters.empty()) return rate_[edge] / 2;
  return uint32_t(std::lower_bound(parameters.begin(), parameters.end(), 0.5) - parameters.begin());
}

void SharedEdges::parameters(const PrimitiveSide& side, Parameters& out) const {
  const Parameters& edge = parameters_[side.edge];
  out.resize(side.count + 1);
  const auto at = [&](uint32_t i) { return edge[size_t(int64_t(side.first) + int64_t(side.step) * i)]; };
  for (uint32_t i = 0; i <= side.count; ++i)
    out[i] = edge.empty() ? double(i) / side.count : (at(i) - at(0)) / (at(side.count) - at(0));
}

}  // namespace encore
