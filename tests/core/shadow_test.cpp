// Shadows that are not just black: what passes surfaces, and what lights say of their shadows. And what lights are made
// of meshes, textures and links do in shade().
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>

#include "shade_world.h"
#include "shapes.h"

namespace encore {
namespace {

using test::ShadeWorld;

const Vec3f kFrom{0.3f, -0.2f, 0.5f}, kDown{0, 0, -1};

// A ground under a sun that shines straight down, and sheets between them at heights 1, 2, ... of further materials.
struct Sheets {
  ShadeWorld world;
  Sheets() {
    world.addGround();
    world.addLight(Light::Kind::Distant).radiance = {kPi, kPi, kPi};  // the white ground shows 1
  }
  Light& sun() { return world.stage.scene.lights[0]; }
  Material& addSheet(float z, float size = 5) {
    Material& m = world.stage.scene.materials.emplace_back();
    ShadeWorld::white(m);
    DicedMesh sheet;
    test::addQuad(sheet, {-size, -size, z}, {size, -size, z}, {size, size, z}, {-size, size, z});
    sheet.texcoords.push_back({{0, 0}, {1, 0}, {1, 1}, {0, 1}});
    world.stage.add(sheet, int32_t(world.stage.scene.materials.size() - 1));
    world.stage.scene.meshes.back().texcoords.emplace_back().name = "st";
    return m;
  }
  Material& addPresence(float z, float opacity) {
    Material& m = addSheet(z);
    m.opacity_mode = OpacityMode::Presence, m.opacity.value = opacity;
    return m;
  }
  // All sheets are above the camera.
  Vec3f ground() { return world.shadeOne(kFrom, kDown); }
};

TEST(Shadows, OpaqueOnesAreBlack) {
  Sheets s;
  EXPECT_NEAR(s.ground().x, 1, 1e-6);
  Sheets t;
  t.addSheet(1);
  EXPECT_EQ(t.ground(), (Vec3f{}));
}

TEST(Shadows, PresenceLetsItsRestPass) {
  Sheets s;
  s.addPresence(1, 0.3f);
  s.addPresence(2, 0.5f);
  EXPECT_NEAR(s.ground().x, 0.35, 1e-5);
  Sheets t;
  t.addPresence(1, 0.3f);
  t.addSheet(2);  // opaque behind it
  EXPECT_EQ(t.ground(), (Vec3f{}));
}

TEST(Shadows, CutOutsAreAllOrNothing) {
  for (const float opacity : {0.2f, 0.6f}) {
    Sheets s;
    Material& m = s.addSheet(1);
    m.opacity.value = opacity, m.opacity_threshold = 0.5f;
    EXPECT_NEAR(s.ground().x, opacity < 0.5f ? 1 : 0, 1e-6);
  }
}

TEST(Shadows, MoreHitsThanAreRecordedGoOnInWaves) {
  Sheets s;
  constexpr int kSheets = 3 * int(kRecordedHits) + 2;
  for (int i = 0; i < kSheets; ++i) s.addPresence(1 + 0.1f * float(i), 0.1f);
  EXPECT_NEAR(s.ground().x, std::pow(0.9, kSheets), 1e-5);
}

TEST(Shadows, TexturesDecideWhereLightPasses) {
  Sheets s;
  Scene& scene = s.world.stage.scene;
  scene.textures.push_back({"four.exr", 4, 1, {0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1}, nullptr});
  for (int i = 0; i < 10; ++i) {  // beyond what one wave records
    Material& m = s.addPresence(1 + 0.1f * float(i), 1);
    PatternNode& node = m.nodes.emplace_back();
    node.texture = 0, node.wrap_s = node.wrap_t = WrapMode::Clamp;
    m.opacity.node = 0, m.opacity.channel = 0;
  }
  EXPECT_NEAR(s.world.shadeOne({-2, 0, 0.5f}, kDown).x, 1, 1e-4);
  EXPECT_NEAR(s.world.shadeOne({2, 0, 0.5f}, kDown).x, 0, 1e-6);
  EXPECT_NEAR(s.world.shadeOne({20, 0, 0.5f}, kDown).x, 1, 1e-6);  // beside the sheets
  // In the middle each lets half of it pass.
  EXPECT_NEAR(s.world.shadeOne({0, 0, 0.5f}, kDown).x, std::pow(0.5, 10), 2e-4);
}

TEST(Shadows, GlassTransmitsStraightOn) {
  for (const GlassShadows mode : {GlassShadows::Transmit, GlassShadows::Opaque}) {
    Sheets s;
    s.world.settings.glass_shadows = mode;
    Material& m = s.addSheet(1);
    m.opacity.value = 0, m.ior.value = 1.5f, m.roughness.value = 0;
    const float reflected = 0.04f;
    EXPECT_NEAR(s.ground().x, mode == GlassShadows::Transmit ? 1 - reflected : 0, 1e-4);
  }
}

TEST(Shadows, ResultsDependOnTheBlockAlone) {
  Sheets s;
  Scene& scene = s.world.stage.scene;
  scene.textures.push_back({"two.exr", 2, 1, {0, 0, 0, 1, 1, 1, 1, 1}, nullptr});
  for (int i = 0; i < 12; ++i) {
    Material& m = s.addPresence(0.6f + 0.1f * float(i), 0.2f);
    if (i % 2) continue;
    m.nodes.emplace_back().texture = 0;
    m.opacity.node = 0;
  }
  Light rect;
  rect.kind = Light::Kind::Rect;
  rect.centre = {0, 0, 4}, rect.half_u = {1, 0, 0}, rect.half_v = {0, 1, 0};
  s.world.addLight(Light::Kind::Rect) = rect;
  s.world.addLight(Light::Kind::Dome).shadow_color = {0.5f, 0, 0};
  Light& fading = s.world.addLight(Light::Kind::Rect);
  fading = rect, fading.shadow_distance = 2, fading.shadow_falloff = 1.5f;
  std::vector<PathVertex> vertices;
  for (uint32_t i = 0; i < 90; ++i) {
    const Vec2f p = sobol2(i, 2);
    vertices.push_back(s.world.vertex({4 * p.x - 2, 4 * p.y - 2, 0.5f}, kDown, i % 5, i));
  }
  const std::vector<uint32_t> ends = {30, 30, 33, 60, 90};
  const std::vector<Vec3f> all = s.world.shadeAll(vertices, ends);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  uint32_t begin = 0;
  for (uint32_t end : ends) {
    const std::vector<PathVertex> block(vertices.begin() + begin, vertices.begin() + end);
    const std::vector<Vec3f> alone = s.world.shadeAll(block, {end - begin});
    EXPECT_TRUE(std::equal(alone.begin(), alone.end(), all.begin() + begin, all.begin() + end)) << begin;
    begin = end;
  }
}

TEST(ShadowRules, Enable) {
  Sheets s;
  s.addSheet(1);
  s.sun().shadow_enable = false;
  EXPECT_NEAR(s.ground().x, 1, 1e-6);
  EXPECT_EQ(s.world.rays, 0u);
}

TEST(ShadowRules, Colour) {
  for (const bool passing : {false, true}) {
    Sheets s;
    if (passing)
      s.addPresence(1, 0.4f);
    else
      s.addSheet(1);
    s.sun().shadow_color = {0.5f, 0.25f, 0};
    const Vec3f r = s.ground();
    const float left = passing ? 0.6f : 0;
    EXPECT_NEAR(r.x, left + (1 - left) * 0.5f, 1e-5);
    EXPECT_NEAR(r.y, left + (1 - left) * 0.25f, 1e-5);
    EXPECT_NEAR(r.z, left, 1e-5);
  }
}

TEST(ShadowRules, DistanceAndFalloff) {
  for (const bool passing : {false, true}) {
    const auto at = [&](float distance, float falloff, float gamma) {
      Sheets s;
      s.addSheet(1);
      if (passing) s.addPresence(0.9f, 0);  // nothing of it is there
      s.sun().shadow_distance = distance, s.sun().shadow_falloff = falloff, s.sun().shadow_falloff_gamma = gamma;
      return s.ground().x;
    };
    EXPECT_NEAR(at(0.9f, -1, 1), 1, 1e-5);
    EXPECT_NEAR(at(1.1f, -1, 1), 0, 1e-5);
    EXPECT_NEAR(at(1.5f, 0.4f, 1), 0, 1e-5);  // before the zone
    EXPECT_NEAR(at(1.5f, 1, 1), 0.5f, 1e-3);  // in the middle of it
    EXPECT_NEAR(at(1.5f, 1, 2), 0.75f, 1e-3);
    EXPECT_NEAR(at(0.9f, 0.5f, 1), 1, 1e-5);  // beyond it
  }
}

TEST(ShadowRules, GroupsOfOccluders) {
  Sheets s;
  s.addSheet(1);
  s.world.stage.scene.meshes.back().link_group = 1;
  s.sun().shadow_groups = {1, 0};
  EXPECT_NEAR(s.ground().x, 1, 1e-6);
  Sheets t;
  t.addSheet(1);
  t.world.stage.scene.meshes.back().link_group = 1;
  t.sun().shadow_groups = {0, 1};
  EXPECT_EQ(t.ground(), (Vec3f{}));
  Sheets fading;
  fading.addSheet(1);
  fading.addSheet(1.2f);
  fading.world.stage.scene.meshes[1].link_group = 1;  // the nearer one casts none
  fading.sun().shadow_groups = {1, 0};
  fading.sun().shadow_distance = 1.7f, fading.sun().shadow_falloff = 1;
  EXPECT_NEAR(fading.ground().x, 0.5f, 1e-3);
}

TEST(ShadowRules, OcclusionDistance) {
  for (const float distance : {0.0f, 0.5f, 2.0f}) {
    ShadeWorld world;
    world.addGround();
    world.addGround(1);
    world.settings.occlusion_distance_world = distance;
    world.addLight(Light::Kind::Dome);
    const float seen = float(world.mean(kFrom, kDown, 32).x);
    // Directions whose way to the upper ground is longer: cosines below 1 / distance.
    EXPECT_NEAR(seen, distance == 0 ? 0 : distance < 1 ? 1 : 0.25f, 0.01f) << distance;
  }
}

TEST(LightLinks, LightOnlyTheirGroups) {
  Sheets s;
  s.sun().lit_groups = {0, 1};
  EXPECT_EQ(s.ground(), (Vec3f{}));
  EXPECT_EQ(s.world.rays, 0u);
  Sheets t;
  t.sun().lit_groups = {1, 0};
  EXPECT_NEAR(t.ground().x, 1, 1e-6);
}

TEST(TexturedLights, FurnaceAndMultipliers) {
  ShadeWorld world;
  world.material().ior.value = 1.5f, world.material().roughness.value = 0.8f;
  world.addGround();
  world.stage.scene.textures.push_back({"grey", 4, 2, std::vector<float>(32, 0.5f), nullptr});
  Light& dome = world.addLight(Light::Kind::Dome);
  dome.texture = 0, dome.radiance = {2, 2, 2};
  EXPECT_NEAR(world.mean(kFrom, {0.4f, 0, -1}).x, 1, 0.01);
  dome.diffuse = dome.specular = 0.5f;
  EXPECT_NEAR(world.mean(kFrom, {0.4f, 0, -1}).x, 0.5, 0.005);
}

TEST(TexturedLights, DomesOfBrightSpotsAgreeWithQuadrature) {
  ShadeWorld world;
  world.material().ior.value = 1.5f, world.material().roughness.value = 0.5f;
  world.addGround();
  Texture sky{"sky", 32, 16, {}, nullptr};
  for (uint32_t i = 0; i < 32 * 16; ++i) {
    const float bright = i == 32 * 8 + 5 ? 80.0f : i == 32 * 12 + 20 ? 30.0f : 0.3f;
    sky.rgba.insert(sky.rgba.end(), {bright, bright * 0.5f, 0.2f, 1});
  }
  world.stage.scene.textures.push_back(sky);
  Light& dome = world.addLight(Light::Kind::Dome);
  dome.texture = 0;
  dome.axis_x = {0, 1, 0}, dome.axis_y = {0, 0, 1}, dome.axis_z = {1, 0, 0};
  const Vec3f direction = normalize(Vec3f{0.4f, 0, -1});
  // The same as the sum over an even grid of small suns, which are evaluated exactly.
  const LightImage image(sky, DomeFormat::LatLong);
  const Vec3d mean = world.mean(kFrom, direction, 512);
  world.stage.scene.lights.clear();
  constexpr uint32_t kGrid = 96;
  for (uint32_t i = 0; i < kGrid / 2; ++i)
    for (uint32_t k = 0; k < 2 * kGrid; ++k) {
      const float z = (float(i) + 0.5f) / (kGrid / 2), phi = 2 * kPi * (float(k) + 0.5f) / (2 * kGrid);
      const Vec3f d{std::sqrt(1 - z * z) * std::cos(phi), std::sqrt(1 - z * z) * std::sin(phi), z};
      Light& sun = world.addLight(Light::Kind::Distant);
      sun.direction = -d;
      sun.radiance = image.towards({d.y, d.z, d.x}) * (2 * kPi / (kGrid / 2 * 2 * kGrid));
    }
  const Vec3f exact = world.shadeOne(kFrom, direction);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(mean[k] / exact[k], 1, 0.015) << k;
}

TEST(MeshLights, LightOthersAndShowThemselves) {
  ShadeWorld world;
  world.material().ior.value = 1.5f;  // interfaces do not attenuate what shines
  world.addGround();
  const uint32_t ball = world.stage.add(test::sphere(10), 0, test::translation({0, 0, 3}));
  Light& light = world.addLight(Light::Kind::Mesh);
  light.instance = int32_t(ball), light.radiance = {2, 2, 2};
  const double with = world.mean(kFrom, kDown).x;
  const Vec3f self = world.shadeOne({0, 0, 7}, kDown);
  EXPECT_EQ(viewWeightsInShading(world.stage.scene, world.settings)[0], 1);
  world.stage.scene.lights[0].kind = Light::Kind::Sphere;
  world.stage.scene.lights[0].centre = {0, 0, 3}, world.stage.scene.lights[0].radius = 1.001f;
  EXPECT_NEAR(with / world.mean(kFrom, kDown).x, 1, 0.03);
  EXPECT_NEAR(self.x, 2, 0.1);
  // Only the outside shines, and only along the cone.
  Light& again = world.stage.scene.lights[0];
  again.kind = Light::Kind::Mesh;
  EXPECT_EQ(world.shadeOne({0, 0, 3}, kDown), (Vec3f{}));
  again.shaped = true, again.cone_angle_radians = 0.5f, again.shaping_axis = {0, 0, 1};
  EXPECT_GT(world.shadeOne({0, 0, 7}, kDown).x, 1.9f);
  EXPECT_LT(world.shadeOne({0, 3, 5}, {0, -1, -0.7f}).x, 0.1f);
}

}  // namespace
}  // namespace encore
