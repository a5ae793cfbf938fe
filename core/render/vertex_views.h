// Camera rays in every direction: vertices of visible faces can lie beside or behind the camera.
#pragma once

#include <array>
#include <vector>

#include "core/path/path.h"

namespace encore {

// A direction as a film position of one of the views.
struct ViewPosition {
  uint32_t view = 0;
  float film_x = 0, film_y = 0;  // pixels of that view, y down
};

// The camera itself (view 0) and five more of the same resolution around the same point, so that any direction is a
// film position of one of them.
class VertexViews {
 public:
  VertexViews(const Camera& camera, const Settings& settings);

  Vec3f origin() const { return origin_; }
  uint32_t count() const { return uint32_t(views_.size()); }
  const CameraRays& rays(uint32_t view) const { return views_[view].rays; }
  // direction: of any length above 0, world space. The camera's own view wherever it can show it well.
  ViewPosition position(Vec3f direction) const;
  // Pixels per radian of the camera, where it sees the direction or at the nearest edge of the film.
  // Square root of the density per solid angle: exact for areas.
  float pixelsPerRadian(Vec3f direction) const;

 private:
  struct View {
    CameraRays rays;
    Affine3d to_local;
    Vec2f centre_tangent;
  };
  Vec3d filmPosition(const View& view, Vec3f direction) const;

  Vec3f origin_;
  std::vector<View> views_;
  Vec2f half_tangent_;
  float width_, height_;  // pixels
};

}  // namespace encore
