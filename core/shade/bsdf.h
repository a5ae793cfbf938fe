// The lobes of UsdPreviewSurface: a clearcoat over a specular interface over transmission and diffuse.
// Each interface reflects its Fresnel share and passes the rest down, so that energy never grows.
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
  float eta = 1.5f;       // ior on the far side over ior on the near side of the interface
  float alpha = 0.25f;    // GGX width, roughness²; 0: smooth
  float clearcoat = 0;
  float coat_alpha = 0;
  float opacity = 1;      // of what lies under the interface; the rest transmits
  float metallic = 0;
  bool specular_traced = true;  // else evaluated inside shading
  bool coat_traced = true;
};

// Fresnel reflectance of a dielectric for unpolarised light, exact. eta: far over near. 1 at total reflection.
float fresnelDielectric(float cos_theta, float eta);
Vec3f fresnelSchlick(float cos_theta, Vec3f f0);

// back: the hit is on the inside of the surface, where the interface is seen from the denser medium.
Lobes makeLobes(const Material& material, const PathInputs& inputs, bool back, float roughness_limit);

// Does any material input let light into this layer? Decides which layers exist.
bool feedsReflection(const Material& material, float roughness_limit);
bool feedsRefraction(const Material& material);
// True where shading multiplies its view-dependent weights itself, because a rough lobe or emission is
// evaluated beside the diffuse one; else they are throughput, at antialiasing rate. Per material, no seams.
bool viewWeightInShading(const Material& material, float roughness_limit);

// Exact shares of the three first-bounce effects for a view cosine; they add up to at most 1.
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
  Vec3f half_vector;     // the microfacet normal: n where smooth
  bool valid = false;
};
// wo: unit, away from the surface, dot(wo, n) > 0. u: four numbers in [0, 1).
Bounce sampleReflection(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]);
Bounce sampleRefraction(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]);

// Radiance factor f(wo, wi) · dot(n, wi) of everything that is evaluated inside shading.
struct ShadedResponse {
  Vec3f diffuse, specular;
};
ShadedResponse evaluateShaded(const Lobes& lobes, Vec3f diffuse_color, Vec3f n, Vec3f wo, Vec3f wi,
                              bool view_weight_in_shading, bool include_traced);
// Sampling of the rough evaluated lobes for MIS; pdf 0: there are none.
Vec3f sampleRoughLobe(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[3]);
float pdfRoughLobe(const Lobes& lobes, Vec3f n, Vec3f wo, Vec3f wi);
bool hasRoughLobe(const Lobes& lobes);

}  // namespace encore
