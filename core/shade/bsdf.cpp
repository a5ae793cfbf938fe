#include "core/shade/bsdf.h"

#include <algorithm>
#include <cmath>

#include "core/shade/interface_albedo.h"
#include "core/shade/interface_shares.h"
#include "core/shade/microfacet.h"

namespace encore {
namespace {

// Evaluated lobes are never narrower: a texture may say 0 where the material as a whole is not traced.
constexpr float kMinEvaluatedAlpha = 1e-3f;

// Finite, whatever a texture says. Not clamped to 1: scenes may want it.
constexpr float kMaxAlbedo = 1e6f;

float average(Vec3f c) { return (c.x + c.y + c.z) / 3; }

// NaN is what a broken texture or network says: the specification's default stands in.
float orDefault(float x, float fallback) { return std::isnan(x) ? fallback : x; }

// Of the far side over the near one.
float relativeIor(float ior, float other, bool inside) {
  const float body = clampClean(orDefault(ior, 1.5f), 0.01f, 100), around = clampClean(orDefault(other, 1), 0.01f, 100);
  return clampClean(inside ? around / body : body / around, 0.01f, 100);
}

// A shader of the user's own may set what its source names: `word` is part of the input's name.
bool mayBeSet(const Material& m, const char* word) {
  return m.surface_shader && m.surface_shader->source.find(word) != std::string::npos;
}
template <class T>
bool isConstant(const Material& m, const Input<T>& input, const char* word) {
  return input.constant() && !mayBeSet(m, word);
}
bool mayExceed(const Material& m, const Input<float>& input, float value, const char* word) {
  return !isConstant(m, input, word) || input.value > value;
}

// The roughness that decides for the whole material, so that a texture makes no seam.
float largestRoughness(const Material& m, const Input<float>& input, float fallback, const char* word) {
  return isConstant(m, input, word) ? clampClean(orDefault(input.value, fallback), 0, 1) : 1.0f;
}
bool isTraced(float largest, float limit) { return largest <= limit || largest * largest < kSmoothAlpha; }
float largestSpecular(const Material& m) { return largestRoughness(m, m.roughness, 0.5f, "oughness"); }
float largestCoat(const Material& m) { return largestRoughness(m, m.clearcoat_roughness, 0.01f, "learcoat"); }
bool specularTraced(const Material& m, float limit) { return isTraced(largestSpecular(m), limit); }
bool coatTraced(const Material& m, float limit) { return isTraced(largestCoat(m), limit); }

bool hasInterface(const Material& m) {
  return m.use_specular_workflow || mayExceed(m, m.metallic, 0, "etallic") || !isConstant(m, m.ior, "ior") ||
         orDefault(m.ior.value, 1.5f) != 1;
}
bool hasCoat(const Material& m) { return mayExceed(m, m.clearcoat, 0, "learcoat"); }

float alphaOf(float roughness, bool traced) {
  const float r = clampClean(roughness, 0, 1), alpha = r * r;
  if (!traced) return std::max(alpha, kMinEvaluatedAlpha);
  return alpha < kSmoothAlpha ? 0 : alpha;
}

float viewCosine(float cos_theta) { return clampClean(cos_theta, kMinCosine, 1); }

// Chance of following the coat when both interfaces are candidates with these shares.
float coatProbability(float coat, float specular) { return coat + specular > 0 ? coat / (coat + specular) : 0; }

// One reflection off a rough interface about local wo; reflectance(cos) is what a microfacet reflects.
template <class Reflectance>
Bounce sampleRough(const Basis& basis, Vec3f wo, float alpha, const float u[4], Reflectance reflectance) {
  const Vec3f h = sampleVisibleNormal(wo, alpha, u[0], u[1]);
  const Vec3f wi = reflectAbout(wo, h);
  if (!(wi.z > 0)) return {};
  const float cos_h = std::min(dot(wo, h), 1.0f);
  return {normalize(basis.toWorld(wi)), reflectance(cos_h) * smithG2OverG1(wo.z, wi.z, alpha),
          normalize(basis.toWorld(h)), true};
}

// The same off an interface that refracts.
Bounce sampleRefracting(const Lobes& lobes, const RoughScales& scales, const Basis& basis, Vec3f wo, float share,
                        const float u[4]) {
  const Vec3f h = sampleVisibleNormal(wo, lobes.alpha, u[0], u[1]);
  Vec3f wi = reflectAbout(wo, h);
  if (!leavesUpwards(lobes, wi)) return {};
  return {normalize(basis.toWorld(wi)), facetShares(lobes, scales, wo, h).reflected() * share,
          normalize(basis.toWorld(normalize(wo + wi))), true};
}

RoughInterface interfaceOf(const Lobes& lobes, float cos_theta) {
  if (lobes.alpha > 0) return roughInterface(lobes, cos_theta);
  return {interfaceShares(lobes, cos_theta), {}};
}

// Through a sheet: straight, or about that direction where the sheet is rough.
Bounce sampleSheet(const Lobes& lobes, const Basis& basis, Vec3f wo, float under_coat, const float u[4]) {
  const Vec3f weight = interfaceShares(lobes, wo.z).transmitted * under_coat;
  if (!(maxComponent(weight) > 0)) return {};
  const float alpha = sheetAlpha(lobes);
  if (alpha < kSmoothAlpha) return {-normalize(basis.toWorld(wo)), weight, basis.n, true};
  const Vec3f h = sampleVisibleNormal(wo, alpha, u[0], u[1]);
  const Vec3f mirrored = reflectAbout(wo, h);
  if (!(mirrored.z > 0)) return {};
  const float kept = smithG2OverG1(wo.z, mirrored.z, alpha) * sheetScale(lobes, wo.z, alpha);
  return {normalize(basis.toWorld({mirrored.x, mirrored.y, -mirrored.z})), weight * kept, basis.n, true};
}

// wo in the basis of n, pushed above the horizon where rounding left it below.
Vec3f localView(const Basis& basis, Vec3f wo) {
  Vec3f local = basis.toLocal(wo);
  local.z = std::max(local.z, kMinCosine);
  return normalize(local);
}

}  // namespace

Lobes makeLobes(const Material& material, const PathInputs& inputs, const InterfaceView& view,
                const Settings& settings) {
  Lobes lobes;
  lobes.refracts = feedsRefraction(material);
  lobes.thin = view.thin && lobes.refracts;
  lobes.compensated = settings.energy_compensation;
  const bool inside = view.back && lobes.refracts && !lobes.thin;
  lobes.eta = relativeIor(inputs.ior, view.other_ior, inside);
  if (lobes.thin) lobes.eta = std::max(lobes.eta, 1 / lobes.eta);
  if (material.use_specular_workflow) {
    lobes.f0 = clampClean(inputs.specular_color, 1);
    lobes.schlick = 1;
    lobes.schlick_eta = lobes.refracts ? std::min(lobes.eta, 1.0f) : 1.0f;
  } else {
    lobes.metallic = clampClean(inputs.metallic, 0, 1);
    lobes.schlick = lobes.metallic;
    if (lobes.metallic > 0) lobes.f0 = clampClean(inputs.base_color, 1);
  }
  lobes.opacity = lobes.refracts ? clampClean(orDefault(inputs.opacity, 1), 0, 1) : 1;
  lobes.clearcoat = inside ? 0 : clampClean(inputs.clearcoat, 0, 1);
  lobes.specular_traced = specularTraced(material, settings.roughness_limit);
  lobes.coat_traced = coatTraced(material, settings.roughness_limit);
  lobes.alpha = alphaOf(orDefault(inputs.roughness, 0.5f), lobes.specular_traced);
  lobes.coat_alpha = alphaOf(orDefault(inputs.clearcoat_roughness, 0.01f), lobes.coat_traced);
  return lobes;
}

Vec3f straightTransmittance(const Lobes& lobes, float cos_theta) {
  const float c = viewCosine(std::abs(cos_theta));
  Lobes outside = lobes;
  outside.eta = std::max(lobes.eta, 1 / lobes.eta);
  outside.schlick_eta = 1;
  outside.refracts = false;  // nothing bends: tables will do
  return interfaceShares(outside, c).transmitted * (1 - coatOf(outside, c).share);
}

float presence(const Material& material, float opacity) {
  opacity = orDefault(opacity, 1);
  if (material.opacity_threshold > 0) return opacity >= material.opacity_threshold ? 1.0f : 0.0f;
  return material.opacity_mode == OpacityMode::Presence ? clampClean(opacity, 0, 1) : 1.0f;
}

bool transmitsShadows(const Material& material, const Settings& settings) {
  return settings.glass_shadows == GlassShadows::Transmit && feedsRefraction(material);
}
bool passesShadows(const Material& material, const Settings& settings) {
  return material.hasPresence() || transmitsShadows(material, settings);
}

bool feedsReflection(const Material& material, float roughness_limit) {
  return (hasInterface(material) && specularTraced(material, roughness_limit)) ||
         (hasCoat(material) && coatTraced(material, roughness_limit));
}

bool feedsRefraction(const Material& material) {
  if (material.opacity_threshold > 0 || material.opacity_mode == OpacityMode::Presence) return false;
  const bool only_metal = !material.use_specular_workflow && isConstant(material, material.metallic, "etallic") &&
                          material.metallic.value >= 1;
  const bool opaque = isConstant(material, material.opacity, "pacity") && orDefault(material.opacity.value, 1) >= 1;
  return !opaque && !only_metal;
}

bool viewWeightInShading(const Material& material, float roughness_limit, bool zero_extent_lights) {
  const auto evaluated = [&](float largest) {
    const bool traced = isTraced(largest, roughness_limit);
    // Traced, but wide enough to be evaluated under lights of zero extent.
    return !traced || (zero_extent_lights && largest * largest >= kSmoothAlpha);
  };
  const bool emits =
      !isConstant(material, material.emissive_color, "missive") || maxComponent(material.emissive_color.value) > 0;
  return emits || (hasInterface(material) && evaluated(largestSpecular(material))) ||
         (hasCoat(material) && evaluated(largestCoat(material)));
}

EffectWeights effectWeights(const Lobes& lobes, float cos_theta, bool view_weight_in_shading) {
  const float c = viewCosine(cos_theta);
  const float coat = coatOf(lobes, c).share;
  const Shares shares = interfaceShares(lobes, c);
  EffectWeights weights;
  if (lobes.coat_traced) weights.reflection += kWhite * coat;
  if (lobes.specular_traced) weights.reflection += shares.reflected * (1 - coat);
  weights.refraction = shares.transmitted * (1 - coat);
  weights.absorption = view_weight_in_shading ? kWhite : shares.diffuse * (1 - coat);
  return weights;
}

Bounce sampleReflection(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]) {
  const bool follow_coat = lobes.coat_traced && lobes.clearcoat > 0;
  const bool follow_specular = lobes.specular_traced && interfaceReflects(lobes);
  if (!follow_coat && !follow_specular) return {};
  const Basis basis(n);
  const Vec3f local = localView(basis, wo);
  const Coat coat = coatOf(lobes, local.z);
  const bool refracting = refractsRough(lobes);
  const RoughInterface interface = refracting ? likelyInterface(lobes, local.z) : interfaceOf(lobes, local.z);
  const Vec3f specular = interface.shares.reflected * (1 - coat.share);
  const float p = coatProbability(follow_coat ? coat.share : 0, follow_specular ? average(specular) : 0);

  // Two smooth interfaces reflect into the same direction: no choice is needed.
  const bool smooth_coat = follow_coat && lobes.coat_alpha == 0;
  const bool smooth_specular = follow_specular && lobes.alpha == 0;
  const Vec3f mirrored = normalize(n * (2 * dot(n, wo)) - wo);
  if ((smooth_coat || !follow_coat) && (smooth_specular || !follow_specular)) {
    Vec3f weight;
    if (follow_coat) weight += kWhite * coat.share;
    if (follow_specular) weight += specular;
    return {mirrored, weight, n, true};
  }
  if (u[2] < p) {
    if (smooth_coat) return {mirrored, kWhite * (coat.share / p), n, true};
    const float scale = lobes.clearcoat * coat.scale / p;
    return sampleRough(basis, local, lobes.coat_alpha, u, [&](float c) { return fresnelSchlick(c, kCoatF0) * scale; });
  }
  if (smooth_specular) return {mirrored, specular / (1 - p), n, true};
  const float share = (1 - coat.share) / (1 - p);
  if (refracting) return sampleRefracting(lobes, interface.scales, basis, local, share, u);
  return sampleRough(basis, local, lobes.alpha, u,
                     [&](float c) { return facetReflectance(lobes, interface.scales, c) * share; });
}

Bounce sampleRefraction(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]) {
  const Basis basis(n);
  const Vec3f local = localView(basis, wo);
  const float under_coat = 1 - coatOf(lobes, local.z).share;
  if (lobes.thin) return sampleSheet(lobes, basis, local, under_coat, u);
  // Without a change of index nothing bends, however rough.
  if (lobes.eta == 1) {
    const Vec3f weight = interfaceShares(lobes, local.z).transmitted * under_coat;
    return {-wo, weight, n, maxComponent(weight) > 0};
  }
  const float share = under_coat * (1 - lobes.opacity);
  if (!(share > 0)) return {};
  const bool rough = lobes.alpha > 0;
  const Vec3f h = rough ? sampleVisibleNormal(local, lobes.alpha, u[0], u[1]) : Vec3f{0, 0, 1};
  Vec3f wi;
  if (!refractAbout(local, h, lobes.eta, wi)) return {};
  const Vec3f weight = rough ? facetShares(lobes, {}, local, h).transmitted * share
                             : interfaceShares(lobes, local.z).transmitted * under_coat;
  return {normalize(basis.toWorld(wi)), weight, rough ? normalize(basis.toWorld(h)) : n, true};
}

ShadedView::ShadedView(const Lobes& lobes, Vec3f diffuse_color, Vec3f n, Vec3f wo, bool view_weight_in_shading)
    : lobes_(lobes), basis_(n), wo_(localView(basis_, wo)), diffuse_(clampClean(diffuse_color, kMaxAlbedo)) {
  const Coat coat = coatOf(lobes, wo_.z);
  const RoughInterface interface = interfaceOf(lobes, wo_.z);
  scales_ = interface.scales;
  coat_scale_ = coat.scale;
  under_coat_ = 1 - coat.share;
  if (view_weight_in_shading) diffuse_ *= interface.shares.diffuse * under_coat_;
  rough_specular_ = !lobes.specular_traced && interfaceReflects(lobes);
  rough_coat_ = !lobes.coat_traced && lobes.clearcoat > 0;
  const float specular = rough_specular_ ? average(interface.shares.reflected) * under_coat_ : 0;
  coat_probability_ = coatProbability(rough_coat_ ? coat.share : 0, specular);
}

ShadedResponse ShadedView::evaluate(Vec3f wi, bool include_traced) const {
  const Vec3f i = basis_.toLocal(wi);
  ShadedResponse response;
  if (!(i.z > 0)) return response;
  response.diffuse = diffuse_ * (i.z * kInvPi);
  const bool specular = rough_specular_ || (include_traced && lobes_.specular_traced && lobes_.alpha > 0);
  const bool coat =
      lobes_.clearcoat > 0 && (rough_coat_ || (include_traced && lobes_.coat_traced && lobes_.coat_alpha > 0));
  if (!specular && !coat) return response;
  const Vec3f h = normalize(i + wo_);
  const float cos_h = std::min(dot(wo_, h), 1.0f);
  if (specular) response.specular += interfaceResponse(i, h, cos_h) * under_coat_;
  if (coat)
    response.specular += fresnelSchlick(cos_h, kCoatF0) *
                         (lobes_.clearcoat * coat_scale_ * ggxReflection(h, wo_.z, i.z, lobes_.coat_alpha));
  return response;
}

Vec3f ShadedView::interfaceResponse(Vec3f i, Vec3f h, float cos_h) const {
  if (!refractsRough(lobes_))
    return facetReflectance(lobes_, scales_, cos_h) * ggxReflection(h, wo_.z, i.z, lobes_.alpha);
  const auto about = [&](Vec3f normal) {
    return facetShares(lobes_, scales_, wo_, normal).reflected() * ggxReflectionPdf(normal, wo_.z, lobes_.alpha);
  };
  Vec3f response = about(h);
  // What comes up again leaves to the same direction.
  const Vec3f h_below = normalize(below(i) + wo_);
  if (lobes_.compensated && h_below.z > 0) response += about(h_below);
  return response;
}

Vec3f ShadedView::sampleRoughLobe(const float u[3]) const {
  if (!hasRoughLobe()) return {};
  const bool coat = u[2] < coat_probability_;
  Vec3f wi = reflectAbout(wo_, sampleVisibleNormal(wo_, coat ? lobes_.coat_alpha : lobes_.alpha, u[0], u[1]));
  if (!(coat ? wi.z > 0 : leavesUpwards(lobes_, wi))) return {};
  return normalize(basis_.toWorld(wi));
}

float ShadedView::pdfRoughLobe(Vec3f wi) const {
  const Vec3f i = basis_.toLocal(wi);
  if (!hasRoughLobe() || !(i.z > 0)) return 0;
  const Vec3f h = normalize(i + wo_);
  float pdf = 0;
  if (coat_probability_ > 0) pdf += coat_probability_ * ggxReflectionPdf(h, wo_.z, lobes_.coat_alpha);
  if (coat_probability_ < 1) {
    pdf += (1 - coat_probability_) * ggxReflectionPdf(h, wo_.z, lobes_.alpha);
    const Vec3f h_below = normalize(below(i) + wo_);
    if (lobes_.compensated && refractsRough(lobes_) && h_below.z > 0)
      pdf += (1 - coat_probability_) * ggxReflectionPdf(h_below, wo_.z, lobes_.alpha);
  }
  return pdf;
}

ShadedResponse evaluateShaded(const Lobes& lobes, Vec3f diffuse_color, Vec3f n, Vec3f wo, Vec3f wi,
                              bool view_weight_in_shading, bool include_traced) {
  return ShadedView(lobes, diffuse_color, n, wo, view_weight_in_shading).evaluate(wi, include_traced);
}
Vec3f sampleRoughLobe(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[3]) {
  return ShadedView(lobes, {}, n, wo, false).sampleRoughLobe(u);
}
float pdfRoughLobe(const Lobes& lobes, Vec3f n, Vec3f wo, Vec3f wi) {
  return ShadedView(lobes, {}, n, wo, false).pdfRoughLobe(wi);
}
bool hasRoughLobe(const Lobes& lobes) {
  return (!lobes.specular_traced && interfaceReflects(lobes)) || (!lobes.coat_traced && lobes.clearcoat > 0);
}

}  // namespace encore
