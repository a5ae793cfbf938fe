// White furnaces: nothing gains energy, and with compensation nothing loses it to roughness.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "bsdf_surfaces.h"
#include "core/shade/interface_albedo.h"

namespace encore {
namespace {

// 1 plus the noise of some thousand points and the albedo tables' error.
constexpr float kMost = 1.004f;

TEST(Albedo, TablesMatchQuadrature) {
  for (float alpha : {0.01f, 0.09f, 0.25f, 0.49f, 1.0f}) {
    for (float cos_theta : {0.03f, 0.1f, 0.35f, 0.72f, 0.97f}) {
      Lobes lobes;
      lobes.compensated = false;
      lobes.alpha = alpha;
      for (float ior : {1.05f, 1.33f, 1.5f, 2.4f, 8.0f}) {
        lobes.eta = ior;
        const float sampled = meanReflection(lobes, viewAt(cos_theta), 1 << 11).x;
        EXPECT_NEAR(dielectricAlbedo(cos_theta, alpha, ior), sampled, 3e-3) << alpha << ' ' << cos_theta << ' ' << ior;
      }
      lobes.schlick = 1, lobes.f0 = {0.04f, 0.5f, 1};
      const Vec3f sampled = meanReflection(lobes, viewAt(cos_theta), 1 << 11);
      const Vec3f table = schlickAlbedo(cos_theta, alpha, lobes.f0);
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(table[k], sampled[k], 3e-3) << alpha << ' ' << cos_theta;
      EXPECT_NEAR(microfacetAlbedo(cos_theta, alpha), sampled.z, 3e-3) << alpha << ' ' << cos_theta;
    }
  }
}

struct Body {
  const char* name;
  float opacity;
  InterfaceView view;
};
const Body kBodies[] = {{"opaque", 1, {}},
                        {"glass", 0, {}},
                        {"glass, inside", 0, {true, false, 1}},
                        {"half opaque glass", 0.5f, {}},
                        {"half opaque glass, inside", 0.5f, {true, false, 1}},
                        {"sheet", 0, {false, true, 1}},
                        {"half opaque sheet", 0.5f, {true, true, 1}}};
constexpr float kRoughnesses[] = {0, 0.1f, 0.3f, 0.5f, 0.7f, 1};

// Least and largest furnace over a set of surfaces, by body and roughness.
class FurnaceTable {
 public:
  void add(size_t body, size_t roughness, float value) {
    Range& range = ranges_[body][roughness];
    range.low = std::min(range.low, value), range.high = std::max(range.high, value);
  }
  void print(const char* title) const {
    std::printf("%s: least to largest furnace, by roughness\n%-26s", title, "");
    for (float r : kRoughnesses) std::printf("      %4.1f      ", double(r));
    for (size_t b = 0; b < std::size(kBodies); ++b) {
      std::printf("\n%-26s", kBodies[b].name);
      for (const Range& range : ranges_[b]) std::printf("  %.3f to %.3f", double(range.low), double(range.high));
    }
    std::printf("\n");
  }
  void expectWithin(float least, float most) const {
    for (size_t b = 0; b < std::size(kBodies); ++b)
      for (size_t r = 0; r < std::size(kRoughnesses); ++r) {
        EXPECT_GE(ranges_[b][r].low, least) << kBodies[b].name << ", roughness " << kRoughnesses[r];
        EXPECT_LE(ranges_[b][r].high, most) << kBodies[b].name << ", roughness " << kRoughnesses[r];
      }
  }
  float least(size_t body, size_t roughness) const { return ranges_[body][roughness].low; }

 private:
  struct Range {
    float low = 1e9f, high = 0;
  };
  Range ranges_[std::size(kBodies)][std::size(kRoughnesses)];
};

// White surfaces of both workflows over ior, metallic or f0, and clearcoat, under views up to 88 degrees.
template <class Prepare>
FurnaceTable furnaceTable(Prepare prepare, uint32_t count) {
  FurnaceTable table;
  for (size_t b = 0; b < std::size(kBodies); ++b)
    for (size_t r = 0; r < std::size(kRoughnesses); ++r)
      for (float coat : {0.0f, 0.4f})       // its roughness; 0: none
        for (float x : {0.0f, 0.5f, 1.0f})  // metallic, or f0
          for (float ior : {0.7f, 1.5f, 2.4f})
            for (bool specular : {false, true}) {
              if (specular && ior != 1.5f && (kBodies[b].opacity == 1 || x != 0.5f)) continue;
              Surface surface = Surface().roughness(kRoughnesses[r]).ior(ior).opacity(kBodies[b].opacity);
              if (specular) {
                surface.specular({x, x, x});
              } else {
                surface.metallic(x);
              }
              if (coat > 0) surface.clearcoat(1, coat);
              prepare(surface);
              for (float cos_theta : {0.035f, 0.3f, 1.0f})
                table.add(b, r, furnace(surface, kBodies[b].view, viewAt(cos_theta), count).x);
            }
  return table;
}

TEST(Furnace, KeepsAllLightWithCompensation) {
  const FurnaceTable table = furnaceTable([](Surface&) {}, 1024);
  table.print("compensated");
  table.expectWithin(0.98f, 1.01f);
}

TEST(Furnace, WithoutCompensationRoughnessLosesLight) {
  const FurnaceTable table = furnaceTable([](Surface& surface) { surface.uncompensated(); }, 256);
  table.print("not compensated");
  table.expectWithin(0.2f, 1.03f);
  // What microfacets lose grows with roughness: nothing where smooth.
  for (size_t b = 0; b < std::size(kBodies); ++b) {
    EXPECT_GT(table.least(b, 0), 0.995f) << kBodies[b].name;
    EXPECT_LT(table.least(b, 5), 0.7f) << kBodies[b].name;
    EXPECT_LT(table.least(b, 3), table.least(b, 1)) << kBodies[b].name;
  }
}

// Every lobe traced, whatever its roughness: compensation comes with the sample's weight.
TEST(Furnace, TracedAndEvaluatedLobesKeepTheSame) {
  for (float roughness : {0.4f, 0.8f})
    for (float opacity : {1.0f, 0.0f, 0.4f})
      for (bool back : {false, true})
        for (float cos_theta : {0.1f, 0.7f}) {
          Surface surface = Surface().roughness(roughness).opacity(opacity).clearcoat(0.8f, 0.5f);
          const InterfaceView view{back, false, 1};
          const Vec3f evaluated = furnace(surface, view, viewAt(cos_theta), 1 << 12);
          const Vec3f traced = furnace(surface.roughnessLimit(1), view, viewAt(cos_theta), 1 << 12);
          EXPECT_NEAR(evaluated.x, traced.x, 4e-3) << roughness << ' ' << opacity << ' ' << back << ' ' << cos_theta;
        }
}

// Many samples, tightly.
TEST(Furnace, WhiteSurfacesStayWhite) {
  for (float cos_theta : {0.05f, 0.5f, 1.0f}) {
    for (bool back : {false, true}) {
      const InterfaceView view{back, false, 1};
      EXPECT_NEAR(furnace(smooth().opacity(0), view, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
      EXPECT_NEAR(furnace(smooth().opacity(0.4f), view, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
      EXPECT_NEAR(furnace(smooth().opacity(0.4f), {back, true, 1}, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
    }
    EXPECT_NEAR(furnace(smooth().clearcoat(0.7f, 0), {}, viewAt(cos_theta), 4).x, 1, 1e-6) << cos_theta;
    for (float roughness : {0.2f, 0.5f, 1.0f}) {
      EXPECT_NEAR(furnace(Surface().roughness(roughness), {}, viewAt(cos_theta), 1 << 13).x, 1, 3e-3) << roughness;
      EXPECT_NEAR(furnace(Surface().roughness(roughness).metallic(1), {}, viewAt(cos_theta), 1 << 13).x, 1, 4e-3)
          << roughness;
      for (bool back : {false, true})
        EXPECT_NEAR(furnace(Surface().roughness(roughness).opacity(0), {back, false, 1}, viewAt(cos_theta), 1 << 13).x,
                    1, 2e-3)
            << roughness;
    }
  }
}

TEST(Furnace, NeverGrows) {
  for (float roughness : {0.0f, 0.1f, 0.31f, 1.0f})
    for (float ior : {1.0f, 1.2f, 1.5f, 5.0f})
      for (float metallic : {0.0f, 0.5f, 1.0f})
        for (float opacity : {1.0f, 0.3f, 0.0f})
          for (bool back : {false, true})
            for (float cos_theta : {0.02f, 0.5f, 1.0f}) {
              const Surface surface = Surface().roughness(roughness).ior(ior).metallic(metallic).opacity(opacity);
              EXPECT_LE(furnace(surface, {back, false, 1}, viewAt(cos_theta), 1024).x, kMost)
                  << "roughness " << roughness << " ior " << ior << " metallic " << metallic << " opacity " << opacity
                  << " back " << back << " cos " << cos_theta;
            }
}

// Metals get more saturated where they are rough: what is given back has met the metal once more.
TEST(Furnace, RoughMetalsAreSaturated) {
  const Vec3f base{0.9f, 0.5f, 0.2f};
  const Vec3f bare = meanReflection(
      Surface().metallic(1).base(base).roughness(1).roughnessLimit(1).uncompensated().lobes(), viewAt(0.5f), 1 << 13);
  const Vec3f whole =
      meanReflection(Surface().metallic(1).base(base).roughness(1).roughnessLimit(1).lobes(), viewAt(0.5f), 1 << 13);
  const float full = microfacetAlbedo(0.5f, 1);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(whole[k] / bare[k], 1 + base[k] * (1 - full) / full, 1e-4);
  EXPECT_GT(whole.x / whole.z, bare.x / bare.z);
}

}  // namespace
}  // namespace encore
