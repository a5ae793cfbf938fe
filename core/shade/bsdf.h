// The lobes of UsdPreviewSurface: a clearcoat over a specular interface over transmission and diffuse.
// Each interface reflects its share and passes the rest down, so that energy never grows.
//
// Opacity (UsdPreviewSurface 2.6), by material:
// - opacityThreshold above 0: a cut-out. Below the threshold the surface is not there, else it is opaque.
// - opacityMode presence: the whole surface, its lobes included, is there with the share opacity.
// - opacityMode transparent: a body. opacity scales what is diffuse in it; the rest of what passes the interface
//   transmits; the interface and the clearcoat stay. Metals transmit nothing, metallic in between its share of it.
//   Solid: light is bent by ior, and inside of it meets the interface from the denser side, without the clearcoat.
//   Thin: two parallel interfaces, see below. Materials that cannot transmit look the same from both sides.
//
// Choices where the specification leaves them open:
// - The metallic workflow mixes two surfaces: a metal (Schlick, f0 = diffuseColor) and a dielectric (exact
//   Fresnel of ior) over diffuse or transmission. The specular workflow is Schlick with f0 = specularColor.
// - Where solids touch or overlap, the dielectric's indices are relative to InterfaceView::other_ior, and equal ones
//   leave no interface; specularColor is what it is.
// - A sheet reflects what two interfaces reflect among each other and transmits straight on, less (1 - opacity) for
//   each pass of the body: smooth, R + T² t² R / (1 - R² t²) and T² t / (1 - R² t²) with t = 1 - opacity; what is
//   left goes to the diffuse body. It is alike from both sides, with the clearcoat, and never reflects totally: an
//   index below that of its surroundings counts as its inverse. Rough sheets do the same with albedos; what they
//   transmit spreads about the direction straight on as a reflecting lobe of less width (interface_shares.h).
// - Radiance is not scaled by eta² where it refracts: every path enters and leaves closed solids, the factors
//   cancel, and what ends inside keeps the brightness that compositors expect.
// - Layers below a rough interface get 1 minus its directional albedo at the view cosine
//   (interface_albedo.h); below a smooth one this is exact Fresnel transmittance.
// - What microfacets reflect among each other is given back (Settings::energy_compensation, interface_shares.h): a
//   white furnace keeps 0.99 to 1.01 of its light, whatever the roughness. Without it smooth surfaces still keep all;
//   glass of roughness 0.5 loses up to 29 % at some angles, metals of roughness 1 up to 69 % at grazing ones.
// - Numbers out of range are clamped. NaN is black where it is a colour, else the specification's default.
// - A shader of the user's own may set every input that its source names, so that it counts as varying.
#pragma once

#include "core/scene/material.h"
#include "core/scene/math.h"
#include "core/scene/settings.h"
#include "core/shade/fresnel.h"
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
  bool refracts = false;    // the material may transmit, whatever opacity is here
  bool thin = false;        // ... straight on, through a sheet
  bool compensated = true;  // Settings::energy_compensation

  float bendEta() const { return thin ? 1 : eta; }  // for ray differentials of what is transmitted
};

// Factors on what microfacets reflect and transmit under one view cosine: what they lose among each other is given
// back, and sheets reflect twice. 1 where smooth.
struct RoughScales {
  float dielectric = 1;
  Vec3f schlick{1, 1, 1};
};

// How an interface is met.
struct InterfaceView {
  bool back = false;    // on the inside of the surface, where the interface is seen from the denser medium
  bool thin = false;    // of a transparent material: a sheet (two parallel interfaces) that is passed straight
  float other_ior = 1;  // of the medium on the outside: not 1 where solids touch or overlap
};
Lobes makeLobes(const Material& material, const PathInputs& inputs, const InterfaceView& view,
                const Settings& settings);

// Share of light that passes straight through the surface on its way to a light (Settings::glass_shadows), for a
// direction with this cosine to the normal. A solid is seen from outside on both of its sides, so that nothing is
// reflected totally. presence is not looked at: that is opacity's, for cut-outs and presence alike.
Vec3f straightTransmittance(const Lobes& lobes, float cos_theta);
// 1 - what of light and paths passes a surface with presence or cut-out as if it were not there.
float presence(const Material& material, float opacity);
// Shadow rays have to ask what the material lets through.
bool passesShadows(const Material& material, const Settings& settings);
// Straight transmittance of the material is not 0 where it is present: glass under GlassShadows::Transmit.
bool transmitsShadows(const Material& material, const Settings& settings);

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
  // Of the specular interface towards local i, h between it and wo_; the coat's share not taken.
  Vec3f interfaceResponse(Vec3f i, Vec3f h, float cos_h) const;

  Lobes lobes_;
  Basis basis_;
  Vec3f wo_;  // local
  Vec3f diffuse_;
  RoughScales scales_;
  float coat_scale_ = 1;
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
