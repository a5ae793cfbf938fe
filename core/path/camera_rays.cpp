#include <limits>

#include "core/path/path.h"
#include "core/trace/clones.h"

namespace encore {

CameraRays::CameraRays(const Camera& camera, const Settings& settings)
    : origin_(toFloat(camera.to_world.origin)),
      half_width_(0.5f * float(settings.width)),
      half_height_(0.5f * float(settings.height)),
      near_(camera.near_clip),
      far_(camera.far_clip) {
  const Affine3d& m = camera.to_world;
  const Vec2f centre = camera.centre_tangent, half = camera.half_tangent;
  centre_ = toFloat(m.vector({centre.x, centre.y, -1}));
  step_x_ = toFloat(m.ex * (double(half.x) * 2 / settings.width));
  step_y_ = toFloat(m.ey * (double(-half.y) * 2 / settings.height));
  // Planes of equal local z, whatever shear the transform holds; for rigid ones simply -Z.
  forward_ = toFloat(-normalize(inverse(m).transposedVector(Vec3d{0, 0, 1})));
}

Vec3f CameraRays::filmDirection(float film_x, float film_y) const {
  return centre_ + (step_x_ * (film_x - half_width_) + step_y_ * (film_y - half_height_));
}

Ray CameraRays::ray(float film_x, float film_y) const {
  const Vec3f direction = normalize(filmDirection(film_x, film_y));
  const float cosine = dot(direction, forward_);  // > 0: local z is -1 everywhere on the film
  return {origin_, std::max(0.0f, near_ / cosine), direction, far_ / cosine};
}

// The expressions of ray() and filmDirection(), in the same order.
ENCORE_AVX2_CLONES
void CameraRays::rays(const float* film_x, const float* film_y, RayPacket& rays) const {
  RayPacket r;
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    const float x = film_x[i] - half_width_, y = film_y[i] - half_height_;
    const float dx = centre_.x + (step_x_.x * x + step_y_.x * y), dy = centre_.y + (step_x_.y * x + step_y_.y * y),
                dz = centre_.z + (step_x_.z * x + step_y_.z * y);
    const float size = std::sqrt(dx * dx + dy * dy + dz * dz), divisor = size > 0 ? size : 1;
    const float ux = dx / divisor, uy = dy / divisor, uz = dz / divisor;
    const float cosine = ux * forward_.x + uy * forward_.y + uz * forward_.z;
    const float tnear = near_ / cosine;
    r.dx[i] = ux, r.dy[i] = uy, r.dz[i] = uz;
    r.tnear[i] = 0 < tnear ? tnear : 0, r.tfar[i] = far_ / cosine;
  }
  rays = r;
}

ENCORE_AVX2_CLONES
void CameraRays::depths(const RayPacket& rays, const HitPacket& hits, PacketLanes<float>& depth) const {
  PacketLanes<float> d;
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    const float t = hits.t[i];
    const float x = origin_.x + rays.dx[i] * t - origin_.x, y = origin_.y + rays.dy[i] * t - origin_.y,
                z = origin_.z + rays.dz[i] * t - origin_.z;
    const float along = x * forward_.x + y * forward_.y + z * forward_.z;
    d[i] = hits.instance[i] != kNoInstance ? along : std::numeric_limits<float>::infinity();
  }
  for (uint32_t i = 0; i < kPacketWidth; ++i) depth[i] = d[i];
}

// Igehy 1999, eq. 8.
void CameraRays::differential(float film_x, float film_y, Vec3f& dddx, Vec3f& dddy) const {
  const Vec3f d = filmDirection(film_x, film_y);
  const float squared = dot(d, d), scale = 1 / (squared * std::sqrt(squared));
  dddx = (step_x_ * squared - d * dot(d, step_x_)) * scale;
  dddy = (step_y_ * squared - d * dot(d, step_y_)) * scale;
}

float CameraRays::depth(Vec3f point) const { return dot(point - origin_, forward_); }

}  // namespace encore
