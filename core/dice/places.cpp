#include "core/dice/places.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace encore {
namespace {

// Normals that differ by less than about a degree are the same but for rounding: the surface is smooth there.
constexpr double kSmoothCosine = 0.9998;

size_t primitiveCount(const Grids& grids) { return grids.first_vertex.size() - 1; }

// How much of the correction counts: all of what curvature asks of fine grids, nothing where facets are too coarse for
// their surface to say anything about the displaced one.
double trustIn(double correction) { return std::clamp(1.5 - correction / 0.04, 0.0, 1.0); }

// The normal of the facets after, corrected by what that of the facets before lacked.
Vec3f changed(Vec3d normal, Vec3d before, Vec3d after, bool authored) {
  const Vec3d facets = normalize(after);
  if (length(facets) == 0 || length(before) == 0) return toFloat(length(facets) > 0 ? facets : normal);
  const Vec3d correction = normal - normalize(before);
  const Vec3d sum = facets + correction * (authored ? 1 : trustIn(length(correction)));
  // Turned so far that the sum says nothing: the facets' own.
  return toFloat(dot(sum, facets) > 1e-3 ? normalize(sum) : facets);
}

// Members of a place that were smooth into each other.
struct Group {
  Vec3d first, normal{0, 0, 0}, before{0, 0, 0}, after{0, 0, 0};
};

class NormalMover {
 public:
  NormalMover(std::span<const uint8_t> moved, const std::vector<Vec3f>& before, const std::vector<Vec3f>& after,
              bool authored, std::vector<Vec3f>& normals)
      : moved_(moved), before_(before), after_(after), authored_(authored), normals_(normals) {}

  void moveOne(size_t vertex) const {
    normals_[vertex] =
        changed(toDouble(normals_[vertex]), toDouble(before_[vertex]), toDouble(after_[vertex]), authored_);
  }

  void movePlace(std::span<const Places::Member> members) {
    groups_.clear();
    group_of_.clear();
    for (const auto [vertex, primitive] : members) {
      if (!moved_[primitive]) continue;
      const Vec3d normal = toDouble(normals_[vertex]), before = toDouble(before_[vertex]);
      size_t group = 0;
      while (group < groups_.size() && dot(groups_[group].first, normal) < kSmoothCosine) ++group;
      if (group == groups_.size()) groups_.push_back({normal});
      group_of_.push_back(group);
      groups_[group].normal += normal * length(before);
      groups_[group].before += before;
      groups_[group].after += toDouble(after_[vertex]);
    }
    size_t next = 0;
    for (const auto [vertex, primitive] : members) {
      if (!moved_[primitive]) continue;
      const Group& group = groups_[group_of_[next++]];
      const Vec3d normal = length(group.normal) > 0 ? normalize(group.normal) : group.first;
      normals_[vertex] = changed(normal, group.before, group.after, authored_);
    }
  }

 private:
  std::span<const uint8_t> moved_;
  const std::vector<Vec3f>&before_, &after_;
  bool authored_;
  std::vector<Vec3f>& normals_;
  std::vector<Group> groups_;
  std::vector<size_t> group_of_;
};

}  // namespace

Places::Places(const Grids& grids) : first_(size_t(grids.places) + 1, 0), members_(grids.ring.size()) {
  for (const uint32_t place : grids.ring) ++first_[place + 1];
  for (size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  std::vector<size_t> next(first_.begin(), first_.end() - 1);
  for (size_t primitive = 0; primitive < primitiveCount(grids); ++primitive)
    for (size_t k = 0; k < grids.ringSize(primitive); ++k)
      members_[next[grids.ring[grids.first_ring[primitive] + k]]++] = {uint32_t(grids.first_vertex[primitive] + k),
                                                                       uint32_t(primitive)};
}

std::vector<Vec3f> angleWeightedNormals(const DicedMesh& mesh, const Grids& grids,
                                        const std::vector<Vec3f>& positions) {
  std::vector<Vec3f> sums(positions.size());
  tbb::parallel_for(size_t{0}, primitiveCount(grids), [&](size_t primitive) {
    for (size_t i = grids.first_triangle[primitive]; i < grids.first_triangle[primitive + 1]; ++i) {
      const uint32_t* v = &mesh.triangles[3 * i];
      const Vec3d p[3] = {toDouble(positions[v[0]]), toDouble(positions[v[1]]), toDouble(positions[v[2]])};
      const Vec3d area = cross(p[1] - p[0], p[2] - p[0]);
      const double twice = length(area);
      if (!(twice > 0)) continue;
      for (int k = 0; k < 3; ++k) {
        const double angle = std::atan2(twice, dot(p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]));
        sums[v[k]] += toFloat(area * (angle / twice));
      }
    }
  });
  return sums;
}

void displaceNormals(const Places& places, const Grids& grids, std::span<const uint8_t> moved,
                     const std::vector<Vec3f>& before, const std::vector<Vec3f>& after, bool authored,
                     std::vector<Vec3f>& normals) {
  tbb::parallel_for(size_t{0}, primitiveCount(grids), [&](size_t primitive) {
    if (!moved[primitive]) return;
    const NormalMover mover(moved, before, after, authored, normals);
    const size_t inside = grids.first_vertex[primitive] + grids.ringSize(primitive);
    for (size_t v = inside; v < grids.first_vertex[primitive + 1]; ++v) mover.moveOne(v);
  });
  tbb::parallel_for(tbb::blocked_range<size_t>(0, places.count(), 256), [&](const tbb::blocked_range<size_t>& range) {
    NormalMover mover(moved, before, after, authored, normals);
    for (size_t place = range.begin(); place != range.end(); ++place) mover.movePlace(places.members(place));
  });
}

}  // namespace encore
