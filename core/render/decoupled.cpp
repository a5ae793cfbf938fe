#include "core/render/decoupled.h"

#include <algorithm>
#include <cmath>

namespace encore {
namespace {

// Far beyond any film, and exact enough to be turned into an integer.
constexpr float kLargestFilm = 1e9f;

uint32_t cellOf(float film, float cells_per_pixel) {
  const float cell = std::floor(film * cells_per_pixel);
  return uint32_t(int64_t(std::clamp(cell, -kLargestFilm, kLargestFilm))) & 0xffffu;
}

float bounded(float film) { return std::isfinite(film) ? std::clamp(film, -kLargestFilm, kLargestFilm) : kLargestFilm; }

}  // namespace

uint32_t decoupledCell(Vec2f film, float rate) {
  const float cells_per_pixel = std::sqrt(rate);
  return cellOf(film.x, cells_per_pixel) | cellOf(film.y, cells_per_pixel) << 16;
}

Projection::Projection(const Camera& camera, const Settings& settings)
    : to_camera_(toFloat(inverse(camera.to_world))),
      orthographic_(camera.projection == Camera::Projection::Orthographic),
      centre_tangent_(camera.centre_tangent),
      pixels_per_tangent_{float(settings.width) / (2 * camera.half_tangent.x),
                          float(settings.height) / (-2 * camera.half_tangent.y)},
      middle_{0.5f * float(settings.width), 0.5f * float(settings.height)} {}

Vec2f Projection::film(Vec3f world) const {
  const Vec3f p = to_camera_.point(world);
  const float distance = orthographic_ ? 1 : std::max(std::abs(p.z), 1e-30f);
  return {bounded(middle_.x + (p.x / distance - centre_tangent_.x) * pixels_per_tangent_.x),
          bounded(middle_.y + (p.y / distance - centre_tangent_.y) * pixels_per_tangent_.y)};
}

}  // namespace encore
