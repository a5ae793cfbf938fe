// What an interface does with light: reflects it, leaves it to the diffuse body below, or transmits it.
//
// Microfacets that scatter once lose the light that would meet them again. It is given back (Lobes::compensated) to
// the lobes as they stand, so that their sampling stays what it is:
// - Interfaces that pass nothing on, or into a diffuse body: lobes are scaled by 1 + f0 (1 / E - 1), E the albedo of
//   perfectly reflecting microfacets under the view cosine (Turquin, "Practical multiple scattering compensation for
//   microfacet models", 2019). Metals keep all light at f0 = 1, and are more saturated with roughness below it.
// - Refracting interfaces: each microfacet that is seen sends on all of its light. Its reflected and transmitted
//   shares after masking are scaled to add up to 1; what it reflects down to the surface meets that again, and is
//   taken to come up mirrored at the plane of the surface.
// Without compensation lobes are reciprocal; with it the factors depend on the view alone.
#pragma once

#include <cmath>

#include "core/shade/bsdf.h"
#include "core/shade/fresnel.h"
#include "core/shade/microfacet.h"

namespace encore {

inline constexpr Vec3f kWhite{1, 1, 1};
inline constexpr Vec3f kCoatF0{0.04f, 0.04f, 0.04f};

// Shares of the light under one cosine; they add up to 1 but for what metals absorb, and for what microfacets
// lose where nothing gives it back.
struct Shares {
  Vec3f reflected, diffuse, transmitted;
};

// dielectric, schlick: what the two kinds of interface in the mix reflect.
inline Shares composeSolid(const Lobes& lobes, float dielectric, Vec3f schlick) {
  // Metals pass nothing: schlick - metallic is Schlick's share in the specular workflow, and 0 in the other.
  const Vec3f passed =
      kWhite * ((1 - lobes.schlick) * (1 - dielectric)) + (kWhite - schlick) * (lobes.schlick - lobes.metallic);
  return {kWhite * ((1 - lobes.schlick) * dielectric) + schlick * lobes.schlick, passed * lobes.opacity,
          passed * (1 - lobes.opacity)};
}
Shares composeThin(const Lobes& lobes, float dielectric, Vec3f schlick);
inline Shares compose(const Lobes& lobes, float dielectric, Vec3f schlick) {
  return lobes.thin ? composeThin(lobes, dielectric, schlick) : composeSolid(lobes, dielectric, schlick);
}

// What one smooth interface reflects.
inline float smoothDielectric(const Lobes& lobes, float cos_theta) {
  return lobes.schlick < 1 ? fresnelDielectric(cos_theta, lobes.eta) : 0;
}
inline Vec3f smoothSchlick(const Lobes& lobes, float cos_theta) {
  if (!(lobes.schlick > 0)) return {};
  return fresnelSchlick(refractedCosine(cos_theta, lobes.schlick_eta), lobes.f0);
}

inline bool interfaceReflects(const Lobes& lobes) { return lobes.schlick > 0 || lobes.eta != 1; }
// Rough, and bends what it transmits: reflection and transmission share microfacets.
inline bool refractsRough(const Lobes& lobes) {
  return lobes.refracts && !lobes.thin && lobes.alpha > 0 && lobes.eta != 1;
}

// A rough interface under one view cosine. shares: integrated, to about 0.01; those of a refracting one that leaves
// nothing to a diffuse body only serve as probabilities.
struct RoughInterface {
  Shares shares;
  RoughScales scales;
};
RoughInterface roughInterface(const Lobes& lobes, float cos_theta);
// Where refractsRough(lobes): shares as probabilities only, never 0 where something may happen.
RoughInterface likelyInterface(const Lobes& lobes, float cos_theta);
RoughScales refractingScales(const Lobes& lobes, float cos_theta);

// Of the whole interface seen under cos_theta.
inline Shares interfaceShares(const Lobes& lobes, float cos_theta) {
  if (lobes.alpha > 0) return roughInterface(lobes, cos_theta).shares;
  return compose(lobes, smoothDielectric(lobes, cos_theta), smoothSchlick(lobes, cos_theta));
}

// What one microfacet of an interface that does not refract reflects.
inline Vec3f facetReflectance(const Lobes& lobes, const RoughScales& scales, float cos_h) {
  return kWhite * ((1 - lobes.schlick) * smoothDielectric(lobes, cos_h) * scales.dielectric) +
         smoothSchlick(lobes, cos_h) * scales.schlick * lobes.schlick;
}

// What one visible microfacet of a refracting interface sends on, masking (G2 / G1) included.
struct FacetShares {
  Vec3f body, metal;  // reflected by what refracts, and by the metal in the mix
  Vec3f transmitted;  // into the solid, whatever its opacity

  Vec3f reflected() const { return body + metal; }
};
// wo, h: local. Where the reflected direction wi lies below the surface, body is what leaves to its mirror image.
FacetShares facetShares(const Lobes& lobes, const RoughScales& scales, Vec3f wo, Vec3f h);
// Where reflection about h leaves to; false: nowhere.
inline bool leavesUpwards(const Lobes& lobes, Vec3f& wi) {
  if (wi.z < 0 && lobes.compensated && refractsRough(lobes)) wi.z = -wi.z;
  return wi.z > 0;
}
inline Vec3f below(Vec3f wi) { return {wi.x, wi.y, -wi.z}; }

// The direction refracted at a microfacet; false at total reflection.
inline bool refractAbout(Vec3f wo, Vec3f h, float eta, Vec3f& wi) {
  const float c = std::min(dot(wo, h), 1.0f), sin2_t = (1 - c * c) / (eta * eta);
  if (!(sin2_t < 1)) return false;
  wi = h * (c / eta - std::sqrt(1 - sin2_t)) - wo / eta;
  return wi.z < 0;
}

// The clearcoat: its share, and what its microfacets' reflectance is scaled by.
struct Coat {
  float share = 0, scale = 1;
};
Coat roughCoat(const Lobes& lobes, float cos_theta);
inline Coat coatOf(const Lobes& lobes, float cos_theta) {
  if (lobes.clearcoat == 0) return {};
  if (lobes.coat_alpha > 0) return roughCoat(lobes, cos_theta);
  return {lobes.clearcoat * fresnelSchlick(cos_theta, kCoatF0).x, 1};
}

// Width of the lobe that a rough sheet transmits, about the direction straight on. A microfacet normal that leans by
// a small angle turns a reflected ray by twice that; an interface turns what it refracts by (eta - 1) times that;
// the two interfaces of the sheet lean independently, which adds variances: sqrt(2) (eta - 1) against 2.
inline float sheetAlpha(const Lobes& lobes) {
  return std::min(lobes.alpha * std::abs(lobes.eta - 1) * 0.70710678f, 1.0f);
}
// What a lobe of this width has to be scaled by under this cosine, so that it keeps all light; 1 uncompensated.
float sheetScale(const Lobes& lobes, float cos_theta, float alpha);

}  // namespace encore
