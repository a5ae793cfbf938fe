// The lobes of UsdPreviewSurface: a clearcoat over a specular interface over transmission and diffuse.
// Each interface reflects its share and passes the rest down, so that energy never grows.
//
// Choices where UsdPreviewSurface 2.6 leaves them open:
// - The metallic workflow mixes two surfaces: a metal (Schlick, f0 = diffuseColor) and a dielectric (exact
//   Fresnel of ior) over diffuse or transmission. The specular workflow is Schlick with f0 = specularColor.
// - opacity < 1 without opacityThreshold is a solid that refracts by ior; 1 - opacity of what passes the
//   interface transmits. Inside of it light meets the interface from the denser side, without the clearcoat.
//   Materials that cannot refract look the same from both sides.
// - Radiance is not scaled by eta² where it refracts: every path enters and leaves closed solids, the factors
//   cancel, and what ends inside keeps the brightness that compositors expect.
// - Layers below a rough interface get 1 minus its directional albedo at the view cosine
//   (interface_albedo.h); below a smooth one this is exact Fresnel transmittance.
// - Microfacets scatter once. Light that would meet them again is lost: nothing of smooth surfaces, for glass
//   of roughness 0.3 up to 3 % and of 0.5 up to 17 % at 60 degrees. Diffuse layers get it back (see above).
#pragma once

#include "core/scene/material.h"
#include "core/scene/math.h"
#include "core/scene/settings.h"
#include "shaders/records.h"

namespace encore {

// A material's path inputs at one hit, prepared for evaluation. cos values are clamped to (0, 1].
struct Lobes {
  Vec3f f0;               // Schlick base reflectance: metals, and the specular workflow
  float schlick = 0;      // share of Schlick's formula in the interface; the rest is the exact dielectric
  float schlick_eta = 1;  // below 1: Schlick's formula is seen from the denser side of a solid
  float eta = 1.5f;       // ior on the far side over ior on the near side of the interface
  float alpha = 0.25f;    // GGX width, roughness²; 0: smooth
  float clearcoat = 0;
  float coat_alpha = 0;
  float opacity = 1;  // of what lies under the interface; the rest transmits
  float metallic = 0;
  bool specular_traced = true;  // else evaluated inside shading
  bool coat_traced = true;
};

// Fresnel reflectance of a dielectric for unpolarised light, exact. eta: far over near. 1 at total reflection.
float fresnelDielectric(float cos_theta, float eta);
Vec3f fresnelSchlick(float cos_theta, Vec3f f0);
// Cosine beyond the interface where eta < 1, 0 at total reflection; cos_theta itself otherwise.
float refractedCosine(float cos_theta, float eta);

// back: the hit is on the inside of the surface, where the interface is seen from the denser medium.
Lobes makeLobes(const Material& material, const PathInputs& inputs, bool back, float roughness_limit);

// Does any material input let light into this layer? Decides which layers exist.
bool feedsReflection(const Material& material, float roughness_limit);
bool feedsRefraction(const Material& material);
// True where shading multiplies its view-dependent weights itself, because a rough lobe or emission is
// evaluated beside the diffuse one; else they are throughput, at antialiasing rate. Per material, no seams.
// zero_extent_lights: anyDelta(scene.lights); traced rough lobes are evaluated under such lights.
bool viewWeightInShading(const Material& material, float roughness_limit, bool zero_extent_lights);

// Shares of the three first-bounce effects for a view cosine; they add up to at most 1. Exact where smooth.
struct EffectWeights {
  Vec3f reflection;  // traced interfaces
  Vec3f refraction;
  Vec3f absorption;  // what reaches the diffuse lobe (1 where viewWeightInShading)
};
EffectWeights effectWeights(const Lobes& lobes, float cos_theta, bool view_weight_in_shading);

// A sampled traced bounce: direction and weight (f · cos / pdf, shares included).
struct Bounce {
  Vec3f direction;
  Vec3f weight;
  Vec3f half_vector;  // the microfacet normal: n where smooth
  bool valid = false;
};
// wo: unit, away from the surface, dot(wo, n) > 0. u: four numbers in [0, 1).
Bounce sampleReflection(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]);
Bounce sampleRefraction(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]);

// Radiance factor f(wo, wi) · dot(n, wi) of everything that is evaluated inside shading.
struct ShadedResponse {
  Vec3f diffuse, specular;
};
// What shading evaluates at one point seen from one direction: prepared once, asked for every light direction.
class ShadedView {
 public:
  ShadedView(const Lobes& lobes, Vec3f diffuse_color, Vec3f n, Vec3f wo, bool view_weight_in_shading);

  // include_traced: with the rough lobes that are traced (for lights of zero extent, which no ray can hit).
  ShadedResponse evaluate(Vec3f wi, bool include_traced) const;
  // Sampling of the rough evaluated lobes for MIS.
  bool hasRoughLobe() const { return rough_specular_ || rough_coat_; }
  Vec3f sampleRoughLobe(const float u[3]) const;  // zero: the sample carries nothing
  float pdfRoughLobe(Vec3f wi) const;             // per solid angle
  Vec3f diffuse() const { return diffuse_; }      // albedo after the shares that belong to shading

 private:
  Lobes lobes_;
  Basis basis_;
  Vec3f wo_;  // local
  Vec3f diffuse_;
  float under_coat_;  // share that passes the clearcoat
  float coat_probability_;
  bool rough_specular_, rough_coat_;
};
// The same for one direction.
ShadedResponse evaluateShaded(const Lobes& lobes, Vec3f diffuse_color, Vec3f n, Vec3f wo, Vec3f wi,
                              bool view_weight_in_shading, bool include_traced);
Vec3f sampleRoughLobe(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[3]);
float pdfRoughLobe(const Lobes& lobes, Vec3f n, Vec3f wo, Vec3f wi);
bool hasRoughLobe(const Lobes& lobes);

}  // namespace encore
