#pragma once

#include <utility>
#include <vector>

#include "core/scene/scene.h"

namespace encore {

// Moves the scene to the camera's origin, and back. Copies what moves, which is small beside meshes.
class Rebased {
 public:
  explicit Rebased(Scene& scene)
      : scene_(scene),
        instances_(scene.instances),
        lights_(scene.lights),
        camera_(scene.camera),
        origin_(scene.origin) {
    rebase(scene, scene.camera.to_world.origin);
  }
  ~Rebased() {
    scene_.instances = std::move(instances_);
    scene_.lights = std::move(lights_);
    scene_.camera = std::move(camera_);
    scene_.origin = origin_;
  }
  Rebased(const Rebased&) = delete;
  Rebased& operator=(const Rebased&) = delete;

 private:
  Scene& scene_;
  std::vector<Instance> instances_;
  std::vector<Light> lights_;
  Camera camera_;
  Vec3d origin_;
};

}  // namespace encore
