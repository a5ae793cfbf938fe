#include "core/shade/lights.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace encore {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Below it (steradians) float loses the spherical rectangle to cancellation, and area sampling is as good.
constexpr double kMinSphericalRectangle = 0.01;

// 1 - cos(angle) without cancellation.
float capOf(float angle_radians) {
  const float s = std::sin(0.5f * angle_radians);
  return 2 * s * s;
}
// 1 - cosine between two unit vectors without cancellation.
float capBetween(Vec3f a, Vec3f b) {
  const Vec3f d = a - b;
  return 0.5f * dot(d, d);
}
float distantCap(const Light& light) { return capOf(0.5f * std::min(light.angle_radians, 2 * kPi)); }

Vec3f towards(const Light& light, Vec3f p) { return toFloat(light.centre - toDouble(p)); }

float intersectSphere(const Light& light, Vec3f p, Vec3f direction) {
  const Vec3f centre = towards(light, p);
  const float d = length(centre);
  if (!(light.radius > 0)) return -1;
  if (d <= light.radius) {
    const float b = dot(centre, direction);
    return b + std::sqrt(std::max(0.0f, b * b - (d - light.radius) * (d + light.radius)));
  }
  const float cap = capBetween(direction, centre / d);
  const float sin2 = cap * (2 - cap), ratio = light.radius / d;
  if (cap > 1 || sin2 > ratio * ratio) return -1;
  return d * (1 - cap) - std::sqrt(std::max(0.0f, light.radius * light.radius - d * d * sin2));
}

float intersectRect(const Light& light, Vec3f p, Vec3f direction) {
  const Vec3f axis = cross(light.half_u, light.half_v), centre = towards(light, p);
  const float height = dot(centre, axis), slope = dot(direction, axis);  // both positive on the lit side
  if (!(height > 0) || !(slope > 0)) return -1;
  const float t = height / slope;
  const Vec3f q = direction * t - centre;
  const float scale = dot(axis, axis);
  const float u = dot(cross(q, light.half_v), axis), v = dot(cross(light.half_u, q), axis);
  return std::abs(u) <= scale && std::abs(v) <= scale ? t : -1;
}

}  // namespace

bool isDelta(const Light& light) { return light.kind == Light::Kind::Distant && !(light.angle_radians > 0); }

bool anyDelta(std::span<const Light> lights) { return std::any_of(lights.begin(), lights.end(), isDelta); }

float intersectLight(const Light& light, Vec3f p, Vec3f direction) {
  switch (light.kind) {
    case Light::Kind::Distant:
      return !isDelta(light) && capBetween(direction, -light.direction) <= distantCap(light) ? kInfinity : -1;
    case Light::Kind::Rect:
      return intersectRect(light, p, direction);
    case Light::Kind::Sphere:
      return intersectSphere(light, p, direction);
    case Light::Kind::Dome:
      return kInfinity;
  }
  return -1;
}

LightSampler::LightSampler(const Light& light, Vec3f p, Vec3f n) : light_(light), p_(p) {
  switch (light.kind) {
    case Light::Kind::Distant:
      basis_ = Basis(-light.direction);
      cap_ = distantCap(light);
      break;
    case Light::Kind::Rect:
      prepareRect();
      break;
    case Light::Kind::Sphere:
      prepareSphere();
      break;
    case Light::Kind::Dome:
      basis_ = Basis(n);
      break;
  }
}

void LightSampler::prepareSphere() {
  const Vec3f centre = towards(light_, p_);
  centre_distance_ = length(centre);
  dark_ = !(light_.radius > 0);
  if (centre_distance_ <= light_.radius) {
    cap_ = 2;  // inside: all directions
    return;
  }
  basis_ = Basis(centre / centre_distance_);
  const float sine = light_.radius / centre_distance_;
  cap_ = sine * sine / (1 + std::sqrt(std::max(0.0f, 1 - sine * sine)));
}

void LightSampler::prepareRect() {
  const Vec3d to_centre = light_.centre - toDouble(p_), hu = toDouble(light_.half_u), hv = toDouble(light_.half_v);
  const Vec3d x = normalize(hu), z = -normalize(cross(hu, hv)), y = cross(z, x);
  const double height = -dot(to_centre, z), a = length(hu), b = dot(hv, y);
  dark_ = !(height > 0) || !(a > 0) || b == 0;
  if (dark_) return;
  basis_.t = toFloat(x), basis_.b = toFloat(y), basis_.n = toFloat(z);
  const double cx = dot(to_centre, x), cy = dot(to_centre, y), shear = dot(hv, x);
  const double x0 = cx - a, x1 = cx + a, y0 = cy - b, y1 = cy + b;
  x0_ = float(x0), x1_ = float(x1), y0_ = float(y0), y1_ = float(y1);
  height_ = float(height), area_ = float(4 * a * std::abs(b)), shear_ = float(shear);
  if (std::abs(shear) > 1e-5 * std::abs(b)) return;

  // Normals of the planes through p and the edges, z components only: the others vanish in the products.
  const auto [low, high] = std::minmax(y0, y1);
  const auto tilt = [&](double s) { return s / std::sqrt(s * s + height * height); };
  const double n0 = -tilt(low), n1 = tilt(x1), n2 = tilt(high), n3 = -tilt(x0);
  const double g0 = std::acos(-n0 * n1), g1 = std::acos(-n1 * n2), g2 = std::acos(-n2 * n3), g3 = std::acos(-n3 * n0);
  const double k = 2 * 3.14159265358979323846 - g2 - g3, solid_angle = g0 + g1 - k;
  if (!(solid_angle > kMinSphericalRectangle)) return;
  y0_ = float(low), y1_ = float(high);
  solid_angle_ = float(solid_angle), k_ = float(k), b0_ = float(n0), b1_ = float(n2);
}

// Where the sample lies in the rectangle's plane, relative to p.
Vec2f LightSampler::rectPoint(Vec2f u) const {
  if (solid_angle_ == 0) return {x0_ + (x1_ - x0_) * u.x + (2 * u.y - 1) * shear_, y0_ + (y1_ - y0_) * u.y};
  const float au = u.x * solid_angle_ + k_;
  const float fu = (std::cos(au) * b0_ - b1_) / std::sin(au);
  const float cu = std::clamp(std::copysign(1 / std::sqrt(fu * fu + b0_ * b0_), fu), -1.0f, 1.0f);
  const float x = std::clamp(cu * height_ / std::sqrt(std::max(1 - cu * cu, 1e-12f)), x0_, x1_);
  const float d2 = x * x + height_ * height_;
  const float h0 = y0_ / std::sqrt(d2 + y0_ * y0_), h1 = y1_ / std::sqrt(d2 + y1_ * y1_);
  const float h = h0 + u.y * (h1 - h0);
  const float y = h * std::sqrt(d2 / std::max(1 - h * h, 1e-12f));
  return {x, std::clamp(y, y0_, y1_)};
}

LightSample LightSampler::sampleRect(Vec2f u) const {
  const Vec2f q = rectPoint(u);
  const Vec3f local{q.x, q.y, -height_};
  const float distance = length(local);
  const float pdf = solid_angle_ > 0 ? 1 / solid_angle_ : distance * distance * distance / (area_ * height_);
  return {normalize(basis_.toWorld(local)), distance, light_.radiance, pdf, true};
}

LightSample LightSampler::sampleCone(Vec2f u) const {
  const float k = u.x * cap_, sine = std::sqrt(k * (2 - k)), phi = 2 * kPi * u.y;
  const Vec3f direction = normalize(basis_.toWorld({sine * std::cos(phi), sine * std::sin(phi), 1 - k}));
  float distance = kInfinity;
  if (light_.kind == Light::Kind::Sphere) {
    // On the cone's rim rounding may miss the sphere: the nearest point will do.
    const float hit = intersectSphere(light_, p_, direction);
    distance = hit >= 0 ? hit : centre_distance_ * (1 - cap_);
  }
  return {direction, distance, light_.radiance, 1 / (2 * kPi * cap_), true};
}

LightSample LightSampler::sample(Vec2f u) const {
  if (dark_) return {};
  switch (light_.kind) {
    case Light::Kind::Distant:
      if (cap_ == 0) return {-light_.direction, kInfinity, light_.radiance, 0, true};
      return sampleCone(u);
    case Light::Kind::Rect:
      return sampleRect(u);
    case Light::Kind::Sphere:
      return sampleCone(u);
    case Light::Kind::Dome: {
      const float r = std::sqrt(u.x), z = std::sqrt(1 - u.x), phi = 2 * kPi * u.y;
      const Vec3f direction = normalize(basis_.toWorld({r * std::cos(phi), r * std::sin(phi), z}));
      return {direction, kInfinity, light_.radiance, z * kInvPi, true};
    }
  }
  return {};
}

float LightSampler::pdf(Vec3f direction) const {
  if (dark_) return 0;
  if (light_.kind == Light::Kind::Dome) return std::max(dot(basis_.n, direction), 0.0f) * kInvPi;
  const float t = intersectLight(light_, p_, direction);
  if (t < 0) return 0;
  if (light_.kind != Light::Kind::Rect) return 1 / (2 * kPi * cap_);
  return solid_angle_ > 0 ? 1 / solid_angle_ : t * t / (area_ * -dot(direction, basis_.n));
}

LightSample sampleLight(const Light& light, Vec3f p, Vec3f n, Vec2f u) { return LightSampler(light, p, n).sample(u); }

float pdfLight(const Light& light, Vec3f p, Vec3f n, Vec3f direction) {
  return LightSampler(light, p, n).pdf(direction);
}

LightHit intersectLights(std::span<const Light> lights, Vec3f origin, Vec3f direction, float tfar) {
  LightHit nearest, distant;
  nearest.t = tfar;
  distant.t = kInfinity;
  for (const Light& light : lights) {
    const float t = intersectLight(light, origin, direction);
    if (t < 0) continue;
    if (t < nearest.t) nearest = {light.radiance, light.radiance * light.specular, t, true};
    if (t == kInfinity && tfar == kInfinity) {
      distant.radiance += light.radiance;
      distant.specular_radiance += light.radiance * light.specular;
      distant.valid = true;
    }
  }
  return nearest.valid ? nearest : distant;
}

}  // namespace encore
