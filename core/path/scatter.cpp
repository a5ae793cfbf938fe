#include "core/path/scatter.h"

namespace encore {

namespace {

// Smooth lobes leave nothing to chance, and numbers cost more than the bounce.
bool needsNumbers(const Lobes& lobes, Effect effect) {
  if (effect == Effect::Refract) return lobes.alpha > 0;
  const bool rough_coat = lobes.coat_traced && lobes.clearcoat > 0 && lobes.coat_alpha > 0;
  return rough_coat || (lobes.specular_traced && lobes.alpha > 0);
}

}  // namespace

Arrival arrive(const SurfacePoint& point, Vec3f direction, const Material& material, const PathInputs& inputs,
               float roughness_limit, bool view_weight_in_shading) {
  const float sign = point.side ? -1.0f : 1.0f;
  Arrival a{point, -direction, point.ng * sign, point.ns * sign, point.dn1 * sign, point.dn2 * sign, {}, false};
  if (!(dot(a.wo, a.n) > 0)) a.n = a.ng, a.dn1 = a.dn2 = {};
  a.lobes = makeLobes(material, inputs, point.side != 0, roughness_limit);
  a.view_weight_in_shading = view_weight_in_shading;
  return a;
}

ChosenEffect chooseEffect(const EffectWeights& weights, float u) {
  const float reflect = maxComponent(weights.reflection), refract = maxComponent(weights.refraction),
              absorb = maxComponent(weights.absorption);
  const float sum = reflect + refract + absorb, x = u * sum;
  if (!(sum > 0)) return {};
  if (x < reflect) return {Effect::Reflect, reflect / sum};
  if (x < reflect + refract) return {Effect::Refract, refract / sum};
  return {Effect::Absorb, absorb / sum};
}

Departure depart(const Arrival& arrival, Effect effect, const BounceRandom& random) {
  std::array<float, 4> u{};
  if (needsNumbers(arrival.lobes, effect)) u = random.lobe();
  const auto sample = [&](Vec3f n) {
    return effect == Effect::Reflect ? sampleReflection(arrival.lobes, n, arrival.wo, u.data())
                                     : sampleRefraction(arrival.lobes, n, arrival.wo, u.data());
  };
  const auto leavesRightly = [&](const Bounce& b) {
    const float cosine = dot(b.direction, arrival.ng);
    return b.valid && (effect == Effect::Reflect ? cosine > 0 : cosine < 0);
  };
  Departure d;
  Bounce bounce = sample(arrival.n);
  d.dn1 = arrival.dn1, d.dn2 = arrival.dn2;
  if (bounce.valid && !leavesRightly(bounce)) {
    bounce = sample(arrival.ng);
    d.dn1 = d.dn2 = {};
  }
  d.direction = bounce.direction, d.weight = bounce.weight, d.normal = bounce.half_vector;
  d.valid = leavesRightly(bounce);
  return d;
}

}  // namespace encore
