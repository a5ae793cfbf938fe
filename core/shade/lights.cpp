#include "core/shade/lights.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/shade/light_set.h"
#include "core/shade/light_shaping.h"

namespace encore {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Below it (steradians) float loses the spherical rectangle to cancellation, and area sampling is as good.
constexpr double kMinSphericalRectangle = 0.01;
// Above it the corners that are lost of the rectangle around a disk cost less than the uneven density of its area.
constexpr float kDiskByRectangle = 0.5f;
// Share of a textured dome's samples that follow its brightness; the others follow the cosine. Half is best, or nearly:
// the relative variance of a sample of irradiance, over random normals, is 1.0 under a photographed sky with its sun
// (7900 by the cosine alone, 3.4 by brightness alone), 1.1 under a sky of dim and bright areas (2.3, 4.7).
constexpr float kImageShare = 0.5f;
constexpr float kRounding = 0x1p-20f;  // of coordinates, with something to spare
constexpr float kBelowOne = 0x1.fffffep-1f;

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

float meetSphere(const Light& light, Vec3f p, Vec3f direction) {
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

// Where the ray meets the plane of a rectangle or disk from its lit side, in units of half_u and half_v.
struct PlanePoint {
  float t = -1, u = 0, v = 0;
};
PlanePoint meetPlane(const Light& light, Vec3f p, Vec3f direction) {
  const Vec3f axis = cross(light.half_u, light.half_v), centre = towards(light, p);
  const float height = dot(centre, axis), slope = dot(direction, axis);  // both positive on the lit side
  if (!(height > 0) || !(slope > 0)) return {};
  const float t = height / slope;
  const Vec3f q = direction * t - centre;
  const float scale = 1 / dot(axis, axis);
  return {t, dot(cross(q, light.half_v), axis) * scale, dot(cross(light.half_u, q), axis) * scale};
}

float meetCylinder(const Light& light, Vec3f p, Vec3f direction) {
  const float half = length(light.half_u);
  if (!(half > 0) || !(light.radius > 0)) return -1;
  const Vec3f axis = light.half_u / half, centre = towards(light, p);
  const float along = dot(centre, axis), slope = dot(direction, axis);
  const Vec3f c = centre - axis * along, d = direction - axis * slope;  // across the axis
  const float rho2 = dot(c, c), d2 = dot(d, d), b = dot(c, d);
  const float outside = rho2 - light.radius * light.radius;
  if (!(outside > 0) || !(b > 0)) return -1;
  // The distance of the ray from the axis, without the cancellation of b² - d² rho².
  const Vec3f miss = cross(c, d);
  const float discriminant = light.radius * light.radius * d2 - dot(miss, miss);
  if (discriminant < 0) return -1;
  const float t = outside / (b + std::sqrt(discriminant));
  return std::abs(t * slope - along) <= half ? t : -1;
}

}  // namespace

bool isDelta(const Light& light) { return light.kind == Light::Kind::Distant && !(light.angle_radians > 0); }

bool anyDelta(std::span<const Light> lights) { return std::any_of(lights.begin(), lights.end(), isDelta); }

LightPoint meetLight(const Light& light, Vec3f p, Vec3f direction) {
  switch (light.kind) {
    case Light::Kind::Distant:
      return {!isDelta(light) && capBetween(direction, -light.direction) <= distantCap(light) ? kInfinity : -1, {}};
    case Light::Kind::Rect: {
      const PlanePoint q = meetPlane(light, p, direction);
      if (!(std::abs(q.u) <= 1 && std::abs(q.v) <= 1)) return {};
      return {q.t, {0.5f - 0.5f * q.u, 0.5f + 0.5f * q.v}};
    }
    case Light::Kind::Disk: {
      const PlanePoint q = meetPlane(light, p, direction);
      return {q.u * q.u + q.v * q.v <= 1 ? q.t : -1, {}};
    }
    case Light::Kind::Sphere:
      return {meetSphere(light, p, direction), {}};
    case Light::Kind::Cylinder:
      return {meetCylinder(light, p, direction), {}};
    case Light::Kind::Dome:
      return {kInfinity, {}};
    case Light::Kind::Mesh:
      break;
  }
  return {};
}

float intersectLight(const Light& light, Vec3f p, Vec3f direction) { return meetLight(light, p, direction).distance; }

Vec3f lightRadiance(const Light& light, const LightImage* image, const LightPoint& point, Vec3f direction) {
  Vec3f radiance = light.radiance;
  if (image && light.kind == Light::Kind::Rect) radiance *= image->at(point.st.x, point.st.y);
  if (image && light.kind == Light::Kind::Dome)
    radiance *=
        image->towards({dot(light.axis_x, direction), dot(light.axis_y, direction), dot(light.axis_z, direction)});
  if (light.shaped && std::isfinite(point.distance)) radiance *= shapingFactor(light, -direction);
  return radiance;
}

LightSampler::LightSampler(const Light& light, Vec3f p, Vec3f n, const LightParts& parts)
    : light_(light), p_(p), parts_(parts) {
  switch (light.kind) {
    case Light::Kind::Distant:
      basis_ = Basis(-light.direction);
      cap_ = distantCap(light);
      break;
    case Light::Kind::Rect:
      prepareRect();
      break;
    case Light::Kind::Disk:
      prepareDisk();
      break;
    case Light::Kind::Sphere:
      prepareSphere();
      break;
    case Light::Kind::Cylinder:
      prepareCylinder();
      break;
    case Light::Kind::Dome:
      basis_ = Basis(n);
      dark_ = parts_.image && parts_.image->black();
      break;
    case Light::Kind::Mesh:
      dark_ = !parts_.mesh || parts_.mesh->size() == 0;
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

void LightSampler::prepareDisk() {
  prepareRect();
  if (solid_angle_ < kDiskByRectangle) solid_angle_ = 0;
  if (solid_angle_ == 0) area_ *= 0.25f * kPi;
}

void LightSampler::prepareCylinder() {
  const double half = length(toDouble(light_.half_u)), radius = light_.radius;
  dark_ = true;
  if (!(half > 0) || !(radius > 0)) return;
  const Vec3d axis = toDouble(light_.half_u) / half, centre = light_.centre - toDouble(p_);
  const double along = dot(centre, axis);
  const Vec3d across = centre - axis * along;
  const double rho = length(across);
  if (!(rho > radius)) return;  // inside, or on it
  dark_ = false;
  const Vec3d z = across / rho;
  basis_.t = toFloat(axis), basis_.n = toFloat(z), basis_.b = toFloat(cross(z, axis));
  x0_ = float(along - half), x1_ = float(along + half), height_ = float(rho);
  half_angle_ = float(std::asin(std::min(1.0, radius / rho)));
}

// A line of a cylinder, parallel to its axis, that is seen at an angle across it: its distance from p across the axis,
// and the sines of the angles between its ends and the plane across.
struct LightSampler::Strip {
  float distance;
  double low, high;
};
LightSampler::Strip LightSampler::strip(float angle) const {
  const double sine = std::sin(double(angle)), rho = height_, r = light_.radius;
  const double off = rho * sine;
  // The nearer crossing: (rho² - r²) over the farther one's distance.
  const double d =
      (rho - r) * (rho + r) / (rho * std::sqrt(1 - sine * sine) + std::sqrt(std::max(0.0, (r - off) * (r + off))));
  const auto sineOf = [&](double z) { return z / std::sqrt(z * z + d * d); };
  return {float(d), sineOf(x0_), sineOf(x1_)};
}

LightSample LightSampler::sampleCylinder(Vec2f u) const {
  const float angle = (2 * u.x - 1) * half_angle_;
  const Strip s = strip(angle);
  const double sine = std::clamp(s.low + double(u.y) * (s.high - s.low), -1.0, 1.0);
  const float cosine = float(std::sqrt((1 - sine) * (1 + sine)));
  if (!(cosine > 0) || !(s.high > s.low)) return {};
  const Vec3f local{float(sine), cosine * std::sin(angle), cosine * std::cos(angle)};
  return emitted(normalize(basis_.toWorld(local)), s.distance / cosine,
                 float(1 / (2 * double(half_angle_) * (s.high - s.low))));
}

float LightSampler::pdfCylinder(Vec3f direction) const {
  const float angle = std::atan2(dot(basis_.b, direction), dot(basis_.n, direction));
  const Strip s = strip(std::clamp(angle, -half_angle_, half_angle_));
  return s.high > s.low ? float(1 / (2 * double(half_angle_) * (s.high - s.low))) : 0;
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

// Of a point at that distance, chosen uniformly in area.
float LightSampler::areaPdf(float distance) const { return distance * distance / area_ * (distance / height_); }

// Texture coordinates of a point in the rectangle's plane, relative to p.
Vec2f LightSampler::rectTexture(Vec2f q) const {
  const Vec3f centre = towards(light_, p_);
  const float v = (q.y - dot(centre, basis_.b)) / dot(light_.half_v, basis_.b);
  const float u = (q.x - dot(centre, basis_.t) - v * shear_) / length(light_.half_u);
  return {0.5f - 0.5f * u, 0.5f + 0.5f * v};
}

LightSample LightSampler::sampleRect(Vec2f u) const {
  const Vec2f q = rectPoint(u);
  const Vec3f local{q.x, q.y, -height_};
  const float distance = length(local);
  const float pdf = solid_angle_ > 0 ? 1 / solid_angle_ : areaPdf(distance);
  return emitted(normalize(basis_.toWorld(local)), distance, pdf, parts_.image ? rectTexture(q) : Vec2f{});
}

LightSample LightSampler::sampleDisk(Vec2f u) const {
  if (solid_angle_ > 0) {
    LightSample sample = sampleRect(u);
    if (intersectLight(light_, p_, sample.direction) < 0) sample = {};
    return sample;
  }
  const float r = std::sqrt(u.x), phi = 2 * kPi * u.y;
  const Vec3f to = towards(light_, p_) + light_.half_u * (r * std::cos(phi)) + light_.half_v * (r * std::sin(phi));
  const float distance = length(to);
  return emitted(to / distance, distance, areaPdf(distance));
}

LightSample LightSampler::sampleCone(Vec2f u) const {
  const float k = u.x * cap_, sine = std::sqrt(k * (2 - k)), phi = 2 * kPi * u.y;
  const Vec3f direction = normalize(basis_.toWorld({sine * std::cos(phi), sine * std::sin(phi), 1 - k}));
  float distance = kInfinity;
  if (light_.kind == Light::Kind::Sphere) {
    // On the cone's rim rounding may miss the sphere: the nearest point will do.
    const float hit = meetSphere(light_, p_, direction);
    distance = hit >= 0 ? hit : centre_distance_ * (1 - cap_);
  }
  return emitted(direction, distance, 1 / (2 * kPi * cap_));
}

LightSample LightSampler::sampleMesh(Vec2f u) const {
  const MeshLight::Sample s = parts_.mesh->sample(*parts_.trace, p_, u, parts_.time);
  const Vec3f to = s.position - p_;
  const float distance = length(to), height = -dot(to, s.normal), cosine = height / distance;
  // In the plane of the triangle, but for rounding: a point of the mesh does not light itself.
  const float rounding = kRounding * maxComponent(absolute(s.position) + absolute(p_));
  if (!(s.density > 0) || !(distance > 0) || !(height > rounding)) return {};
  return emitted(to / distance, distance, s.density * distance * distance / cosine);
}

Vec3f LightSampler::toDome(Vec3f d) const {
  return {dot(light_.axis_x, d), dot(light_.axis_y, d), dot(light_.axis_z, d)};
}

LightSample LightSampler::sampleDome(Vec2f u) const {
  const auto byCosine = [&](Vec2f v) {
    const float r = std::sqrt(v.x), z = std::sqrt(1 - v.x), phi = 2 * kPi * v.y;
    return Vec3f{r * std::cos(phi), r * std::sin(phi), z};
  };
  if (!parts_.image) {
    const Vec3f local = byCosine(u);
    return {normalize(basis_.toWorld(local)), kInfinity, light_.radiance, local.z * kInvPi, true};
  }
  Vec3f direction;
  if (u.x < kImageShare) {
    const Vec3f d = parts_.image->sample({std::min(u.x / kImageShare, kBelowOne), u.y});
    direction = normalize(light_.axis_x * d.x + light_.axis_y * d.y + light_.axis_z * d.z);
  } else {
    direction =
        normalize(basis_.toWorld(byCosine({std::min((u.x - kImageShare) / (1 - kImageShare), kBelowOne), u.y})));
  }
  return emitted(direction, kInfinity, pdf(direction));
}

LightSample LightSampler::emitted(Vec3f direction, float distance, float density, Vec2f st) const {
  return {direction, distance, lightRadiance(light_, parts_.image, {distance, st}, direction), density, true};
}

LightSample LightSampler::sample(Vec2f u) const {
  if (dark_) return {};
  switch (light_.kind) {
    case Light::Kind::Distant:
      if (cap_ == 0) return {-light_.direction, kInfinity, light_.radiance, 0, true};
      return sampleCone(u);
    case Light::Kind::Rect:
      return sampleRect(u);
    case Light::Kind::Disk:
      return sampleDisk(u);
    case Light::Kind::Sphere:
      return sampleCone(u);
    case Light::Kind::Cylinder:
      return sampleCylinder(u);
    case Light::Kind::Dome:
      return sampleDome(u);
    case Light::Kind::Mesh:
      return sampleMesh(u);
  }
  return {};
}

float LightSampler::pdf(Vec3f direction) const {
  if (dark_) return 0;
  if (light_.kind == Light::Kind::Dome) {
    const float cosine = std::max(dot(basis_.n, direction), 0.0f) * kInvPi;
    if (!parts_.image) return cosine;
    return kImageShare * parts_.image->pdf(toDome(direction)) + (1 - kImageShare) * cosine;
  }
  const float t = intersectLight(light_, p_, direction);
  if (t < 0) return 0;
  if (light_.kind == Light::Kind::Cylinder) return pdfCylinder(direction);
  if (light_.kind != Light::Kind::Rect && light_.kind != Light::Kind::Disk) return 1 / (2 * kPi * cap_);
  return solid_angle_ > 0 ? 1 / solid_angle_ : t * t / (area_ * -dot(direction, basis_.n));
}

LightSample sampleLight(const Light& light, Vec3f p, Vec3f n, Vec2f u) { return LightSampler(light, p, n).sample(u); }

float pdfLight(const Light& light, Vec3f p, Vec3f n, Vec3f direction) {
  return LightSampler(light, p, n).pdf(direction);
}

LightHit intersectLights(const LightSet& set, std::span<const Light> lights, Vec3f origin, Vec3f direction,
                         float tfar) {
  LightHit nearest, distant;
  nearest.t = tfar;
  distant.t = kInfinity;
  for (const Light& light : lights) {
    const LightPoint point = meetLight(light, origin, direction);
    const float t = point.distance;
    if (t < 0 || !(t < nearest.t || (t == kInfinity && tfar == kInfinity && !nearest.valid))) continue;
    const Vec3f radiance = lightRadiance(light, set.image(light), point, direction);
    if (light.shaped && radiance == Vec3f{}) continue;  // nothing to be seen from here, and nothing behind is hidden
    if (t < nearest.t) nearest = {radiance, radiance * light.specular, t, true};
    if (t == kInfinity && tfar == kInfinity) {
      distant.radiance += radiance;
      distant.specular_radiance += radiance * light.specular;
      distant.valid = true;
    }
  }
  return nearest.valid ? nearest : distant;
}

}  // namespace encore
