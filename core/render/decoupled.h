// Decoupled sampling for comparison (§4, Fig. 5 d and e): shading is shared by the samples of a primitive whose
// hash is the same.
#pragma once

#include <cstdint>

#include "core/scene/camera.h"
#include "core/scene/settings.h"

namespace encore {

// Cell of a film position, with `rate` cells to a pixel. x and y wrap at 2^16 cells: cells are only compared
// within one primitive and one block.
uint32_t decoupledCell(Vec2f film, float rate);

// Where a point of the scene appears on the film, whatever lies before it: what the standard mapping of
// decoupled sampling hashes (Ragan-Kelley et al. 2011), defocus disregarded. Points behind the camera appear
// as if they were before it.
class Projection {
 public:
  Projection(const Camera& camera, const Settings& settings);
  Vec2f film(Vec3f world) const;

 private:
  Affine3f to_camera_;
  bool orthographic_;
  Vec2f centre_tangent_, pixels_per_tangent_, middle_;
};

}  // namespace encore
