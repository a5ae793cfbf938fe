// Lobes of UsdPreviewSurface against closed forms.
#include "core/shade/bsdf.h"

#include <gtest/gtest.h>

#include <limits>

#include "bsdf_surfaces.h"

namespace encore {
namespace {

TEST(Fresnel, KnownValues) {
  EXPECT_NEAR(fresnelDielectric(1, 1.5f), 0.04f, 1e-6);
  EXPECT_NEAR(fresnelDielectric(1, 1 / 1.5f), 0.04f, 1e-6);
  EXPECT_NEAR(fresnelDielectric(1, 2.5f), std::pow(1.5 / 3.5, 2), 1e-6);
  EXPECT_EQ(fresnelDielectric(0, 1.5f), 1);  // grazing
  EXPECT_EQ(fresnelDielectric(0.3f, 1), 0);  // no interface
  // Brewster's angle, tan = n: only s-polarised light reflects, ((n² - 1) / (n² + 1))² of it.
  const float n = 1.5f, brewster = std::cos(std::atan(n));
  EXPECT_NEAR(fresnelDielectric(brewster, n), 0.5 * std::pow((n * n - 1) / (n * n + 1), 2), 1e-6);
  // Total reflection from 41.8 degrees on, from the denser side.
  const float critical = std::sqrt(1 - 1 / (n * n));
  EXPECT_EQ(fresnelDielectric(critical - 1e-3f, 1 / n), 1);
  EXPECT_LT(fresnelDielectric(critical + 1e-3f, 1 / n), 1);
  // Both sides of one ray reflect alike (Stokes).
  for (float c : {0.2f, 0.5f, 0.9f}) {
    const float inside = std::sqrt(1 - (1 - c * c) / (n * n));
    EXPECT_NEAR(fresnelDielectric(c, n), fresnelDielectric(inside, 1 / n), 1e-5);
    EXPECT_NEAR(fresnelDielectric(c, n), twinFresnel(c, n), 1e-6);
    EXPECT_NEAR(refractedCosine(inside, 1 / n), c, 1e-5);
  }
  EXPECT_EQ(fresnelSchlick(1, {0.1f, 0.5f, 1}), (Vec3f{0.1f, 0.5f, 1}));
  EXPECT_NEAR(fresnelSchlick(0, {0.1f, 0.5f, 1}).x, 1, 1e-6);
}

TEST(Lobes, FollowUsdPreviewSurface) {
  const Lobes metal = Surface().metallic(1).base({0.9f, 0.5f, 0.1f}).roughness(0).lobes();
  EXPECT_EQ(metal.f0, (Vec3f{0.9f, 0.5f, 0.1f}));
  const EffectWeights m = effectWeights(metal, 1, false);
  EXPECT_NEAR(m.reflection.y, 0.5f, 1e-6);
  EXPECT_EQ(m.absorption, (Vec3f{}));
  EXPECT_EQ(m.refraction, (Vec3f{}));

  // The specular workflow ignores metallic.
  const Lobes specular = smooth().metallic(1).specular({0.2f, 0.3f, 0.4f}).lobes();
  const EffectWeights s = effectWeights(specular, 1, false);
  EXPECT_NEAR(s.reflection.y, 0.3f, 1e-6);
  EXPECT_NEAR(s.absorption.y, 0.7f, 1e-6);

  // Half transparent glass: what passes the interface is shared between diffuse and refraction.
  const EffectWeights g = effectWeights(smooth().opacity(0.25f).lobes(), 1, false);
  EXPECT_NEAR(g.reflection.x, 0.04f, 1e-6);
  EXPECT_NEAR(g.refraction.x, 0.96f * 0.75f, 1e-6);
  EXPECT_NEAR(g.absorption.x, 0.96f * 0.25f, 1e-6);

  // A clearcoat takes its share first; it is not there from the inside of a solid.
  Surface coated = smooth().clearcoat(0.5f, 0).opacity(0);
  EXPECT_NEAR(effectWeights(coated.lobes(), 1, false).reflection.x, 0.02f + 0.98f * 0.04f, 1e-6);
  EXPECT_NEAR(effectWeights(coated.lobes(true), 1, false).reflection.x, 0.04f, 1e-6);

  // Only what can refract has an inside.
  EXPECT_EQ(smooth().lobes(true).eta, 1.5f);
  EXPECT_EQ(smooth().opacity(0).lobes(true).eta, 1 / 1.5f);
  Surface cutout = smooth().opacity(0.5f);
  cutout.material.opacity_threshold = 0.3f;
  EXPECT_EQ(cutout.lobes(true).opacity, 1);
}

TEST(Lobes, LayersThatExist) {
  EXPECT_TRUE(feedsReflection(smooth().material, kLimit));
  EXPECT_FALSE(feedsReflection(Surface().roughness(0.5f).material, kLimit));
  EXPECT_TRUE(feedsReflection(Surface().roughness(0.5f).clearcoat(1, 0).material, kLimit));
  EXPECT_FALSE(feedsReflection(smooth().ior(1).material, kLimit));
  EXPECT_TRUE(feedsReflection(smooth().ior(1).metallic(0.1f).material, kLimit));
  Surface varying = smooth();
  varying.material.roughness.node = 0;  // its largest value may be 1
  EXPECT_FALSE(feedsReflection(varying.material, kLimit));
  EXPECT_TRUE(feedsReflection(varying.material, 1));
  EXPECT_FALSE(varying.lobes().specular_traced);

  EXPECT_FALSE(feedsRefraction(smooth().material));
  EXPECT_TRUE(feedsRefraction(smooth().opacity(0.9f).material));
  EXPECT_FALSE(feedsRefraction(smooth().opacity(0.9f).metallic(1).material));
  Surface cutout = smooth().opacity(0.5f);
  cutout.material.opacity_threshold = 0.3f;
  EXPECT_FALSE(feedsRefraction(cutout.material));
}

TEST(Lobes, WhereViewWeightsAreApplied) {
  EXPECT_FALSE(viewWeightInShading(smooth().material, kLimit, true));
  EXPECT_FALSE(viewWeightInShading(Surface().roughness(0.2f).material, kLimit, false));
  EXPECT_TRUE(viewWeightInShading(Surface().roughness(0.2f).material, kLimit, true));
  EXPECT_TRUE(viewWeightInShading(Surface().roughness(0.5f).material, kLimit, false));
  EXPECT_FALSE(viewWeightInShading(Surface().roughness(0.5f).ior(1).material, kLimit, true));
  EXPECT_TRUE(viewWeightInShading(smooth().clearcoat(1, 0.5f).material, kLimit, false));
  Surface emits = smooth();
  emits.material.emissive_color.value = {0, 0, 1};
  EXPECT_TRUE(emits.viewWeight());
  // Diffuse is weighted once, in either place.
  for (float cos_theta : {0.1f, 0.5f, 1.0f}) {
    const Lobes lobes = smooth().lobes();
    const Vec3f wo = viewAt(cos_theta), wi = viewAt(0.7f);
    const Vec3f outside = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, false, false).diffuse *
                          effectWeights(lobes, cos_theta, false).absorption;
    const Vec3f inside = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).diffuse;
    EXPECT_NEAR(outside.x, inside.x, 1e-6);
    EXPECT_NEAR(inside.x, (1 - fresnelDielectric(cos_theta, 1.5f)) * 0.7f * kInvPi, 1e-6);
    EXPECT_EQ(effectWeights(lobes, cos_theta, true).absorption, (Vec3f{1, 1, 1}));
  }
}

TEST(Bounce, SmoothReflectionAndSnell) {
  const Vec3f n = normalize(Vec3f{0.3f, -0.5f, 0.8f});
  const Vec3f wo = normalize(n + Vec3f{0.4f, 0.3f, 0.1f});
  const Lobes glass = smooth().opacity(0).lobes();
  const Points u(3, 7);
  const Bounce r = sampleReflection(glass, n, wo, u.u), t = sampleRefraction(glass, n, wo, u.u);
  ASSERT_TRUE(r.valid && t.valid);
  EXPECT_NEAR(dot(r.direction, n), dot(wo, n), 1e-6);
  EXPECT_NEAR(length(r.direction + wo - n * (2 * dot(wo, n))), 0, 1e-6);
  EXPECT_EQ(r.half_vector, n);
  // Snell: tangential parts differ by the factor ior and lie in one line.
  const Vec3f tangent_o = wo - n * dot(wo, n), tangent_t = t.direction - n * dot(t.direction, n);
  EXPECT_NEAR(length(tangent_t * 1.5f + tangent_o), 0, 1e-6);
  EXPECT_LT(dot(t.direction, n), 0);
  const float fresnel = fresnelDielectric(dot(wo, n), 1.5f);
  EXPECT_NEAR(r.weight.x, fresnel, 1e-6);
  EXPECT_NEAR(t.weight.x, 1 - fresnel, 1e-6);
}

TEST(Bounce, SlabKeepsDirection) {
  // Normals of a slab's two sides as a path sees them: towards where the ray comes from.
  const Lobes enter = smooth().opacity(0).lobes(), leave = smooth().opacity(0).lobes(true);
  const Vec3f n{0, 0, 1}, wo = viewAt(0.4f);
  const Points u(0, 0);
  const Bounce in = sampleRefraction(enter, n, wo, u.u);
  const Bounce out = sampleRefraction(leave, n, -in.direction, u.u);
  ASSERT_TRUE(in.valid && out.valid);
  EXPECT_NEAR(length(out.direction + wo), 0, 1e-6);
  EXPECT_NEAR(out.weight.x, in.weight.x, 1e-6);
}

TEST(Bounce, TotalReflection) {
  const Lobes inside = smooth().opacity(0).lobes(true);
  const Points u(0, 0);
  const Vec3f wo = viewAt(0.5f);  // 60 degrees
  EXPECT_FALSE(sampleRefraction(inside, kUp, wo, u.u).valid);
  EXPECT_EQ(sampleReflection(inside, kUp, wo, u.u).weight, (Vec3f{1, 1, 1}));
  const EffectWeights weights = effectWeights(inside, 0.5f, false);
  EXPECT_EQ(weights.reflection, (Vec3f{1, 1, 1}));
  EXPECT_EQ(weights.refraction, (Vec3f{}));
}

TEST(Bounce, NoChangeOfIndexGoesStraight) {
  for (float roughness : {0.0f, 0.2f}) {
    const Lobes air = Surface().roughness(roughness).opacity(0).ior(1).lobes();
    const Bounce b = sampleRefraction(air, kUp, viewAt(0.3f), Points(5, 5).u);
    ASSERT_TRUE(b.valid);
    EXPECT_EQ(b.direction, -viewAt(0.3f));
    EXPECT_NEAR(b.weight.x, 1, 1e-6);
    EXPECT_FALSE(sampleReflection(air, kUp, viewAt(0.3f), Points(5, 5).u).valid);
  }
}

TEST(Opacity, CutOutPresenceAndTransparency) {
  Surface surface = smooth().opacity(0.4f);
  const Settings& settings = surface.settings;
  Material& m = surface.material;
  EXPECT_TRUE(feedsRefraction(m));
  EXPECT_FALSE(m.hasPresence());
  EXPECT_EQ(presence(m, 0.4f), 1);
  EXPECT_TRUE(passesShadows(m, settings) && transmitsShadows(m, settings));
  surface.settings.glass_shadows = GlassShadows::Opaque;
  EXPECT_FALSE(passesShadows(m, settings) || transmitsShadows(m, settings));

  m.opacity_mode = OpacityMode::Presence;
  EXPECT_FALSE(feedsRefraction(m));
  EXPECT_EQ(surface.lobes().opacity, 1);  // what is there is opaque
  EXPECT_EQ(presence(m, 0.4f), 0.4f);
  EXPECT_EQ(presence(m, -1), 0);
  EXPECT_EQ(presence(m, 7), 1);
  EXPECT_EQ(presence(m, std::numeric_limits<float>::quiet_NaN()), 1);
  EXPECT_TRUE(passesShadows(m, settings));
  EXPECT_FALSE(transmitsShadows(m, settings));
  m.opacity.value = 1;
  EXPECT_FALSE(passesShadows(m, settings));

  m.opacity.value = 0.4f;
  for (OpacityMode mode : {OpacityMode::Presence, OpacityMode::Transparent}) {
    m.opacity_mode = mode;
    m.opacity_threshold = 0.4f;
    EXPECT_EQ(presence(m, 0.4f), 1);  // the threshold itself is there
    EXPECT_EQ(presence(m, 0.39f), 0);
    EXPECT_FALSE(feedsRefraction(m));
    EXPECT_TRUE(passesShadows(m, settings));
    EXPECT_EQ(surface.lobes().opacity, 1);
  }
}

// opacity scales what is diffuse; the specular response stays.
TEST(Opacity, InterfaceStaysWhereNothingIsDiffuse) {
  for (float roughness : {0.0f, 0.2f})
    for (float opacity : {1.0f, 0.5f, 0.0f}) {
      const Lobes lobes = Surface().roughness(roughness).opacity(opacity).clearcoat(0.5f, 0).lobes();
      const EffectWeights w = effectWeights(lobes, 0.7f, false);
      const float expected =
          effectWeights(Surface().roughness(roughness).clearcoat(0.5f, 0).lobes(), 0.7f, false).reflection.x;
      EXPECT_NEAR(w.reflection.x, expected, roughness > 0 && opacity < 1 ? 0.03f : 1e-6f);
      if (roughness > 0) continue;
      EXPECT_NEAR(w.absorption.x, (1 - expected) * opacity, 1e-6);
      EXPECT_NEAR(w.refraction.x, (1 - expected) * (1 - opacity), 1e-6);
    }
}

TEST(Opacity, UsersShadersSetWhatTheirSourceNames) {
  Surface surface = smooth();
  surface.material.surface_shader = GlslShader{"/m/s", "s.glsl", "s.diffuse_color = vec3(1.0);", {}};
  EXPECT_FALSE(feedsRefraction(surface.material));
  EXPECT_TRUE(feedsReflection(surface.material, kLimit));
  EXPECT_FALSE(surface.viewWeight());
  surface.material.surface_shader->source = "s.opacity = 0.5; s.roughness = 0.1; s.emissive_color = vec3(1.0);";
  EXPECT_TRUE(feedsRefraction(surface.material));
  EXPECT_FALSE(feedsReflection(surface.material, kLimit));  // its largest roughness may be 1
  EXPECT_TRUE(surface.viewWeight());
}

const InterfaceView kThin{false, true, 1};

// The series of reflections within a sheet, pass by pass.
TEST(Thin, SheetsSumReflections) {
  for (float r : {0.0f, 0.04f, 0.5f, 0.99f})
    for (float clear : {0.0f, 0.3f, 1.0f}) {
      double reflected = double(r), transmitted = 0, inside = 1 - double(r);
      for (int bounce = 0; bounce < 4000; ++bounce) {
        inside *= double(clear);
        (bounce % 2 == 0 ? transmitted : reflected) += inside * (1 - double(r));
        inside *= double(r);
      }
      EXPECT_NEAR(sheetOf(r, clear).reflected, reflected, 1e-5) << r << ' ' << clear;
      EXPECT_NEAR(sheetOf(r, clear).transmitted, transmitted, 1e-5) << r << ' ' << clear;
    }
  EXPECT_EQ(sheetOf(1, 1).reflected, 1);
  EXPECT_EQ(sheetOf(1, 1).transmitted, 0);
}

TEST(Thin, StraightOnAndAlikeFromBothSides) {
  for (float ior : {1.5f, 1 / 1.5f, 1.0f})
    for (float opacity : {0.0f, 0.5f})
      for (float cos_theta : {0.05f, 0.5f, 1.0f}) {
        const Surface surface = smooth().ior(ior).opacity(opacity).clearcoat(0.3f, 0);
        const Lobes front = surface.lobes(kThin), back = surface.lobes(InterfaceView{true, true, 1});
        const Vec3f wo = viewAt(cos_theta);
        const EffectWeights w = effectWeights(front, cos_theta, false);
        EXPECT_EQ(w.refraction, effectWeights(back, cos_theta, false).refraction);
        EXPECT_EQ(w.reflection, effectWeights(back, cos_theta, false).reflection);
        EXPECT_NEAR(w.reflection.x + w.refraction.x + w.absorption.x, 1, 1e-6);
        const Bounce b = sampleRefraction(back, kUp, wo, Points(1, 1).u);
        ASSERT_TRUE(b.valid);  // never total reflection
        EXPECT_NEAR(length(b.direction + wo), 0, 1e-6);
        EXPECT_EQ(b.weight, w.refraction);
        EXPECT_EQ(front.bendEta(), 1);
        EXPECT_EQ(straightTransmittance(front, cos_theta), w.refraction);
      }
  // Glass: two surfaces that reflect 4 % each.
  const EffectWeights w = effectWeights(smooth().opacity(0).lobes(kThin), 1, false);
  EXPECT_NEAR(w.reflection.x, 2 * 0.04 / 1.04, 1e-6);
  EXPECT_NEAR(w.refraction.x, 0.96 / 1.04, 1e-6);
  // Opaque where opacity says so: one surface.
  Surface opaque = smooth().opacity(0.5f);
  opaque.inputs.opacity = 1;
  EXPECT_NEAR(effectWeights(opaque.lobes(kThin), 1, false).reflection.x, 0.04, 1e-6);
  EXPECT_EQ(smooth().lobes(kThin).thin, false);  // cannot transmit
}

TEST(Thin, RoughSheetsSpreadAboutStraightOn) {
  const Vec3f wo = viewAt(0.7f);
  float last = 0;
  for (float roughness : {0.2f, 0.5f, 0.9f}) {
    const Lobes lobes = Surface().roughness(roughness).opacity(0).lobes(kThin);
    float spread = 0;
    for (uint32_t i = 0; i < 512; ++i) {
      const Bounce b = sampleRefraction(lobes, kUp, wo, Points(i, 4).u);
      if (!b.valid) continue;
      EXPECT_LT(b.direction.z, 0);
      spread += length(b.direction + wo) / 512;
    }
    EXPECT_GT(spread, 1.5f * last);
    last = spread;
  }
  EXPECT_LT(last, 0.6f);
}

TEST(Nested, IndicesAreRelative) {
  const Surface glass = smooth().opacity(0);
  EXPECT_FLOAT_EQ(glass.lobes(InterfaceView{false, false, 1.33f}).eta, 1.5f / 1.33f);
  EXPECT_FLOAT_EQ(glass.lobes(InterfaceView{true, false, 1.33f}).eta, 1.33f / 1.5f);
  EXPECT_FLOAT_EQ(glass.lobes(InterfaceView{false, true, 3}).eta, 2);  // sheets: from the rarer side
  // No interface between equals: everything goes straight on.
  for (bool back : {false, true}) {
    const Lobes none = Surface().roughness(0.4f).opacity(0).lobes(InterfaceView{back, false, 1.5f});
    EXPECT_EQ(none.eta, 1);
    const Bounce b = sampleRefraction(none, kUp, viewAt(0.3f), Points(2, 3).u);
    EXPECT_EQ(b.direction, -viewAt(0.3f));
    EXPECT_EQ(b.weight, (Vec3f{1, 1, 1}));
    EXPECT_EQ(effectWeights(none, 0.3f, false).reflection, (Vec3f{}));
  }
  // Materials that cannot transmit have no inside, but see what they lie in.
  EXPECT_FLOAT_EQ(smooth().lobes(InterfaceView{true, false, 1.33f}).eta, 1.5f / 1.33f);
  EXPECT_EQ(glass.lobes(InterfaceView{false, false, std::numeric_limits<float>::quiet_NaN()}).eta, 1.5f);
}

TEST(StraightTransmittance, WhatInterfacesLeave) {
  const float c = 0.4f, r = fresnelDielectric(c, 1.5f);
  for (bool back : {false, true}) {  // from the inside too it is seen from outside
    const Lobes lobes = smooth().opacity(0.25f).lobes(back);
    EXPECT_NEAR(straightTransmittance(lobes, c).x, (1 - r) * 0.75f, 1e-6);
    EXPECT_NEAR(straightTransmittance(lobes, -c).x, (1 - r) * 0.75f, 1e-6);
  }
  EXPECT_EQ(straightTransmittance(smooth().lobes(), c), (Vec3f{}));
  EXPECT_EQ(straightTransmittance(smooth().opacity(0).metallic(1).lobes(), c), (Vec3f{}));
  EXPECT_NEAR(straightTransmittance(smooth().opacity(0).metallic(0.5f).lobes(), c).x, (1 - r) * 0.5f, 1e-6);
  EXPECT_NEAR(straightTransmittance(smooth().opacity(0).clearcoat(1, 0).lobes(), 1).x, 0.96f * 0.96f, 1e-6);
  const Vec3f tinted = straightTransmittance(smooth().opacity(0).specular({0, 0.5f, 1}).lobes(), 1);
  EXPECT_NEAR(tinted.x, 1, 1e-6);
  EXPECT_NEAR(tinted.y, 0.5, 1e-6);
  EXPECT_NEAR(tinted.z, 0, 1e-6);
  for (float roughness : {0.3f, 1.0f}) {
    const float t = straightTransmittance(Surface().roughness(roughness).opacity(0).lobes(), c).x;
    EXPECT_GT(t, 0.8f);
    EXPECT_LE(t, 1);
  }
}

TEST(Shaded, TracedLobesOnlyOnRequest) {
  const Lobes lobes = Surface().roughness(0.2f).clearcoat(1, 0.2f).lobes();
  const Vec3f wo = viewAt(0.8f), wi{-wo.x, 0, wo.z};
  EXPECT_FALSE(hasRoughLobe(lobes));
  EXPECT_EQ(pdfRoughLobe(lobes, kUp, wo, wi), 0);
  EXPECT_EQ(evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, false).specular, (Vec3f{}));
  const float both = evaluateShaded(lobes, {1, 1, 1}, kUp, wo, wi, true, true).specular.x;
  const float coat_only =
      evaluateShaded(Surface().roughness(0).clearcoat(1, 0.2f).lobes(), {1, 1, 1}, kUp, wo, wi, true, true).specular.x;
  EXPECT_GT(coat_only, 1);  // the peak of a narrow lobe
  EXPECT_GT(both, 1.5f * coat_only);
}

// Whatever texture and view say, weights stay finite and energy below 1.
TEST(Lobes, BadNumbersStayFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  for (float bad : {nan, inf, -inf, -1.0f, 1e30f, 0.0f, 1e-20f, 1e-3f}) {
    Surface surface = Surface().roughness(0.5f);
    surface.material.opacity.node = surface.material.ior.node = 0;
    surface.inputs = {{bad, bad, bad}, {bad, bad, bad}, bad, bad, bad, bad, bad, bad, {bad, bad, bad}};
    for (bool specular : {false, true})
      for (int view = 0; view < 8; ++view)
        for (float cos_theta : {1e-6f, 0.5f, 1.0f}) {
          surface.material.use_specular_workflow = specular;
          surface.settings.roughness_limit = view & 1 ? 1.0f : kLimit;
          const Lobes lobes = surface.lobes(InterfaceView{(view & 2) != 0, (view & 4) != 0, bad});
          const EffectWeights weights = effectWeights(lobes, nan, false);
          EXPECT_LE(maxComponent(weights.reflection + weights.refraction + weights.absorption), 1.12f);
          EXPECT_TRUE(isFinite(weights.reflection + weights.refraction + weights.absorption));
          EXPECT_LE(maxComponent(straightTransmittance(lobes, bad)), 1.0001f);
          EXPECT_TRUE(isFinite(straightTransmittance(lobes, bad)));
          const Vec3f wo = viewAt(cos_theta);
          for (uint32_t i = 0; i < 8; ++i) {
            const Points u(i, 1);
            const Bounce r = sampleReflection(lobes, kUp, wo, u.u), t = sampleRefraction(lobes, kUp, wo, u.u);
            EXPECT_TRUE(isFinite(r.weight) && isFinite(r.direction));
            EXPECT_TRUE(isFinite(t.weight) && isFinite(t.direction));
          }
          const ShadedResponse r = evaluateShaded(lobes, {bad, bad, bad}, kUp, wo, kUp, true, true);
          EXPECT_TRUE(isFinite(r.diffuse) && isFinite(r.specular));
        }
  }
}

TEST(Lobes, NaNIsTheSpecificationsDefault) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Lobes lobes = Surface().roughness(nan).ior(nan).opacity(nan).metallic(nan).clearcoat(nan, nan).lobes();
  EXPECT_EQ(lobes.alpha, 0.25f);
  EXPECT_EQ(lobes.eta, 1.5f);
  EXPECT_EQ(lobes.opacity, 1);
  EXPECT_EQ(lobes.metallic, 0);
  EXPECT_EQ(lobes.clearcoat, 0);
  EXPECT_FALSE(feedsRefraction(Surface().opacity(nan).material));
}

}  // namespace
}  // namespace encore
