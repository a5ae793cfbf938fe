#include <algorithm>
#include <limits>
#include <numeric>

#include "core/path/aperture.h"
#include "core/path/film_keys.h"
#include "core/path/path.h"
#include "core/trace/clones.h"

namespace encore {

namespace {

// Bits of x with a zero between any two.
uint32_t spreadBits(uint32_t x) {
  x = (x | x << 8) & 0x00ff00ffu;
  x = (x | x << 4) & 0x0f0f0f0fu;
  x = (x | x << 2) & 0x33333333u;
  return (x | x << 1) & 0x55555555u;
}

}  // namespace

std::vector<uint32_t> strataRanks(uint32_t n) {
  std::vector<uint32_t> order(size_t(n) * n), ranks(order.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto code = [&](uint32_t s) { return spreadBits(s % n) | spreadBits(s / n) << 1; };
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return code(a) < code(b); });
  for (uint32_t i = 0; i < order.size(); ++i) ranks[order[i]] = i;
  return ranks;
}

CameraRays::CameraRays(const Camera& camera, const Settings& settings, bool moves)
    : half_width_(0.5f * float(settings.width)),
      half_height_(0.5f * float(settings.height)),
      near_(camera.near_clip),
      far_(camera.far_clip),
      moves_(moves || !camera.motion.empty()),
      orthographic_(camera.projection == Camera::Projection::Orthographic),
      seed_(settings.seed),
      lens_radius_(camera.lens_radius),
      lens_step_(camera.lens_radius > 0 ? 1 / camera.focus_distance : 0),
      aperture_(apertureCorners(camera.aperture_blades, camera.aperture_rotation_radians)),
      local_centre_(camera.centre_tangent),
      local_step_{half_width_ > 0 ? camera.half_tangent.x / half_width_ : 0,
                  half_height_ > 0 ? -camera.half_tangent.y / half_height_ : 0},
      planes_(camera.clipping_planes) {
  still_ = poseOf(camera.to_world, camera);
  for (const Affine3d& key : camera.motion) poses_.push_back(poseOf(key, camera));
  if (moves_ || lens_radius_ > 0) ranks_ = strataRanks(settings.samples);
}

CameraRays::Pose CameraRays::poseOf(const Affine3d& m, const Camera& camera) const {
  const Vec2f centre = camera.centre_tangent, half = camera.half_tangent;
  Pose pose;
  pose.origin = toFloat(m.origin);
  pose.centre = toFloat(m.vector({centre.x, centre.y, -1}));
  if (orthographic_) {
    pose.origin = toFloat(m.point({centre.x, centre.y, 0}));
    pose.centre = toFloat(m.vector({0, 0, -1}));
  }
  pose.step_x = toFloat(m.ex * (double(half.x) / double(half_width_)));
  pose.step_y = toFloat(m.ey * (double(-half.y) / double(half_height_)));
  pose.lens_x = toFloat(m.ex), pose.lens_y = toFloat(m.ey);
  // Planes of equal local z, whatever shear the transform holds; for rigid ones simply -Z.
  pose.forward = toFloat(-normalize(inverse(m).transposedVector(Vec3d{0, 0, 1})));
  return pose;
}

// All but `forward` is linear in the matrix.
CameraRays::Pose CameraRays::poseAt(float time) const {
  if (poses_.empty()) return still_;  // time is not asked for
  const float along = time * float(poses_.size() - 1);
  const size_t key = std::min(size_t(along), poses_.size() - 2);
  const Pose &a = poses_[key], &b = poses_[key + 1];
  const float t = along - float(key);
  const auto mix = [t](Vec3f from, Vec3f to) { return from * (1 - t) + to * t; };
  Pose pose{mix(a.origin, b.origin),
            mix(a.centre, b.centre),
            mix(a.step_x, b.step_x),
            mix(a.step_y, b.step_y),
            mix(a.lens_x, b.lens_x),
            mix(a.lens_y, b.lens_y),
            {}};
  const Vec3f normal = normalize(cross(normalize(pose.lens_x), normalize(pose.lens_y)));
  pose.forward = dot(normal, pose.centre) > 0 ? normal : -normal;
  return pose;
}

uint32_t CameraRays::rank(const Sample& sample) const {
  return sample.pixel < kFirstBlockKey && sample.sample < ranks_.size() ? ranks_[sample.sample] : sample.sample;
}

float CameraRays::sampleTime(const Sample& sample) const {
  return CameraRandom(seed_, sample.pixel).time(rank(sample));
}
float CameraRays::time(const Sample& sample) const { return moves_ ? sampleTime(sample) : 0; }

Vec2f CameraRays::lensPoint(const Sample& sample) const {
  if (!(lens_radius_ > 0)) return {0, 0};
  const Vec2f u = CameraRandom(seed_, sample.pixel).lens(rank(sample));
  return (aperture_.empty() ? concentricDisk(u) : polygonPoint(aperture_, u)) * lens_radius_;
}

// All rays of a place on the film meet where that of the lens' middle is focus_distance away along -Z.
CameraRays::Aim CameraRays::aim(const Pose& pose, float film_x, float film_y, Vec2f lens) const {
  const Vec3f film = pose.step_x * (film_x - half_width_) + pose.step_y * (film_y - half_height_);
  if (!(lens_radius_ > 0)) {
    if (orthographic_) return {pose.origin + film, pose.centre};
    return {pose.origin, pose.centre + film};
  }
  const Vec3f aside = pose.lens_x * lens.x + pose.lens_y * lens.y;
  if (orthographic_) return {pose.origin + film + aside, pose.centre - aside * lens_step_};
  return {pose.origin + aside, pose.centre + film - aside * lens_step_};
}

Ray CameraRays::finish(const Pose& pose, const Aim& aimed, float film_x, float film_y, Vec2f lens, float time) const {
  const Vec3f direction = normalize(aimed.direction);
  const float cosine = dot(direction, pose.forward);  // > 0: local z is -1 everywhere on the film
  Ray ray{aimed.origin, std::max(0.0f, near_ / cosine), direction, far_ / cosine, time};
  if (!planes_.empty()) clip(film_x, film_y, lens, length(aimed.direction), ray);
  return ray;
}

// size: world units per unit along the local direction.
void CameraRays::clip(float film_x, float film_y, Vec2f lens, float size, Ray& ray) const {
  Vec3f film{local_centre_.x + local_step_.x * (film_x - half_width_),
             local_centre_.y + local_step_.y * (film_y - half_height_), 0};
  Vec3f origin{lens.x, lens.y, 0}, direction{-lens.x * lens_step_, -lens.y * lens_step_, -1};
  (orthographic_ ? origin : direction) += film;
  for (const ClippingPlane& plane : planes_) {
    const float height = dot(plane.normal, origin) + plane.offset, climb = dot(plane.normal, direction);
    if (climb > 0)
      ray.tnear = std::max(ray.tnear, -height / climb * size);
    else if (climb < 0)
      ray.tfar = std::min(ray.tfar, -height / climb * size);
    else if (height < 0)
      ray.tfar = -1;
  }
  if (!(ray.tnear <= ray.tfar)) ray.tnear = 0, ray.tfar = -1;  // nothing is left
}

Ray CameraRays::ray(const Sample& sample) const {
  const float when = time(sample);
  const Vec2f lens = lensPoint(sample);
  const auto seen = [&](const Pose& pose) {
    return finish(pose, aim(pose, sample.film_x, sample.film_y, lens), sample.film_x, sample.film_y, lens, when);
  };
  return poses_.empty() ? seen(still_) : seen(poseAt(when));
}

void CameraRays::rays(const float* film_x, const float* film_y, const uint32_t* pixel, const uint32_t* sample,
                      RayPacket& rays) const {
  if (!ownOrigins() && planes_.empty()) {
    pinholeRays(film_x, film_y, rays);
    if (moves_)
      for (uint32_t i = 0; i < kPacketWidth; ++i)
        rays.time[i] = sampleTime({film_x[i], film_y[i], pixel[i], sample[i]});
    return;
  }
  const bool numbers = moves_ || lens_radius_ > 0;
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    const Ray r = ray(Sample{film_x[i], film_y[i], numbers ? pixel[i] : 0, numbers ? sample[i] : 0});
    rays.ox[i] = r.origin.x, rays.oy[i] = r.origin.y, rays.oz[i] = r.origin.z;
    rays.dx[i] = r.direction.x, rays.dy[i] = r.direction.y, rays.dz[i] = r.direction.z;
    rays.tnear[i] = r.tnear, rays.tfar[i] = r.tfar, rays.time[i] = r.time;
  }
}

// The expressions of ray(), in the same order.
ENCORE_AVX2_CLONES
void CameraRays::pinholeRays(const float* film_x, const float* film_y, RayPacket& rays) const {
  const Pose& p = still_;
  PacketLanes<float> ux, uy, uz, tnear, tfar;
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    const float x = film_x[i] - half_width_, y = film_y[i] - half_height_;
    const float dx = p.centre.x + (p.step_x.x * x + p.step_y.x * y),
                dy = p.centre.y + (p.step_x.y * x + p.step_y.y * y),
                dz = p.centre.z + (p.step_x.z * x + p.step_y.z * y);
    const float size = std::sqrt(dx * dx + dy * dy + dz * dz), divisor = size > 0 ? size : 1;
    ux[i] = dx / divisor, uy[i] = dy / divisor, uz[i] = dz / divisor;
    const float cosine = ux[i] * p.forward.x + uy[i] * p.forward.y + uz[i] * p.forward.z;
    const float from = near_ / cosine;
    tnear[i] = 0 < from ? from : 0, tfar[i] = far_ / cosine;
  }
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    rays.dx[i] = ux[i], rays.dy[i] = uy[i], rays.dz[i] = uz[i];
    rays.tnear[i] = tnear[i], rays.tfar[i] = tfar[i];
  }
}

namespace {

// origin: of all rays; null: each has its own.
ENCORE_AVX2_CLONES
void depthsFrom(const Vec3f* origin, Vec3f eye, Vec3f forward, const RayPacket& rays, const HitPacket& hits,
                PacketLanes<float>& depth) {
  PacketLanes<float> d;
  if (origin) {
    const Vec3f o = *origin;
    for (uint32_t i = 0; i < kPacketWidth; ++i) {
      const float t = hits.t[i];
      const float x = o.x + rays.dx[i] * t - eye.x, y = o.y + rays.dy[i] * t - eye.y, z = o.z + rays.dz[i] * t - eye.z;
      const float along = x * forward.x + y * forward.y + z * forward.z;
      d[i] = hits.instance[i] != kNoInstance ? along : std::numeric_limits<float>::infinity();
    }
  } else {
    for (uint32_t i = 0; i < kPacketWidth; ++i) {
      const float t = hits.t[i];
      const float x = rays.ox[i] + rays.dx[i] * t - eye.x, y = rays.oy[i] + rays.dy[i] * t - eye.y,
                  z = rays.oz[i] + rays.dz[i] * t - eye.z;
      const float along = x * forward.x + y * forward.y + z * forward.z;
      d[i] = hits.instance[i] != kNoInstance ? along : std::numeric_limits<float>::infinity();
    }
  }
  for (uint32_t i = 0; i < kPacketWidth; ++i) depth[i] = d[i];
}

}  // namespace

void CameraRays::depths(const RayPacket& rays, const HitPacket& hits, PacketLanes<float>& depth) const {
  depthsFrom(ownOrigins() ? nullptr : &still_.origin, still_.origin, still_.forward, rays, hits, depth);
}

// Igehy 1999, eq. 8.
void CameraRays::differential(const Sample& sample, Vec3f& dpdx, Vec3f& dpdy, Vec3f& dddx, Vec3f& dddy) const {
  const Pose pose = poseAt(time(sample));
  dpdx = dpdy = dddx = dddy = {};
  if (orthographic_) {
    dpdx = pose.step_x, dpdy = pose.step_y;
    return;
  }
  const Vec3f d = aim(pose, sample.film_x, sample.film_y, lensPoint(sample)).direction;
  const float squared = dot(d, d), scale = 1 / (squared * std::sqrt(squared));
  dddx = (pose.step_x * squared - d * dot(d, pose.step_x)) * scale;
  dddy = (pose.step_y * squared - d * dot(d, pose.step_y)) * scale;
}

float CameraRays::depth(Vec3f point) const { return dot(point - still_.origin, still_.forward); }

}  // namespace encore
