#include "core/shade/bsdf.h"

#include <algorithm>
#include <cmath>

#include "core/shade/interface_albedo.h"
#include "core/shade/microfacet.h"

namespace encore {
namespace {

constexpr Vec3f kWhite{1, 1, 1};
constexpr Vec3f kCoatF0{0.04f, 0.04f, 0.04f};
// Evaluated lobes are never narrower: a texture may say 0 where the material as a whole is not traced.
constexpr float kMinEvaluatedAlpha = 1e-3f;

// Finite, whatever a texture says. Not clamped to 1: scenes may want it.
constexpr float kMaxAlbedo = 1e6f;

// Not a number becomes low.
float clean(float x, float low, float high) { return x > low ? std::min(x, high) : low; }
Vec3f clean(Vec3f c, float high) { return {clean(c.x, 0, high), clean(c.y, 0, high), clean(c.z, 0, high)}; }
float average(Vec3f c) { return (c.x + c.y + c.z) / 3; }

// The roughness that decides for the whole material, so that a texture makes no seam.
float largest(const Input<float>& input) { return input.constant() ? clean(input.value, 0, 1) : 1.0f; }
bool isTraced(const Input<float>& roughness, float limit) {
  const float r = largest(roughness);
  return r <= limit || r * r < kSmoothAlpha;
}
bool mayExceed(const Input<float>& input, float value) { return !input.constant() || input.value > value; }

bool hasInterface(const Material& m) {
  return m.use_specular_workflow || mayExceed(m.metallic, 0) || !m.ior.constant() || m.ior.value != 1;
}
bool hasCoat(const Material& m) { return mayExceed(m.clearcoat, 0); }

// Traced, but wide enough to be evaluated under lights of zero extent.
bool isTracedRough(const Input<float>& roughness, float limit) {
  const float r = largest(roughness);
  return isTraced(roughness, limit) && r * r >= kSmoothAlpha;
}

float alphaOf(float roughness, bool traced) {
  const float r = clean(roughness, 0, 1), alpha = r * r;
  if (!traced) return std::max(alpha, kMinEvaluatedAlpha);
  return alpha < kSmoothAlpha ? 0 : alpha;
}

float viewCosine(float cos_theta) { return clean(cos_theta, kMinCosine, 1); }

// What an interface does with light: reflects it, or passes it to the layers below.
struct Shares {
  Vec3f reflected, passed;
};
Shares compose(const Lobes& lobes, float dielectric, Vec3f schlick) {
  // Metals pass nothing: schlick - metallic is Schlick's share in the specular workflow, and 0 in the other.
  return {kWhite * ((1 - lobes.schlick) * dielectric) + schlick * lobes.schlick,
          kWhite * ((1 - lobes.schlick) * (1 - dielectric)) + (kWhite - schlick) * (lobes.schlick - lobes.metallic)};
}
// At one microfacet.
Shares facetShares(const Lobes& lobes, float cos_theta) {
  const float dielectric = lobes.schlick < 1 ? fresnelDielectric(cos_theta, lobes.eta) : 0;
  Vec3f schlick;
  if (lobes.schlick > 0) schlick = fresnelSchlick(refractedCosine(cos_theta, lobes.schlick_eta), lobes.f0);
  return compose(lobes, dielectric, schlick);
}
// Of the whole interface seen under cos_theta.
Shares interfaceShares(const Lobes& lobes, float cos_theta) {
  if (lobes.alpha == 0) return facetShares(lobes, cos_theta);
  const float dielectric = lobes.schlick < 1 ? dielectricAlbedo(cos_theta, lobes.alpha, lobes.eta) : 0;
  Vec3f schlick;
  if (lobes.schlick > 0) schlick = schlickAlbedo(cos_theta, lobes.alpha, lobes.f0, lobes.schlick_eta);
  return compose(lobes, dielectric, schlick);
}
float coatShare(const Lobes& lobes, float cos_theta) {
  if (lobes.clearcoat == 0) return 0;
  const Vec3f share = lobes.coat_alpha == 0 ? fresnelSchlick(cos_theta, kCoatF0)
                                            : schlickAlbedo(cos_theta, lobes.coat_alpha, kCoatF0, 1);
  return lobes.clearcoat * share.x;
}

bool interfaceReflects(const Lobes& lobes) { return lobes.schlick > 0 || lobes.eta != 1; }

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

// wo in the basis of n, pushed above the horizon where rounding left it below.
Vec3f localView(const Basis& basis, Vec3f wo) {
  Vec3f local = basis.toLocal(wo);
  local.z = std::max(local.z, kMinCosine);
  return normalize(local);
}

}  // namespace

float fresnelDielectric(float cos_theta, float eta) {
  if (eta == 1) return 0;
  const float c = clean(cos_theta, 0, 1);
  const float sin2_t = (1 - c * c) / (eta * eta);
  if (sin2_t >= 1) return 1;
  const float cos_t = std::sqrt(1 - sin2_t);
  const float s = (c - eta * cos_t) / (c + eta * cos_t), p = (eta * c - cos_t) / (eta * c + cos_t);
  return 0.5f * (s * s + p * p);
}

Vec3f fresnelSchlick(float cos_theta, Vec3f f0) {
  const float m = 1 - clean(cos_theta, 0, 1), m2 = m * m;
  return f0 + (kWhite - f0) * (m2 * m2 * m);
}

float refractedCosine(float cos_theta, float eta) {
  if (eta >= 1) return cos_theta;
  return std::sqrt(std::max(0.0f, 1 - (1 - cos_theta * cos_theta) / (eta * eta)));
}

Lobes makeLobes(const Material& material, const PathInputs& inputs, bool back, float roughness_limit) {
  const bool refracts = feedsRefraction(material);
  const bool inside = back && refracts;
  const float ior = clean(inputs.ior, 0.01f, 100);
  Lobes lobes;
  lobes.eta = inside ? 1 / ior : ior;
  if (material.use_specular_workflow) {
    lobes.f0 = clean(inputs.specular_color, 1);
    lobes.schlick = 1;
    lobes.schlick_eta = refracts ? std::min(lobes.eta, 1.0f) : 1.0f;
  } else {
    lobes.metallic = clean(inputs.metallic, 0, 1);
    lobes.schlick = lobes.metallic;
    if (lobes.metallic > 0) lobes.f0 = clean(inputs.base_color, 1);
  }
  lobes.opacity = refracts ? clean(inputs.opacity, 0, 1) : 1;
  lobes.clearcoat = inside ? 0 : clean(inputs.clearcoat, 0, 1);
  lobes.specular_traced = isTraced(material.roughness, roughness_limit);
  lobes.coat_traced = isTraced(material.clearcoat_roughness, roughness_limit);
  lobes.alpha = alphaOf(inputs.roughness, lobes.specular_traced);
  lobes.coat_alpha = alphaOf(inputs.clearcoat_roughness, lobes.coat_traced);
  return lobes;
}

bool feedsReflection(const Material& material, float roughness_limit) {
  return (hasInterface(material) && isTraced(material.roughness, roughness_limit)) ||
         (hasCoat(material) && isTraced(material.clearcoat_roughness, roughness_limit));
}

bool feedsRefraction(const Material& material) {
  const bool only_metal =
      !material.use_specular_workflow && material.metallic.constant() && material.metallic.value >= 1;
  const bool opaque = material.opacity.constant() && material.opacity.value >= 1;
  return !(material.opacity_threshold > 0) && !opaque && !only_metal;
}

bool viewWeightInShading(const Material& material, float roughness_limit, bool zero_extent_lights) {
  const auto evaluated = [&](const Input<float>& roughness) {
    return !isTraced(roughness, roughness_limit) || (zero_extent_lights && isTracedRough(roughness, roughness_limit));
  };
  const bool emits = !material.emissive_color.constant() || maxComponent(material.emissive_color.value) > 0;
  return emits || (hasInterface(material) && evaluated(material.roughness)) ||
         (hasCoat(material) && evaluated(material.clearcoat_roughness));
}

EffectWeights effectWeights(const Lobes& lobes, float cos_theta, bool view_weight_in_shading) {
  const float c = viewCosine(cos_theta);
  const float coat = coatShare(lobes, c);
  const Shares shares = interfaceShares(lobes, c);
  EffectWeights weights;
  if (lobes.coat_traced) weights.reflection += kWhite * coat;
  if (lobes.specular_traced) weights.reflection += shares.reflected * (1 - coat);
  weights.refraction = shares.passed * ((1 - coat) * (1 - lobes.opacity));
  weights.absorption = view_weight_in_shading ? kWhite : shares.passed * ((1 - coat) * lobes.opacity);
  return weights;
}

Bounce sampleReflection(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]) {
  const Basis basis(n);
  const Vec3f local = localView(basis, wo);
  const float coat = coatShare(lobes, local.z);
  const Vec3f specular = interfaceShares(lobes, local.z).reflected * (1 - coat);
  const bool follow_coat = lobes.coat_traced && lobes.clearcoat > 0;
  const bool follow_specular = lobes.specular_traced && interfaceReflects(lobes);
  const float p = coatProbability(follow_coat ? coat : 0, follow_specular ? average(specular) : 0);
  if (!follow_coat && !follow_specular) return {};

  // Two smooth interfaces reflect into the same direction: no choice is needed.
  const bool smooth_coat = follow_coat && lobes.coat_alpha == 0;
  const bool smooth_specular = follow_specular && lobes.alpha == 0;
  const Vec3f mirrored = normalize(n * (2 * dot(n, wo)) - wo);
  if ((smooth_coat || !follow_coat) && (smooth_specular || !follow_specular)) {
    Vec3f weight;
    if (follow_coat) weight += kWhite * coat;
    if (follow_specular) weight += specular;
    return {mirrored, weight, n, true};
  }
  if (u[2] < p) {
    if (smooth_coat) return {mirrored, kWhite * (coat / p), n, true};
    return sampleRough(basis, local, lobes.coat_alpha, u,
                       [&](float c) { return fresnelSchlick(c, kCoatF0) * (lobes.clearcoat / p); });
  }
  if (smooth_specular) return {mirrored, specular / (1 - p), n, true};
  return sampleRough(basis, local, lobes.alpha, u,
                     [&](float c) { return facetShares(lobes, c).reflected * ((1 - coat) / (1 - p)); });
}

Bounce sampleRefraction(const Lobes& lobes, Vec3f n, Vec3f wo, const float u[4]) {
  const Basis basis(n);
  const Vec3f local = localView(basis, wo);
  const float share = (1 - coatShare(lobes, local.z)) * (1 - lobes.opacity);
  // Without a change of index nothing bends, however rough.
  if (lobes.eta == 1) return {-wo, interfaceShares(lobes, local.z).passed * share, n, share > 0};

  Vec3f h{0, 0, 1};
  if (lobes.alpha > 0) h = sampleVisibleNormal(local, lobes.alpha, u[0], u[1]);
  const float c = std::min(dot(local, h), 1.0f);
  const float sin2_t = (1 - c * c) / (lobes.eta * lobes.eta);
  if (!(sin2_t < 1) || !(share > 0)) return {};  // total reflection
  const Vec3f wi = h * (c / lobes.eta - std::sqrt(1 - sin2_t)) - local / lobes.eta;
  if (!(wi.z < 0)) return {};
  Vec3f weight = facetShares(lobes, c).passed * share;
  if (lobes.alpha > 0) weight *= smithG2OverG1(local.z, -wi.z, lobes.alpha);
  return {normalize(basis.toWorld(wi)), weight, lobes.alpha > 0 ? normalize(basis.toWorld(h)) : n, true};
}

ShadedView::ShadedView(const Lobes& lobes, Vec3f diffuse_color, Vec3f n, Vec3f wo, bool view_weight_in_shading)
    : lobes_(lobes), basis_(n), wo_(localView(basis_, wo)), diffuse_(clean(diffuse_color, kMaxAlbedo)) {
  const float coat = coatShare(lobes, wo_.z);
  const Shares shares = interfaceShares(lobes, wo_.z);
  under_coat_ = 1 - coat;
  if (view_weight_in_shading) diffuse_ *= shares.passed * (under_coat_ * lobes.opacity);
  rough_specular_ = !lobes.specular_traced && interfaceReflects(lobes);
  rough_coat_ = !lobes.coat_traced && lobes.clearcoat > 0;
  coat_probability_ =
      coatProbability(rough_coat_ ? coat : 0, rough_specular_ ? average(shares.reflected) * under_coat_ : 0);
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
  if (specular)
    response.specular +=
        facetShares(lobes_, cos_h).reflected * (under_coat_ * ggxReflection(h, wo_.z, i.z, lobes_.alpha));
  if (coat)
    response.specular +=
        fresnelSchlick(cos_h, kCoatF0) * (lobes_.clearcoat * ggxReflection(h, wo_.z, i.z, lobes_.coat_alpha));
  return response;
}

Vec3f ShadedView::sampleRoughLobe(const float u[3]) const {
  if (!hasRoughLobe()) return {};
  const float alpha = u[2] < coat_probability_ ? lobes_.coat_alpha : lobes_.alpha;
  const Vec3f wi = reflectAbout(wo_, sampleVisibleNormal(wo_, alpha, u[0], u[1]));
  return wi.z > 0 ? normalize(basis_.toWorld(wi)) : Vec3f{};
}

float ShadedView::pdfRoughLobe(Vec3f wi) const {
  const Vec3f i = basis_.toLocal(wi);
  if (!hasRoughLobe() || !(i.z > 0)) return 0;
  const Vec3f h = normalize(i + wo_);
  float pdf = 0;
  if (coat_probability_ > 0) pdf += coat_probability_ * ggxReflectionPdf(h, wo_.z, lobes_.coat_alpha);
  if (coat_probability_ < 1) pdf += (1 - coat_probability_) * ggxReflectionPdf(h, wo_.z, lobes_.alpha);
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
