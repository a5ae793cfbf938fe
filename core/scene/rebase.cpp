#include "core/scene/scene.h"

namespace encore {

void rebase(Scene& scene, Vec3d origin) {
  const auto move = [&](Affine3d& to_world, std::vector<Affine3d>& motion) {
    to_world.origin += -origin;
    for (Affine3d& key : motion) key.origin += -origin;
  };
  for (Instance& instance : scene.instances) move(instance.to_world, instance.motion);
  for (Light& light : scene.lights) light.centre += -origin;
  move(scene.camera.to_world, scene.camera.motion);
  scene.origin += origin;
}

}  // namespace encore
