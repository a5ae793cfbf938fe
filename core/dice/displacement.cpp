#include "core/dice/displacement.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/dice/displacement_points.h"
#include "core/dice/places.h"
#include "core/dice/poses.h"

namespace encore {
namespace {

// Points are evaluated this many at a time, or a primitive's where those are more, to bound what a batch holds.
constexpr size_t kBatchPoints = size_t{1} << 20;

class Displacer {
 public:
  Displacer(const Mesh& mesh, std::span<const int32_t> face_materials, const Grids& grids, DisplacementSource& source,
            DicedMesh& diced)
      : mesh_(mesh), grids_(grids), source_(source), diced_(diced), places_(grids), values_(diced.positions.size()) {
    for (const uint32_t face : diced.primitive_face) {
      const int32_t material = face_materials[face];
      material_.push_back(material);
      moved_.push_back(material >= 0);
      reads_pose_ |= material >= 0 && source.varies(material) && readsPose(source.layout(material));
    }
  }

  uint64_t displace() {
    for (size_t pose = 0; pose < poseCount(diced_); ++pose) displacePose(pose);
    return lost_;
  }

 private:
  size_t primitives() const { return material_.size(); }
  size_t first(size_t primitive) const { return grids_.first_vertex[primitive]; }
  size_t end(size_t primitive) const { return grids_.first_vertex[primitive + 1]; }

  void displacePose(size_t pose) {
    std::vector<Vec3f>& positions = posedPositions(diced_, pose);
    std::vector<Vec3f>& normals = posedNormals(diced_, pose);
    const std::vector<Vec3f> before = angleWeightedNormals(diced_, grids_, positions);
    const std::vector<Vec3f> directions = sharedNormals(normals, before);
    if (pose == 0 || reads_pose_) evaluate(pose, directions);
    move(directions, positions);
    displaceNormals(places_, grids_, moved_, before, angleWeightedNormals(diced_, grids_, positions),
                    grids_.authored_normals, normals);
  }

  // What displacement goes along: the mean at places that are shared, each primitive's by its angle.
  std::vector<Vec3f> sharedNormals(const std::vector<Vec3f>& normals, const std::vector<Vec3f>& weighted) const {
    std::vector<Vec3f> shared = normals;
    forEachPlace([&](std::span<const Places::Member> members) {
      Vec3d sum{0, 0, 0};
      for (const auto [vertex, primitive] : members)
        sum += toDouble(normals[vertex]) * length(toDouble(weighted[vertex]));
      const Vec3f mean = toFloat(normalize(sum));
      for (const auto [vertex, primitive] : members) shared[vertex] = mean;
    });
    return shared;
  }

  void evaluate(size_t pose, std::span<const Vec3f> directions) {
    std::vector<size_t> batch;
    size_t points = 0;
    const auto flush = [&] {
      if (!batch.empty()) evaluateBatch(batch, points, pose, directions);
      batch.clear();
      points = 0;
    };
    for (size_t primitive = 0; primitive < primitives(); ++primitive) {
      if (!moved_[primitive]) continue;
      if (!source_.varies(material_[primitive])) {
        const DisplacementInputs constant = source_.constant(material_[primitive]);
        for (size_t v = first(primitive); v < end(primitive); ++v) values_[v] = constant;
        continue;
      }
      batch.push_back(primitive);
      points += end(primitive) - first(primitive);
      if (points >= kBatchPoints) flush();
    }
    flush();
    tbb::parallel_for(tbb::blocked_range<size_t>(0, primitives()), [&](const tbb::blocked_range<size_t>& range) {
      for (size_t i = range.begin(); i != range.end(); ++i)
        for (size_t v = first(i); v < end(i) && moved_[i]; ++v) {
          if (isFinite(values_[v].offset) && std::isfinite(values_[v].along_normal)) continue;
          values_[v] = {};
          ++lost_;
        }
    });
  }

  void evaluateBatch(std::span<const size_t> batch, size_t points, size_t pose, std::span<const Vec3f> directions) {
    PatternPoints batched;
    batched.point.reserve(points);
    uint64_t floats = 0;
    for (const size_t primitive : batch)
      for (size_t v = first(primitive); v < end(primitive); ++v) {
        batched.point.push_back({uint32_t(material_[primitive]), uint32_t(floats)});
        floats += source_.layout(material_[primitive]).size;
      }
    if (floats > std::numeric_limits<uint32_t>::max())
      throw Error(ErrorKind::Memory, "one face makes " + std::to_string(points) + " vertices to displace", mesh_.path,
                  "Author a longer primvars:encore:targetEdgeLength on the mesh");
    batched.data.resize(floats);
    std::vector<size_t> first_point(batch.size() + 1, 0);
    for (size_t i = 0; i < batch.size(); ++i) first_point[i + 1] = first_point[i] + end(batch[i]) - first(batch[i]);
    tbb::parallel_for(size_t{0}, batch.size(), [&](size_t i) {
      const PointLayout& layout = source_.layout(material_[batch[i]]);
      fillDisplacementPoints(mesh_, diced_, grids_, pose, directions, batch[i], layout,
                             batched.data.data() + batched.point[first_point[i]].first);
    });
    std::vector<DisplacementInputs> found(points);
    source_.evaluate(batched, found);
    for (size_t i = 0; i < batch.size(); ++i)
      for (size_t k = 0; k < end(batch[i]) - first(batch[i]); ++k)
        values_[first(batch[i]) + k] = found[first_point[i] + k];
  }

  void move(std::span<const Vec3f> directions, std::vector<Vec3f>& positions) {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, primitives()), [&](const tbb::blocked_range<size_t>& range) {
      for (size_t i = range.begin(); i != range.end(); ++i)
        for (size_t v = first(i) + grids_.ringSize(i); v < end(i) && moved_[i]; ++v)
          positions[v] = moved(positions[v], directions[v], toDouble(values_[v].offset), values_[v].along_normal);
    });
    forEachPlace([&](std::span<const Places::Member> members) {
      if (members.empty()) return;
      Vec3d offset{0, 0, 0};
      double along = 0;
      for (const auto [vertex, primitive] : members) {
        if (!moved_[primitive]) return;
        offset += toDouble(values_[vertex].offset);
        along += values_[vertex].along_normal;
      }
      const double count = double(members.size());
      const uint32_t any = members[0].vertex;
      const Vec3f place = moved(positions[any], directions[any], offset / count, along / count);
      for (const auto [vertex, primitive] : members) positions[vertex] = place;
    });
  }

  Vec3f moved(Vec3f position, Vec3f direction, Vec3d offset, double along) {
    const Vec3f place = toFloat(toDouble(position) + offset + toDouble(direction) * along);
    if (isFinite(place)) return place;
    ++lost_;
    return position;
  }

  template <class Body>
  void forEachPlace(const Body& body) const {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, places_.count(), 256),
                      [&](const tbb::blocked_range<size_t>& range) {
                        for (size_t place = range.begin(); place != range.end(); ++place) body(places_.members(place));
                      });
  }

  const Mesh& mesh_;
  const Grids& grids_;
  DisplacementSource& source_;
  DicedMesh& diced_;
  Places places_;
  std::vector<DisplacementInputs> values_;  // per vertex
  std::vector<int32_t> material_;           // per primitive; -1: it is not displaced
  std::vector<uint8_t> moved_;              // per primitive
  bool reads_pose_ = false;
  std::atomic<uint64_t> lost_ = 0;
};

}  // namespace

uint64_t displace(const Mesh& mesh, std::span<const int32_t> face_materials, const Grids& grids,
                  DisplacementSource& source, DicedMesh& diced) {
  return Displacer(mesh, face_materials, grids, source, diced).displace();
}

}  // namespace encore
