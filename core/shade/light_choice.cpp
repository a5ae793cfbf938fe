#include "core/shade/light_choice.h"

#include <algorithm>
#include <cmath>

#include "core/shade/light_shaping.h"

namespace encore {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kEvenShare = 0.1;

// Largest cosine between n and the directions of a cone whose axis has this cosine to n; 0 where all are below.
float largestCosine(float axis_cosine, float half_angle_cosine) {
  const float c = std::clamp(axis_cosine, -1.0f, 1.0f), h = std::clamp(half_angle_cosine, -1.0f, 1.0f);
  if (c >= h) return 1;
  const float largest = c * h + std::sqrt((1 - c * c) * (1 - h * h));
  // Rounding must not leave out what just touches the horizon.
  return std::min(std::max(largest, 0.0f) + (largest > -1e-4f ? 1e-4f : 0.0f), 1.0f);
}

float distantImportance(const PreparedLight& light, Vec3f n) {
  const float half = 0.5f * std::min(light.light->angle_radians, 2 * kPi);
  return light.weight * largestCosine(-dot(light.light->direction, n), std::cos(half));
}

}  // namespace

float lightImportance(const PreparedLight& light, Vec3f p, Vec3f n) {
  if (light.radius == kInfinity) return distantImportance(light, n);
  const Vec3f to = light.centre - p;
  const float d2 = dot(to, to), r2 = light.radius * light.radius;
  const float front = -dot(to, light.facing);  // height over the plane of a one-sided light
  const bool one_sided = light.facing != Vec3f{};
  if (one_sided && !(front > -1e-4f * light.radius)) return 0;
  // Nothing is known of directions from within the ball.
  if (!(d2 > r2)) return r2 > 0 ? light.weight / r2 : 0;
  const float d = std::sqrt(d2), sine = light.radius / d, cone = std::sqrt(1 - sine * sine);
  float factor = largestCosine(dot(to, n) / d, cone);
  if (one_sided) factor *= std::clamp(front / d + 1e-4f, 0.0f, 1.0f);
  if (light.light->shaped) factor *= shapingBound(*light.light, -to / d, std::asin(sine));
  return light.weight * factor / d2;
}

std::span<const LightRays> LightChoice::choose(Vec3f p, Vec3f n, uint32_t link_group, float u) {
  const std::span<const PreparedLight> lights = lights_.lights();
  rays_.assign(lights.size(), {});
  double sum = 0;
  uint32_t contributing = 0;
  if (lights_.chooses()) importance_.assign(lights.size(), 0.0f);
  for (size_t k = 0; k < lights.size(); ++k) {
    if (!lights[k].lights(link_group)) continue;
    if (!lights_.chooses() || !lights[k].chosen) {
      rays_[k] = {lights[k].rays, 0, lights[k].rays, float(lights[k].rays)};
      continue;
    }
    const float importance = lightImportance(lights[k], p, n);
    if (!(importance > 0)) continue;
    importance_[k] = std::min(importance, 1e30f);
    sum += double(importance_[k]), ++contributing;
  }
  if (contributing == 0) return rays_;

  const uint32_t total = settings_.most_light_samples;
  double before = 0;
  uint32_t dealt = 0;
  for (size_t k = 0; k < lights.size(); ++k) {
    if (!lights_.chooses() || importance_[k] == 0) continue;
    const double share = (1 - kEvenShare) * double(importance_[k]) / sum + kEvenShare / contributing;
    before += share * total;
    // Rays are dealt at u, 1 + u, 2 + u, ... of the running sum.
    const double until = std::ceil(before - double(u));
    const uint32_t end = std::clamp(uint32_t(std::max(until, 0.0)), dealt, total);
    rays_[k] = {end - dealt, dealt, total, float(share * total)};
    dealt = end;
  }
  return rays_;
}

}  // namespace encore
