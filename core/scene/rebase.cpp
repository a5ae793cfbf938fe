#include "core/scene/scene.h"

namespace encore {

void rebase(Scene& scene, Vec3d origin) {
  for (Instance& instance : scene.instances) instance.to_world.origin += -origin;
  for (Light& light : scene.lights) light.centre += -origin;
  scene.camera.to_world.origin += -origin;
}

}  // namespace encore
