#include "core/path/scatter.h"

#include "core/shade/interface_shares.h"

namespace encore {

namespace {

// Smooth lobes leave nothing to chance, and numbers cost more than the bounce.
bool needsNumbers(const Lobes& lobes, Effect effect) {
  if (effect == Effect::Refract) return lobes.alpha > 0;
  const bool rough_coat = lobes.coat_traced && lobes.clearcoat > 0 && lobes.coat_alpha > 0;
  return rough_coat || (lobes.specular_traced && lobes.alpha > 0);
}

// sampleReflection() where all traced lobes are smooth, which needs no basis.
Bounce mirrored(const Arrival& arrival, Vec3f n) {
  const float cosine = dot(n, arrival.wo);
  const Vec3f weight = effectWeights(arrival.lobes, cosine, true).reflection;
  return {normalize(n * (2 * cosine) - arrival.wo), weight, n, maxComponent(weight) > 0};
}

// The angle across a square of the same solid angle as the lobe: facets fill about pi alpha² (1 / D at its peak), what
// they reflect turns twice as far, and what they refract by 1 - 1 / eta. at_normal: the facet is the surface's own.
float lobeWidth(const Lobes& lobes, Effect effect, bool at_normal) {
  const float across = std::sqrt(kPi);
  if (effect == Effect::Refract) {
    if (lobes.thin) return 2 * across * sheetAlpha(lobes);
    return across * lobes.alpha * std::abs(1 - 1 / lobes.eta);
  }
  if (at_normal) return 0;  // of a smooth lobe beside a rough one
  const bool coat = lobes.coat_traced && lobes.clearcoat > 0 && lobes.coat_alpha > 0;
  const bool specular = lobes.specular_traced && lobes.alpha > 0;
  const float alpha = coat && specular ? std::min(lobes.alpha, lobes.coat_alpha)
                      : coat           ? lobes.coat_alpha
                                       : lobes.alpha;
  return 2 * across * alpha;
}

}  // namespace

Arrival arrive(const SurfacePoint& point, Vec3f direction, const Lobes& lobes, bool view_weight_in_shading) {
  const float sign = point.side ? -1.0f : 1.0f;
  Arrival a{point,
            -direction,
            point.ng * sign,
            point.ns * sign,
            point.dn1 * sign,
            point.dn2 * sign,
            lobes,
            view_weight_in_shading};
  if (!(dot(a.wo, a.n) > 0)) a.n = a.ng, a.dn1 = a.dn2 = {};
  return a;
}

bool absorbsAll(const Lobes& lobes, bool view_weight_in_shading) {
  const bool coat_reflects = lobes.coat_traced && lobes.clearcoat > 0;
  return view_weight_in_shading && !lobes.specular_traced && !coat_reflects && lobes.opacity == 1;
}

ChosenEffect chooseEffect(const EffectWeights& weights, const BounceRandom& random) {
  const float reflect = maxComponent(weights.reflection), refract = maxComponent(weights.refraction),
              absorb = maxComponent(weights.absorption);
  const float sum = reflect + refract + absorb;
  if (!(sum > 0)) return {};
  // Without a choice, numbers cost more than what follows.
  if (!(reflect > 0 || refract > 0)) return {Effect::Absorb, 1};
  if (!(absorb > 0 || refract > 0)) return {Effect::Reflect, 1};
  const float x = random.choice() * sum;
  if (x < reflect) return {Effect::Reflect, reflect / sum};
  if (x < reflect + refract) return {Effect::Refract, refract / sum};
  return {Effect::Absorb, absorb / sum};
}

Departure depart(const Arrival& arrival, Effect effect, const BounceRandom& random) {
  const bool chance = needsNumbers(arrival.lobes, effect);
  std::array<float, 4> u{};
  if (chance) u = random.lobe();
  const auto sample = [&](Vec3f n) {
    if (effect == Effect::Refract) return sampleRefraction(arrival.lobes, n, arrival.wo, u.data());
    return chance ? sampleReflection(arrival.lobes, n, arrival.wo, u.data()) : mirrored(arrival, n);
  };
  const auto leavesRightly = [&](const Bounce& b) {
    const float cosine = dot(b.direction, arrival.ng);
    return b.valid && (effect == Effect::Reflect ? cosine > 0 : cosine < 0);
  };
  Departure d;
  Bounce bounce = sample(arrival.n);
  Vec3f bounce_normal = arrival.n;
  d.dn1 = arrival.dn1, d.dn2 = arrival.dn2;
  if (bounce.valid && !leavesRightly(bounce)) {
    bounce = sample(arrival.ng);
    bounce_normal = arrival.ng;
    d.dn1 = d.dn2 = {};
  }
  d.direction = bounce.direction, d.weight = bounce.weight, d.normal = bounce.half_vector;
  d.valid = leavesRightly(bounce);
  if (chance) d.lobe_width = lobeWidth(arrival.lobes, effect, bounce.half_vector == bounce_normal);
  return d;
}

}  // namespace encore
