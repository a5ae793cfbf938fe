// Lights of every kind, and what tests of light sampling share.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/scene/random.h"
#include "core/shade/lights.h"

namespace encore::test {

inline Light light(Light::Kind kind, Vec3d centre, Vec3f half_u, Vec3f half_v, float radius = 0.5f) {
  Light l;
  l.kind = kind, l.centre = centre, l.half_u = half_u, l.half_v = half_v, l.radius = radius;
  return l;
}
inline Light sun(Vec3f direction, float angle_radians) {
  Light l;
  l.direction = normalize(direction), l.angle_radians = angle_radians;
  return l;
}

struct NamedLight {
  std::string name;
  Light light;
};
// All can be seen from the origin.
inline std::vector<NamedLight> lightsOfEveryKind() {
  using K = Light::Kind;
  return {{"rect", light(K::Rect, {0.5, 0, 1}, {1, 0, 0}, {0, 0.6f, 0})},
          {"sheared rect", light(K::Rect, {1, 0, 1.5}, {1, 0, 0}, {0.6f, 0.8f, 0})},
          {"small rect", light(K::Rect, {0, 4, 9}, {0.5f, 0, 0}, {0, 0.3f, 0})},
          {"disk", light(K::Disk, {0.2, -0.3, 0.5}, {1, 0, 0}, {0, 1, 0})},
          {"ellipse", light(K::Disk, {1, 0.5, 3}, {0.8f, 0.6f, 0}, {-0.36f, 0.48f, 0.8f})},
          {"sheared disk", light(K::Disk, {1, 0, 1}, {1, 0, 0}, {0.6f, 0.8f, 0})},
          {"sphere", light(K::Sphere, {1, 2, 2}, {}, {}, 1.5f)},
          {"sphere around", light(K::Sphere, {0, 0, 1}, {}, {}, 4)},
          {"cylinder", light(K::Cylinder, {0.5, 1, 1}, {0, 0, 1.5f}, {}, 0.7f)},
          {"close cylinder", light(K::Cylinder, {0.5, 0, 0.55}, {2, 0.3f, 0}, {}, 0.5f)},
          {"far cylinder", light(K::Cylinder, {30, 10, 5}, {0, 2, 1}, {}, 1)},
          {"cylinder seen along its axis", light(K::Cylinder, {4, 0.3, 1.2}, {2, 0, 0}, {}, 0.4f)},
          {"sun", sun({0.6f, 0, -0.8f}, 0.7f)},
          {"half the sky", sun({0, 0, -1}, 4)},
          {"dome", light(K::Dome, {}, {}, {})}};
}

inline Vec3f onSphere(Vec2f u) {
  const float z = 1 - 2 * u.x, r = std::sqrt(std::max(0.0f, 1 - z * z));
  return {r * std::cos(2 * kPi * u.y), r * std::sin(2 * kPi * u.y), z};
}

// How far counts are from their expectations: chi-squared over its degrees of freedom, after cells that expect less
// than 8 are put together. Independent samples give about 1, and hardly ever more than 1 + 5 √(2 / cells).
struct ChiSquared {
  double sum = 0;
  int cells = 0;
  double limit() const { return 1 + 5 * std::sqrt(2.0 / std::max(cells - 1, 1)); }
  double value() const { return sum / std::max(cells - 1, 1); }
};
inline ChiSquared chiSquared(const std::vector<double>& observed, const std::vector<double>& expected) {
  ChiSquared chi;
  double o = 0, e = 0;
  const auto close = [&] {
    if (e > 0) chi.sum += (o - e) * (o - e) / e, ++chi.cells;
    o = e = 0;
  };
  for (size_t i = 0; i < observed.size(); ++i) {
    o += observed[i], e += expected[i];
    if (e >= 8) close();
  }
  if (o > 0 && e < 1) e = 1;  // what must not be
  close();
  return chi;
}

// Cells of equal solid angle, kAcross by kAround, in a cone: cap is 1 - the cosine of its half angle.
inline constexpr uint32_t kAcross = 24, kAround = 48;
struct Cone {
  Vec3f axis{0, 0, 1};
  float cap = 2;
};
inline uint32_t cellOf(const Cone& cone, Vec3f direction) {
  const Vec3f d = Basis(cone.axis).toLocal(direction);
  const float phi = std::atan2(d.y, d.x) / (2 * kPi), k = 0.5f * dot(direction - cone.axis, direction - cone.axis);
  const uint32_t i = std::min(uint32_t(k / cone.cap * float(kAcross)), kAcross - 1);
  return i * kAround + std::min(uint32_t((phi < 0 ? phi + 1 : phi) * float(kAround)), kAround - 1);
}
inline Vec3f inCone(const Cone& cone, Vec2f u) {
  const float k = u.x * cone.cap, r = std::sqrt(k * (2 - k)), phi = 2 * kPi * u.y;
  return normalize(Basis(cone.axis).toWorld({r * std::cos(phi), r * std::sin(phi), 1 - k}));
}

// Independent samples against the integral of the density, for any sampler of directions, in the cone that they fill.
template <class Sample, class Pdf>
ChiSquared testDirections(Sample sample, Pdf pdf, uint32_t count = 40000, uint32_t per_cell = 900) {
  std::vector<Vec3f> directions;
  Vec3f sum;
  for (uint32_t i = 0; i < count; ++i) {
    const std::array<uint32_t, 4> h = pcg4d(i, 17, 3, 99);
    Vec3f d;
    if (!sample(Vec2f{toUnit(h[0]), toUnit(h[1])}, d)) continue;
    directions.push_back(d);
    sum += d;
  }
  Cone cone{normalize(sum), 0};
  for (const Vec3f d : directions) cone.cap = std::max(cone.cap, 0.51f * dot(d - cone.axis, d - cone.axis));
  cone.cap = std::min(cone.cap, 2.0f);
  std::vector<double> observed(kAcross * kAround), expected(kAcross * kAround);
  for (const Vec3f d : directions) observed[cellOf(cone, d)] += 1;
  for (uint32_t c = 0; c < kAcross * kAround; ++c)
    for (uint32_t i = 0; i < per_cell; ++i) {
      const Vec2f u = sobol2(i, 5 + c);
      const Vec3f d =
          inCone(cone, {(float(c / kAround) + u.x) / float(kAcross), (float(c % kAround) + u.y) / float(kAround)});
      const double solid_angle = 2 * 3.14159265358979 * double(cone.cap) / (double(kAcross) * kAround);
      expected[c] += double(pdf(d)) * solid_angle / per_cell * count;
    }
  return chiSquared(observed, expected);
}

}  // namespace encore::test
