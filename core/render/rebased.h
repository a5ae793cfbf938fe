#pragma once

#include <utility>
#include <vector>

#include "core/scene/scene.h"

namespace encore {

// Moves the scene to the camera's origin, and back. Keeps what moves: of instances, which may be millions, their
// origins only.
class Rebased {
 public:
  explicit Rebased(Scene& scene) : scene_(scene), lights_(scene.lights), camera_(scene.camera), origin_(scene.origin) {
    origins_.reserve(scene.instances.size());
    for (const Instance& instance : scene.instances) {
      origins_.push_back(instance.to_world.origin);
      for (const Affine3d& key : instance.motion) origins_.push_back(key.origin);
    }
    rebase(scene, scene.camera.to_world.origin);
  }
  ~Rebased() {
    size_t next = 0;
    for (Instance& instance : scene_.instances) {
      instance.to_world.origin = origins_[next++];
      for (Affine3d& key : instance.motion) key.origin = origins_[next++];
    }
    scene_.lights = std::move(lights_);
    scene_.camera = std::move(camera_);
    scene_.origin = origin_;
  }
  Rebased(const Rebased&) = delete;
  Rebased& operator=(const Rebased&) = delete;

 private:
  Scene& scene_;
  std::vector<Vec3d> origins_;  // of each instance and its keys of motion
  std::vector<Light> lights_;
  Camera camera_;
  Vec3d origin_;
};

}  // namespace encore
