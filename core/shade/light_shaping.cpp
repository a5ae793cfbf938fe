#include "core/shade/light_shaping.h"

#include <algorithm>
#include <cmath>

namespace encore {
namespace {

// 1 within the cone, 0 outside.
float coneFactor(const Light& light, float angle) {
  const float cutoff = light.cone_angle_radians;
  if (angle > cutoff) return 0;
  const float start = cutoff * (1 - std::clamp(light.cone_softness, 0.0f, 1.0f));
  if (!(cutoff > start)) return 1;
  const float t = std::clamp((angle - start) / (cutoff - start), 0.0f, 1.0f);
  return 1 - t * t * (3 - 2 * t);
}

Vec3f focusFactor(const Light& light, float cosine) {
  if (!(light.focus > 0)) return {1, 1, 1};
  const float f = std::pow(std::abs(cosine), light.focus);
  return light.focus_tint * (1 - f) + Vec3f{f, f, f};
}

}  // namespace

Vec3f shapingFactor(const Light& light, Vec3f emitted) {
  if (!light.shaped) return {1, 1, 1};
  const float cosine = std::clamp(dot(light.shaping_axis, emitted), -1.0f, 1.0f);
  const float cone = coneFactor(light, std::acos(cosine));
  return cone > 0 ? focusFactor(light, cosine) * cone : Vec3f{};
}

float shapingBound(const Light& light, Vec3f emitted, float half_angle_radians) {
  if (!light.shaped) return 1;
  const float angle = std::acos(std::clamp(dot(light.shaping_axis, emitted), -1.0f, 1.0f));
  // Rounding must not cut off what is on the border.
  const float nearest = std::max(0.0f, angle - half_angle_radians - 1e-3f);
  const float furthest = std::min(kPi, angle + half_angle_radians + 1e-3f);
  const float cosine = std::max(std::cos(nearest), -std::cos(furthest));
  const float focus = maxComponent(focusFactor(light, std::clamp(cosine, 0.0f, 1.0f)));
  return coneFactor(light, nearest) * std::max({0.0f, focus, light.focus > 0 ? maxComponent(light.focus_tint) : 0.0f});
}

}  // namespace encore
