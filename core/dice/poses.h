// Poses of a mesh that deforms: that of the frame's time first, then those at the keys of its motion. Still meshes
// have one.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "core/dice/dice.h"
#include "core/scene/error.h"
#include "core/scene/mesh.h"
#include "core/scene/scene.h"

namespace encore {

inline constexpr size_t kMostPoses = 1 + kMaxMotionKeys;

inline size_t poseCount(const Mesh& mesh) { return 1 + mesh.motion_points.size(); }
inline const std::vector<Vec3f>& posedPoints(const Mesh& mesh, size_t pose) {
  return pose == 0 ? mesh.points.get() : mesh.motion_points[pose - 1];
}

inline size_t poseCount(const DicedMesh& mesh) { return 1 + mesh.motion_positions.size(); }
inline std::vector<Vec3f>& posedPositions(DicedMesh& mesh, size_t pose) {
  return pose == 0 ? mesh.positions : mesh.motion_positions[pose - 1];
}
inline const std::vector<Vec3f>& posedPositions(const DicedMesh& mesh, size_t pose) {
  return pose == 0 ? mesh.positions : mesh.motion_positions[pose - 1];
}
// Precondition: the mesh is not faceted.
inline std::vector<Vec3f>& posedNormals(DicedMesh& mesh, size_t pose) {
  return pose == 0 ? mesh.normals : mesh.motion_normals[pose - 1];
}

// The points of all poses, those of one point side by side, so that a surface is evaluated for all poses at once.
class Poses {
 public:
  // mesh must outlive this. Throws Error(Scene) where there are too many keys.
  explicit Poses(const Mesh& mesh) : mesh_(mesh) {
    if (poseCount(mesh) > kMostPoses)
      throw Error(ErrorKind::Scene, std::to_string(mesh.motion_points.size()) + " keys of motion are too many",
                  mesh.path + ".points", "Take at most " + std::to_string(kMaxMotionKeys) + " samples of the shutter");
    if (count() == 1) return;
    values_.reserve(count() * mesh.points.size());
    for (size_t i = 0; i < mesh.points.size(); ++i)
      for (size_t pose = 0; pose < count(); ++pose) values_.push_back(posedPoints(mesh, pose)[i]);
  }

  size_t count() const { return poseCount(mesh_); }
  // 3 count() floats per point.
  const float* values() const { return count() == 1 ? &mesh_.points[0].x : &values_[0].x; }
  float largestCoordinate() const {
    float largest = 0;
    for (size_t pose = 0; pose < count(); ++pose)
      for (const Vec3f p : posedPoints(mesh_, pose)) largest = std::max(largest, maxComponent(absolute(p)));
    return largest;
  }

 private:
  const Mesh& mesh_;
  std::vector<Vec3f> values_;
};

}  // namespace encore
