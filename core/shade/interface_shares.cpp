#include "core/shade/interface_shares.h"

#include <algorithm>
#include <array>

#include "core/shade/interface_albedo.h"

namespace encore {
namespace {

// Normals of the quadrature over visible microfacets: consecutive Fibonacci numbers. Seen from the denser side total
// reflection makes a kink, which wants more.
struct Lattice {
  int normals, step;
};
constexpr Lattice kOutside{34, 21}, kInside{233, 144};
// Reflection and transmission are each followed with at least this probability.
constexpr float kLeastLikely = 0.05f;

// add(wo, h, weight) for the lattice's visible normals.
template <class Add>
void integrateNormals(Lattice lattice, float cos_theta, float alpha, Add add) {
  const Vec3f wo{std::sqrt(1 - cos_theta * cos_theta), 0, cos_theta};
  const float weight = 1 / float(lattice.normals);
  for (int i = 0; i < lattice.normals; ++i) {
    // Half a turn is enough: see facetWeights() in interface_albedo.cpp.
    const float u0 = 0.5f * (float(i * lattice.step % lattice.normals) + 0.5f) * weight;
    add(wo, sampleVisibleNormal(wo, alpha, u0, (float(i) + 0.5f) * weight), weight);
  }
}

float compensation(float f0, float full) { return 1 + f0 * (1 / full - 1); }

// What a microfacet that reflects the share f sends on. gr, gt: masking of what is reflected and transmitted.
struct Split {
  float reflected, transmitted;
};
Split split(const Lobes& lobes, float f, float gr, float gt, bool above) {
  const float r = f * gr, t = (1 - f) * gt;
  if (!lobes.compensated) return {above ? r : 0, t};
  const float sum = r + t;
  return sum > 0 ? Split{r / sum, t / sum} : Split{1, 0};
}

// What a refracting dielectric reflects, for probabilities: by roughness, square root of the cosine, and square root
// of the contrast (eta - 1) / (eta + 1) from either side. Integrated when first asked for (some 20 ms).
class ReflectedTable {
 public:
  ReflectedTable() {
    Lobes lobes;
    lobes.refracts = true;
    for (int side = 0; side < 2; ++side)
      for (int r = 0; r < kNodes; ++r)
        for (int c = 0; c < kNodes; ++c)
          for (int e = 0; e < kNodes; ++e) {
            const float contrast = std::clamp(square(node(e)), 1e-3f, 0.98f), ior = (1 + contrast) / (1 - contrast);
            lobes.eta = side == 0 ? ior : 1 / ior;
            lobes.alpha = std::max(square(node(r)), kSmoothAlpha);
            float& value = values_[index(side, r, c, e)];
            integrateNormals(kOutside, std::max(square(node(c)), kMinCosine), lobes.alpha,
                             [&](Vec3f wo, Vec3f h, float w) { value += facetShares(lobes, {}, wo, h).body.x * w; });
          }
  }
  float reflected(float cos_theta, float alpha, float eta) const {
    const float x[3] = {std::sqrt(alpha), std::sqrt(cos_theta), std::sqrt(std::abs(eta - 1) / (eta + 1))};
    int first[3];
    float fraction[3];
    for (int k = 0; k < 3; ++k) {
      const float scaled = std::min(x[k], 1.0f) * (kNodes - 1);
      first[k] = std::min(int(scaled), kNodes - 2);
      fraction[k] = scaled - float(first[k]);
    }
    float sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const int d[3] = {corner & 1, corner >> 1 & 1, corner >> 2};
      float weight = 1;
      for (int k = 0; k < 3; ++k) weight *= d[k] ? fraction[k] : 1 - fraction[k];
      sum += weight * values_[index(eta < 1, first[0] + d[0], first[1] + d[1], first[2] + d[2])];
    }
    return sum;
  }

 private:
  static constexpr int kNodes = 10;
  static float node(int i) { return float(i) / (kNodes - 1); }
  static float square(float x) { return x * x; }
  static size_t index(int side, int r, int c, int e) { return size_t(((side * kNodes + r) * kNodes + c) * kNodes + e); }
  std::array<float, 2 * kNodes * kNodes * kNodes> values_{};
};
float likelyReflected(const Lobes& lobes, float cos_theta) {
  static const ReflectedTable table;
  const Vec3f schlick = smoothSchlick(lobes, cos_theta);
  const float reflected = lobes.schlick == 1 && lobes.metallic < 1 ? (schlick.x + schlick.y + schlick.z) / 3
                                                                   : table.reflected(cos_theta, lobes.alpha, lobes.eta);
  return std::clamp(reflected, kLeastLikely, 1 - kLeastLikely);
}

Vec3f compensatedSchlick(const Lobes& lobes, const RoughScales& scales, float cos_theta) {
  Vec3f schlick = schlickAlbedo(cos_theta, lobes.alpha, lobes.f0) * scales.schlick;
  for (int k = 0; k < 3; ++k) schlick[k] = std::min(schlick[k], 1.0f);
  return schlick;
}

RoughInterface refractingInterface(const Lobes& lobes, float cos_theta) {
  if (lobes.opacity == 0) return likelyInterface(lobes, cos_theta);
  RoughInterface rough;
  rough.scales = refractingScales(lobes, cos_theta);
  const float body = 1 - lobes.metallic;
  FacetShares sum;
  integrateNormals(lobes.eta > 1 ? kOutside : kInside, cos_theta, lobes.alpha, [&](Vec3f wo, Vec3f h, float weight) {
    const FacetShares facet = facetShares(lobes, rough.scales, wo, h);
    sum.body += facet.body * weight, sum.metal += facet.metal * weight, sum.transmitted += facet.transmitted * weight;
  });
  // The diffuse body gets all that is not reflected: what masking takes is lost to refracted light alone.
  Vec3f diffuse;
  for (int k = 0; k < 3; ++k) diffuse[k] = std::max(0.0f, body - sum.body[k]) * lobes.opacity;
  rough.shares = {sum.reflected(), diffuse, sum.transmitted * (1 - lobes.opacity)};
  return rough;
}

float roughDielectric(const Lobes& lobes, float cos_theta) {
  if (lobes.eta >= 1) return dielectricAlbedo(cos_theta, lobes.alpha, lobes.eta);
  float albedo = 0;
  integrateNormals(kInside, cos_theta, lobes.alpha, [&](Vec3f wo, Vec3f h, float weight) {
    const Vec3f wi = reflectAbout(wo, h);
    if (wi.z > 0) albedo += fresnelDielectric(dot(wo, h), lobes.eta) * smithG2OverG1(wo.z, wi.z, lobes.alpha) * weight;
  });
  return albedo;
}

// A sheet's second interface, as a factor on what the first reflects.
float sheetFactor(float reflected, float opacity) {
  return reflected > 0 ? sheetOf(reflected, 1 - opacity).reflected / reflected : 1;
}

}  // namespace

Shares composeThin(const Lobes& lobes, float dielectric, Vec3f schlick) {
  const float clear = 1 - lobes.opacity;
  const float body = lobes.schlick - lobes.metallic;  // Schlick's share but for the metal
  const Sheet d = sheetOf(dielectric, clear);
  Shares shares;
  for (int k = 0; k < 3; ++k) {
    const Sheet s = sheetOf(schlick[k], clear);
    shares.reflected[k] = (1 - lobes.schlick) * d.reflected + body * s.reflected + lobes.metallic * schlick[k];
    shares.transmitted[k] = (1 - lobes.schlick) * d.transmitted + body * s.transmitted;
    shares.diffuse[k] =
        (1 - lobes.schlick) * (1 - d.reflected - d.transmitted) + body * (1 - s.reflected - s.transmitted);
  }
  return shares;
}

RoughScales refractingScales(const Lobes& lobes, float cos_theta) {
  RoughScales scales;
  if (lobes.metallic == 0 || !lobes.compensated) return scales;
  const float full = microfacetAlbedo(cos_theta, lobes.alpha);
  for (int k = 0; k < 3; ++k) scales.schlick[k] = compensation(lobes.f0[k], full);
  return scales;
}

RoughInterface likelyInterface(const Lobes& lobes, float cos_theta) {
  RoughInterface rough;
  rough.scales = refractingScales(lobes, cos_theta);
  const float body = 1 - lobes.metallic, reflected = likelyReflected(lobes, cos_theta);
  rough.shares.reflected = kWhite * (reflected * body);
  if (lobes.metallic > 0) rough.shares.reflected += compensatedSchlick(lobes, rough.scales, cos_theta) * lobes.metallic;
  rough.shares.diffuse = kWhite * ((1 - reflected) * body * lobes.opacity);
  rough.shares.transmitted = kWhite * ((1 - reflected) * body * (1 - lobes.opacity));
  return rough;
}

RoughInterface roughInterface(const Lobes& lobes, float cos_theta) {
  if (refractsRough(lobes)) return refractingInterface(lobes, cos_theta);
  const float full = lobes.compensated ? microfacetAlbedo(cos_theta, lobes.alpha) : 1;
  RoughInterface rough;
  float dielectric = 0;
  if (lobes.schlick < 1 && lobes.eta != 1) {
    const float raw = roughDielectric(lobes, cos_theta);
    rough.scales.dielectric = compensation(fresnelDielectric(1, lobes.eta), full);
    dielectric = std::min(raw * rough.scales.dielectric, 1.0f);
  }
  Vec3f schlick;
  if (lobes.schlick > 0) {
    for (int k = 0; k < 3; ++k) rough.scales.schlick[k] = compensation(lobes.f0[k], full);
    schlick = compensatedSchlick(lobes, rough.scales, cos_theta);
  }
  rough.shares = compose(lobes, dielectric, schlick);
  if (!lobes.thin) return rough;
  rough.scales.dielectric *= sheetFactor(dielectric, lobes.opacity);
  if (lobes.metallic < lobes.schlick)
    for (int k = 0; k < 3; ++k) rough.scales.schlick[k] *= sheetFactor(schlick[k], lobes.opacity);
  return rough;
}

FacetShares facetShares(const Lobes& lobes, const RoughScales& scales, Vec3f wo, Vec3f h) {
  const float cos_h = std::min(dot(wo, h), 1.0f);
  const Vec3f mirrored = reflectAbout(wo, h);
  const bool above = mirrored.z > 0;
  const float gr = smithG2OverG1(wo.z, std::max(std::abs(mirrored.z), kMinCosine), lobes.alpha);
  Vec3f bent;
  const float gt = refractAbout(wo, h, lobes.eta, bent) ? smithG2OverG1(wo.z, -bent.z, lobes.alpha) : 0;
  FacetShares shares;
  const Split d = split(lobes, smoothDielectric(lobes, cos_h), gr, gt, above);
  shares.body = kWhite * ((1 - lobes.schlick) * d.reflected);
  shares.transmitted = kWhite * ((1 - lobes.schlick) * d.transmitted);
  if (!(lobes.schlick > 0)) return shares;
  const Vec3f schlick = smoothSchlick(lobes, cos_h);
  if (lobes.metallic > 0) {  // the metallic workflow
    if (above) shares.metal = schlick * scales.schlick * (lobes.metallic * gr);
    return shares;
  }
  for (int k = 0; k < 3; ++k) {
    const Split s = split(lobes, schlick[k], gr, gt, above);
    shares.body[k] += lobes.schlick * s.reflected;
    shares.transmitted[k] += lobes.schlick * s.transmitted;
  }
  return shares;
}

float sheetScale(const Lobes& lobes, float cos_theta, float alpha) {
  return lobes.compensated ? 1 / microfacetAlbedo(cos_theta, alpha) : 1;
}

Coat roughCoat(const Lobes& lobes, float cos_theta) {
  const float share = lobes.clearcoat * schlickAlbedo(cos_theta, lobes.coat_alpha, kCoatF0).x;
  if (!lobes.compensated) return {share, 1};
  const float scale = compensation(kCoatF0.x, microfacetAlbedo(cos_theta, lobes.coat_alpha));
  return {std::min(share * scale, 1.0f), scale};
}

}  // namespace encore
