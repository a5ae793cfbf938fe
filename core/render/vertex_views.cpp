#include "core/render/vertex_views.h"

#include <algorithm>
#include <cmath>

namespace encore {
namespace {

// The camera's own view is used up to this cosine with its axis: film coordinates stay well within what single
// precision resolves to a small part of a pixel.
constexpr double kLeastCosine = 0.2;

// Local axes of the other views, as columns: right, left, up, down, back. Each looks along its -Z.
Affine3d turned(int view) {
  switch (view) {
    case 0:
      return {{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}, {}};
    case 1:
      return {{0, 0, -1}, {0, 1, 0}, {1, 0, 0}, {}};
    case 2:
      return {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}, {}};
    case 3:
      return {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}, {}};
    default:
      return {{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}, {}};
  }
}

}  // namespace

VertexViews::VertexViews(const Camera& given, const Settings& settings)
    : origin_(toFloat(given.to_world.origin)),
      half_tangent_(given.half_tangent),
      width_(float(settings.width)),
      height_(float(settings.height)) {
  Camera camera = given;
  camera.lens_radius = 0;  // vertices are seen from the middle of the lens
  views_.push_back({CameraRays(camera, settings), inverse(camera.to_world), camera.centre_tangent});
  for (int view = 0; view < 5; ++view) {
    Camera other = camera;
    other.to_world = camera.to_world * turned(view);
    other.centre_tangent = {0, 0};
    views_.push_back({CameraRays(other, settings), inverse(other.to_world), {0, 0}});
  }
}

// z: cosine with the view's axis, in local space; x and y only mean something where it is above 0.
Vec3d VertexViews::filmPosition(const View& view, Vec3f direction) const {
  const Vec3d local = normalize(view.to_local.vector(toDouble(direction)));
  const double depth = -local.z;
  return {0.5 * double(width_) * (1 + (local.x / depth - double(view.centre_tangent.x)) / double(half_tangent_.x)),
          0.5 * double(height_) * (1 - (local.y / depth - double(view.centre_tangent.y)) / double(half_tangent_.y)),
          depth};
}

ViewPosition VertexViews::position(Vec3f direction) const {
  uint32_t best = 0;
  Vec3d film = filmPosition(views_[0], direction);
  if (film.z < kLeastCosine) {
    for (uint32_t view = 1; view < views_.size(); ++view) {
      const Vec3d other = filmPosition(views_[view], direction);
      if (other.z > film.z) film = other, best = view;
    }
  }
  return {best, float(film.x), float(film.y)};
}

float VertexViews::pixelsPerRadian(Vec3f direction) const {
  const Vec3d film = filmPosition(views_[0], direction);
  float x = 0.5f * width_, y = 0.5f * height_;
  if (film.z > 0) x = std::clamp(float(film.x), 0.0f, width_), y = std::clamp(float(film.y), 0.0f, height_);
  Vec3f dpdx, dpdy, dddx, dddy;
  views_[0].rays.differential({x, y, 0, 0}, dpdx, dpdy, dddx, dddy);
  return 1 / std::sqrt(length(cross(dddx, dddy)));
}

}  // namespace encore
