#include "core/shade/interface_albedo.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include "core/shade/fresnel.h"
#include "core/shade/microfacet.h"

namespace encore {
namespace {

// Nodes: cosine at the square of an even step (dense at grazing angles), roughness = sqrt(alpha) even,
// contrast |eta - 1| / (eta + 1) at the square of an even step (dense near 1). Chosen so that the energy
// test stays within 1e-3.
constexpr int kCosines = 48, kRoughnesses = 32, kContrasts = 32;
// Visible normals by a Fibonacci lattice: consecutive Fibonacci numbers.
constexpr int kNormals = 377, kLatticeStep = 233;
// The microfacet's own cosine, between which weights are shared: at the square of an even step.
constexpr int kFacets = 128;

float cosineNode(int i) {
  const float x = float(i) / (kCosines - 1);
  return std::max(x * x, kMinCosine);
}
float facetNode(int i) {
  const float x = float(i) / (kFacets - 1);
  return x * x;
}
float etaNode(int i) {
  const float x = float(i) / (kContrasts - 1), contrast = std::min(x * x, 0.999f);
  return (1 + contrast) / (1 - contrast);
}

struct Cell {
  int index = 0;
  float fraction = 0;
};
Cell cellOf(float x, int nodes) {  // x in [0, 1]
  const float scaled = std::clamp(x, 0.0f, 1.0f) * float(nodes - 1);
  const int index = std::min(int(scaled), nodes - 2);
  return {index, scaled - float(index)};
}

float schlickFactor(float cos_theta) { return fresnelSchlick(cos_theta, {0, 0, 0}).x; }

// How the light of one bounce is spread over the microfacets' cosines: it does not depend on the index of
// refraction, so that one set of microfacets serves every table.
using FacetWeights = std::array<float, kFacets>;
FacetWeights facetWeights(float zo, float alpha) {
  FacetWeights weights{};
  const auto add = [&](float cos_h, float weight) {
    const Cell cell = cellOf(std::sqrt(cos_h), kFacets);
    weights[size_t(cell.index)] += weight * (1 - cell.fraction);
    weights[size_t(cell.index) + 1] += weight * cell.fraction;
  };
  if (alpha < kSmoothAlpha) {
    add(zo, 1);
    return weights;
  }
  const Vec3f wo{std::sqrt(1 - zo * zo), 0, zo};
  for (int i = 0; i < kNormals; ++i) {
    // Spherical caps put phi = 0 in the plane of wo: half a turn is enough.
    const float u0 = 0.5f * (float(i * kLatticeStep % kNormals) + 0.5f) / kNormals, u1 = (float(i) + 0.5f) / kNormals;
    const Vec3f h = sampleVisibleNormal(wo, alpha, u0, u1), wi = reflectAbout(wo, h);
    if (wi.z > 0) add(dot(wo, h), smithG2OverG1(zo, wi.z, alpha) / kNormals);
  }
  return weights;
}

size_t node(int r, int c) { return size_t(r) * kCosines + size_t(c); }

struct Tables {
  // [roughness][cosine]: F = 1, and Schlick's (1 - cos)⁵.
  std::vector<float> full, schlick;
  // [roughness][cosine][contrast]
  std::vector<float> dielectric;

  Tables();
};

Tables::Tables() {
  FacetWeights edge{};
  std::array<FacetWeights, kContrasts> front{};
  for (int f = 0; f < kFacets; ++f) {
    edge[size_t(f)] = schlickFactor(facetNode(f));
    for (int e = 0; e < kContrasts; ++e) front[size_t(e)][size_t(f)] = fresnelDielectric(facetNode(f), etaNode(e));
  }
  const auto sum = [](const FacetWeights& weights, const FacetWeights& reflectance) {
    return std::inner_product(weights.begin(), weights.end(), reflectance.begin(), 0.0f);
  };
  for (int r = 0; r < kRoughnesses; ++r)
    for (int c = 0; c < kCosines; ++c) {
      const float roughness = float(r) / (kRoughnesses - 1);
      const FacetWeights weights = facetWeights(cosineNode(c), roughness * roughness);
      full.push_back(std::accumulate(weights.begin(), weights.end(), 0.0f));
      schlick.push_back(sum(weights, edge));
      for (const FacetWeights& reflectance : front) dielectric.push_back(sum(weights, reflectance));
    }
}

const Tables& tables() {
  static const Tables instance;
  return instance;
}

float mix(float a, float b, float t) { return a + (b - a) * t; }

float interpolate2(const std::vector<float>& table, Cell r, Cell c) {
  const float low = mix(table[node(r.index, c.index)], table[node(r.index, c.index + 1)], c.fraction);
  const float high = mix(table[node(r.index + 1, c.index)], table[node(r.index + 1, c.index + 1)], c.fraction);
  return mix(low, high, r.fraction);
}

float interpolate3(const std::vector<float>& table, Cell r, Cell c, Cell e) {
  std::array<float, 4> edges{};
  for (int k = 0; k < 4; ++k) {
    const float* row = &table[node(r.index + (k >> 1), c.index + (k & 1)) * kContrasts + size_t(e.index)];
    edges[size_t(k)] = mix(row[0], row[1], e.fraction);
  }
  return mix(mix(edges[0], edges[1], c.fraction), mix(edges[2], edges[3], c.fraction), r.fraction);
}

Cell contrastCell(float eta) { return cellOf(std::sqrt(std::max(0.0f, eta - 1) / (eta + 1)), kContrasts); }
Cell cosineCell(float cos_theta) { return cellOf(std::sqrt(std::max(cos_theta, 0.0f)), kCosines); }
Cell roughnessCell(float alpha) { return cellOf(std::sqrt(alpha), kRoughnesses); }

}  // namespace

float dielectricAlbedo(float cos_theta, float alpha, float eta) {
  return interpolate3(tables().dielectric, roughnessCell(alpha), cosineCell(cos_theta), contrastCell(eta));
}

Vec3f schlickAlbedo(float cos_theta, float alpha, Vec3f f0) {
  const Cell r = roughnessCell(alpha), c = cosineCell(cos_theta);
  const float full = interpolate2(tables().full, r, c), edge = interpolate2(tables().schlick, r, c);
  return f0 * (full - edge) + Vec3f{edge, edge, edge};
}

float microfacetAlbedo(float cos_theta, float alpha) {
  return interpolate2(tables().full, roughnessCell(alpha), cosineCell(cos_theta));
}

}  // namespace encore
