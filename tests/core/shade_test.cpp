// shade() against closed forms: furnaces, Lambert's formula, form factors, quadrature of rough lobes.
#include "core/shade/shade.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/shade/interface_albedo.h"
#include "core/shade/lights.h"
#include "shade_world.h"
#include "shapes.h"

namespace encore {
namespace {

using test::ShadeWorld;
using World = ShadeWorld;

constexpr double kPiD = 3.14159265358979323846;
constexpr uint32_t kMany = 256;  // samples of one pixel in the statistical tests

const Vec3f kFrom{0.3f, -0.2f, 0.9f}, kDown{0, 0, -1};  // over the ground near the origin
const Vec3f kPoint{0.3f, -0.2f, 0};                     // what it sees

Light& setRect(Light& light, Vec3d centre, float half) {
  light.centre = centre, light.half_u = {half, 0, 0}, light.half_v = {0, half, 0};
  return light;
}
// Twin: Lambert's formula over the corners of a rectangle above the ground, divided by pi.
double lambertShare(const Light& light, Vec3f p) {
  const Vec3d hu = toDouble(light.half_u), hv = toDouble(light.half_v), c = light.centre - toDouble(p);
  const Vec3d corners[4] = {c - hu - hv, c + hu - hv, c + hu + hv, c - hu + hv};
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    const Vec3d a = normalize(corners[i]), b = normalize(corners[(i + 1) % 4]);
    sum += std::acos(dot(a, b)) * normalize(cross(a, b)).z;
  }
  return std::abs(sum) / (2 * kPiD);
}

TEST(Shade, WhiteFurnaceIsExact) {
  World world;
  world.addGround();
  world.addLight(Light::Kind::Dome);
  EXPECT_EQ(world.shadeOne(kFrom, kDown), (Vec3f{1, 1, 1}));
  EXPECT_EQ(world.rays, 64u);
  EXPECT_EQ(world.shadeOne({0, 0, -1}, {0.5f, 0, 1}), (Vec3f{1, 1, 1}));  // the back of a surface is lit as well
}

TEST(Shade, RoughDielectricFurnaceStaysWhite) {
  for (float roughness : {0.4f, 0.7f, 1.0f}) {
    World world;
    world.material().ior.value = 1.5f;
    world.material().roughness.value = roughness;
    world.addGround();
    world.addLight(Light::Kind::Dome);
    for (Vec3f direction : {Vec3f{0, 0, -1}, Vec3f{1, 0, -0.3f}})
      EXPECT_NEAR(world.mean({0, 0, 1}, direction).x, 1, 0.004) << roughness;
  }
}

TEST(Shade, OcclusionByADisc) {
  World world;
  world.addGround();
  const double radius = 1.2, height = 0.9;
  DicedMesh disc;
  constexpr int kCorners = 256;
  const auto corner = [&](int i) {
    const double a = 2 * kPiD * i / kCorners;
    return kPoint + toFloat(Vec3d{radius * std::cos(a), radius * std::sin(a), height});
  };
  for (int i = 0; i < kCorners; ++i)
    test::addTriangle(disc, kPoint + Vec3f{0, 0, float(height)}, corner(i), corner(i + 1));
  world.stage.add(disc);
  world.addLight(Light::Kind::Dome);
  // The form factor of a coaxial disc.
  const double visible = 1 - radius * radius / (radius * radius + height * height);
  EXPECT_NEAR(world.mean(kFrom - Vec3f{0, 0, 0.5f}, kDown).x, visible, 0.003);
}

TEST(Shade, RectLightIsLamberts) {
  World world;
  world.material().diffuse_color.value = {0.5f, 0.25f, 1};
  world.addGround();
  Light& light = setRect(world.addLight(Light::Kind::Rect), {1, 0.5, 2}, 0.8f);
  light.radiance = {4, 8, 2};
  const Vec3d mean = world.mean(kFrom, kDown);
  const double share = lambertShare(light, kPoint);
  EXPECT_NEAR(mean.x / (share * 2), 1, 0.005);
  EXPECT_NEAR(mean.y / (share * 2), 1, 0.005);
  EXPECT_NEAR(mean.z / (share * 2), 1, 0.005);
  EXPECT_EQ(world.rays, kMany * 16u);
  EXPECT_EQ(world.shadeOne({0, 0, -1}, {0, 0, 1}), (Vec3f{}));  // lit from the other side only
}

TEST(Shade, OneRayPerSampleStratifiesOverAPixel) {
  World world;
  world.settings.light_samples = 1;
  world.addGround();
  const Light& light = setRect(world.addLight(Light::Kind::Rect), {0.3, -0.2, 0.5}, 3);
  // 256 independent points would be off by 3 % as a rule.
  EXPECT_NEAR(world.mean(kFrom - Vec3f{0, 0, 0.5f}, kDown).x / lambertShare(light, kPoint), 1, 0.004);
}

TEST(Shade, SphereLight) {
  World world;
  world.addGround();
  Light& light = world.addLight(Light::Kind::Sphere);
  light.centre = {0.3, 1.8, 2}, light.radius = 0.7f;
  const double d2 = 4 + 4, cosine = 2 / std::sqrt(d2);
  EXPECT_NEAR(world.mean(kFrom, kDown).x / (0.49 / d2 * cosine), 1, 0.003);
}

TEST(Shade, DistantLightsAndTheirShadow) {
  World world;
  world.addGround();
  DicedMesh roof;
  test::addQuad(roof, {9, 9, 1}, {11, 9, 1}, {11, 11, 1}, {9, 11, 1});
  world.stage.add(roof);
  Light& sun = world.addLight(Light::Kind::Distant);
  sun.direction = {0.6f, 0, -0.8f};
  sun.radiance = {kPi, 0, 0};
  Light& disk = world.addLight(Light::Kind::Distant);
  disk.direction = {0, 0, -1};
  disk.angle_radians = 0.2f;
  disk.radiance = {0, 1, 0};
  const Vec3d mean = world.mean(kFrom, kDown);
  EXPECT_NEAR(mean.x, 0.8, 1e-6);
  EXPECT_NEAR(mean.y / std::pow(std::sin(0.1), 2), 1, 0.002);
  EXPECT_EQ(world.rays, kMany * 17u);
  // Under the roof: neither; in the sun's shadow beside it: only the disk.
  EXPECT_EQ(world.shadeOne({10, 10, 0.5f}, kDown), (Vec3f{}));
  const Vec3f beside = world.shadeOne({11.3f, 10, 0.5f}, kDown);
  EXPECT_EQ(beside.x, 0);
  EXPECT_GT(beside.y, 0);
}

TEST(Shade, MultipliersOfLights) {
  World world;
  world.material().ior.value = 1.5f;
  world.addGround();
  Light& sun = world.addLight(Light::Kind::Distant);
  sun.direction = kDown;
  sun.radiance = {kPi, kPi, kPi};
  const float both = world.shadeOne(kFrom, kDown).x;
  sun.specular = 0;
  const float diffuse = world.shadeOne(kFrom, kDown).x;
  sun.specular = 1, sun.diffuse = 0;
  const float specular = world.shadeOne(kFrom, kDown).x;
  EXPECT_NEAR(both, diffuse + specular, 1e-6);
  EXPECT_NEAR(diffuse, 0.96f, 0.005f);
  // D(0) / 4 at normal incidence: alpha = 0.25.
  EXPECT_NEAR(specular, 0.04 * kPiD / (kPiD * 0.0625) / 4, 1e-3);
}

TEST(Shade, EmissionOnBothSidesIsNotAttenuated) {
  World world;
  world.material().ior.value = 1.5f;
  world.material().emissive_color.value = {2, 0.5f, 0};
  world.addGround();
  EXPECT_EQ(world.shadeOne({0, 0, 1}, {1, 0, -0.1f}), (Vec3f{2, 0.5f, 0}));
  EXPECT_EQ(world.shadeOne({0, 0, -1}, {0, 0, 1}), (Vec3f{2, 0.5f, 0}));
  EXPECT_EQ(world.rays, 0u);
}

// Twin of a rough lobe under a light: quadrature over the light's directions, uniform on the sphere.
Vec3d quadrature(const World& world, const Lobes& lobes, Vec3f wo, int rings = 1200) {
  const ShadedView view(lobes, world.stage.scene.materials[0].diffuse_color.value, {0, 0, 1}, wo, true);
  Vec3d sum;
  const int angles = 2 * rings;
  for (int r = 0; r < rings; ++r)
    for (int a = 0; a < angles; ++a) {
      const double z = (r + 0.5) / rings, s = std::sqrt(1 - z * z), phi = 2 * kPiD * (a + 0.5) / angles;
      const Vec3f wi{float(s * std::cos(phi)), float(s * std::sin(phi)), float(z)};
      Vec3f radiance;
      for (const Light& light : world.stage.scene.lights)
        if (intersectLight(light, kPoint, wi) >= 0) radiance += light.radiance;
      if (radiance == Vec3f{}) continue;
      const ShadedResponse response = view.evaluate(wi, false);
      sum = sum + toDouble((response.diffuse + response.specular) * radiance);
    }
  return sum * (2 * kPiD / (double(rings) * angles));
}

TEST(Shade, RoughLobesUnderLightsMatchQuadrature) {
  for (float roughness : {0.35f, 0.6f, 1.0f}) {
    for (int lights = 0; lights < 4; ++lights) {
      World world;
      Material& m = world.material();
      m.roughness.value = roughness;
      m.metallic.value = 1;
      m.diffuse_color.value = {0.9f, 0.6f, 0.3f};
      world.addGround();
      if (lights == 0 || lights == 3) setRect(world.addLight(Light::Kind::Rect), {-2, 0, 1.5}, 1);
      if (lights == 1 || lights == 3) {
        Light& light = world.addLight(Light::Kind::Sphere);
        light.centre = {-1.2, 0.4, 1}, light.radius = 0.5f;
        light.radiance = {5, 1, 0};
      }
      if (lights == 2 || lights == 3) world.addLight(Light::Kind::Dome).radiance = {0.1f, 0.2f, 0.3f};
      const Vec3f direction = normalize(Vec3f{-0.8f, 0.1f, -0.5f});
      const PathInputs inputs{m.diffuse_color.value, {}, 1, roughness, 0, 0.01f, 1, 1, {0, 0, 1}};
      const Lobes lobes = makeLobes(m, inputs, {}, world.settings);
      const Vec3d exact = quadrature(world, lobes, -direction, 600);
      const Vec3d mean = world.mean(kPoint - direction, direction);
      for (int k = 0; k < 3; ++k) {
        if (exact[k] > 0) {
          EXPECT_NEAR(mean[k] / exact[k], 1, 0.01) << "roughness " << roughness << " lights " << lights;
        }
      }
    }
  }
}

TEST(Shade, SamplingBothWaysIsQuieter) {
  // A large light seen in a narrow lobe: light sampling alone would be noisy. All shades agree within a few percent.
  World world;
  world.material().roughness.value = 0.32f;
  world.material().metallic.value = 1;
  world.addGround();
  setRect(world.addLight(Light::Kind::Rect), {0, 0, 2}, 3);
  const Vec3d mean = world.mean(kFrom, kDown);
  EXPECT_GT(mean.x, 0.5);
  for (uint32_t i = 0; i < 32; ++i)
    EXPECT_NEAR(world.shadeAll({world.vertex(kFrom, kDown, i, 7 + i)}, {1})[0].x / mean.x, 1, 0.15);
}

TEST(Shade, TracedLobesShowLightsOfZeroExtentOnly) {
  World world;
  world.settings.energy_compensation = false;
  Material& m = world.material();
  m.roughness.value = 0.2f;
  m.use_specular_workflow = true;
  m.specular_color.value = {1, 1, 1};
  m.diffuse_color.value = {0, 0, 0};  // nothing but the interface
  world.addGround();
  Light& light = world.addLight(Light::Kind::Distant);
  light.direction = {0, 0, -1};
  const double alpha = 0.04;
  EXPECT_NEAR(world.shadeOne(kFrom, kDown).x / (1 / (kPiD * alpha * alpha) / 4), 1, 1e-3);
  light.angle_radians = 0.1f;  // a ray can hit it now
  EXPECT_EQ(world.shadeOne(kFrom, kDown), (Vec3f{}));
}

TEST(Shade, LightArrivesDownToTheHorizonOfTheShadingNormal) {
  // Shading normals lean by 60 degrees: the light is above their horizon, but below the facet. On a smooth mesh
  // that is the curvature which the facet has lost.
  World world;
  DicedMesh ground;
  test::addQuad(ground, {-5, -5, 0}, {5, -5, 0}, {5, 5, 0}, {-5, 5, 0});
  const float s = std::sqrt(0.75f);
  ground.normals.assign(4, {s, 0, 0.5f});
  world.stage.add(ground);
  Light& sun = world.addLight(Light::Kind::Distant);
  sun.direction = normalize(Vec3f{-1, 0, 0.2f});
  const float below = world.shadeOne(kFrom, kDown).x;
  EXPECT_GT(below, 0);
  sun.direction = normalize(Vec3f{-1, 0, -0.2f});
  const float above = world.shadeOne(kFrom, kDown).x;
  const auto cosine = [&](float z) { return dot(normalize(Vec3f{1, 0, z}), Vec3f{s, 0, 0.5f}); };
  EXPECT_NEAR(below / above, cosine(-0.2f) / cosine(0.2f), 1e-5f);
  // Below both horizons there is none, and no ray asks.
  const uint64_t rays = world.rays;
  sun.direction = normalize(Vec3f{1, 0, 1});
  EXPECT_EQ(world.shadeOne(kFrom, kDown), (Vec3f{}));
  EXPECT_EQ(world.rays, rays);
}

TEST(Shade, VaryingInputsAreEvaluatedPerVertex) {
  World world;
  Material& m = world.material();
  m.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
  m.diffuse_color.node = 0;
  world.stage.scene.materials.emplace_back();
  World::white(world.material(1));
  DicedMesh ground;
  test::addQuad(ground, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  ground.display_color = {{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
  world.stage.add(ground);
  DicedMesh other;
  test::addQuad(other, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0});
  world.stage.add(other, 1);
  world.addLight(Light::Kind::Dome);
  std::vector<PathVertex> vertices;
  std::vector<Vec3f> expected;
  for (uint32_t i = 0; i < 40; ++i) {
    const Vec2f p = sobol2(i, 1);
    vertices.push_back(world.vertex({2 * p.x, p.y, 1}, kDown, 0, i));
    expected.push_back(p.x < 0.5f ? Vec3f{2 * p.x, p.y, 1} : Vec3f{1, 1, 1});
  }
  const std::vector<Vec3f> radiance = world.shadeAll(vertices, {15, 15, 40});
  for (size_t i = 0; i < expected.size(); ++i) EXPECT_LT(length(radiance[i] - expected[i]), 1e-5) << i;
}

TEST(Shade, TexturesAreReadAtTheHit) {
  World world;
  world.stage.scene.textures.push_back({"two.exr", 2, 1, {1, 0, 0, 1, 0, 0, 1, 1}, nullptr});
  PatternNode& node = world.material().nodes.emplace_back();
  node.texture = 0;
  node.wrap_s = node.wrap_t = WrapMode::Clamp;
  world.material().diffuse_color.node = 0;
  DicedMesh ground;
  test::addQuad(ground, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  ground.texcoords.push_back({{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  const uint32_t instance = world.stage.add(ground);
  Mesh& mesh = world.stage.scene.meshes[world.stage.scene.prototypes[instance].meshes[0]];
  mesh.texcoords.emplace_back().name = "st";
  world.addLight(Light::Kind::Dome);
  const std::vector<Vec3f> radiance =
      world.shadeAll({world.vertex({0.2f, 0.3f, 1}, kDown), world.vertex({0.8f, 0.3f, 1}, kDown)}, {2});
  EXPECT_LT(length(radiance[0] - Vec3f{1, 0, 0}), 0.01f);
  EXPECT_LT(length(radiance[1] - Vec3f{0, 0, 1}), 0.01f);
}

TEST(Shade, VaryingPathInputsReachTheLobes) {
  World world;
  world.settings.energy_compensation = false;
  Material& m = world.material();
  m.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
  m.use_specular_workflow = true;
  m.specular_color.node = 0;
  m.roughness.value = 1;
  m.diffuse_color.value = {0, 0, 0};
  DicedMesh ground;
  test::addQuad(ground, {-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0});
  ground.display_color.assign(4, {0.1f, 0.5f, 1});
  world.stage.add(ground);
  world.addLight(Light::Kind::Dome);
  const Vec3d mean = world.mean(kFrom, kDown);
  const Vec3f albedo = schlickAlbedo(1, 1, {0.1f, 0.5f, 1});
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(mean[k], albedo[k], 0.003) << k;
}

TEST(Shade, NormalMapsTurnTheNormal) {
  World world;
  world.stage.scene.textures.push_back({"normal.exr", 1, 1, {0.6f, 0, 0.8f, 1}, nullptr});
  world.material().nodes.emplace_back().texture = 0;
  world.material().normal.node = 0;
  DicedMesh ground;
  test::addQuad(ground, {-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0});
  ground.texcoords.push_back({{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  world.stage.add(ground);
  world.stage.scene.meshes.back().texcoords.emplace_back().name = "st";
  Light& sun = world.addLight(Light::Kind::Distant);
  sun.radiance = {kPi, kPi, kPi};
  for (const Vec3f from : {Vec3f{0, 0, 1}, Vec3f{0.6f, 0, 0.8f}, Vec3f{-0.6f, 0.2f, 0.5f}}) {
    sun.direction = -normalize(from);
    const float cosine = std::max(0.0f, dot(normalize(from), Vec3f{0.6f, 0, 0.8f}));
    EXPECT_NEAR(world.shadeOne(kFrom, kDown).x, cosine, 2e-3f) << from.x;
    EXPECT_NEAR(world.shadeOne({0.3f, -0.2f, -0.9f}, {0, 0, 1}).x, 0, 1e-6) << from.x;  // turned for the back as well
  }
}

TEST(Shade, DependsOnNothingButTheBlock) {
  World world;
  world.material().ior.value = 1.5f;
  world.addGround();
  world.stage.add(test::sphere(8), 0, test::translation({0, 0, 1}));
  setRect(world.addLight(Light::Kind::Rect), {1, 1, 4}, 1);
  world.addLight(Light::Kind::Dome);
  world.addLight(Light::Kind::Distant).direction = normalize(Vec3f{1, 2, -3});
  std::vector<PathVertex> vertices;
  for (uint32_t i = 0; i < 600; ++i) {
    const Vec2f p = sobol2(i, 2);
    vertices.push_back(world.vertex({4 * p.x - 2, 4 * p.y - 2, 3}, kDown, i % 5, i));
  }
  const std::vector<uint32_t> ends = {130, 130, 133, 390, 600};
  const std::vector<Vec3f> all = world.shadeAll(vertices, ends);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  uint32_t begin = 0;
  for (uint32_t end : ends) {
    const std::vector<PathVertex> block(vertices.begin() + begin, vertices.begin() + end);
    const std::vector<Vec3f> alone = world.shadeAll(block, {end - begin});
    EXPECT_TRUE(std::equal(alone.begin(), alone.end(), all.begin() + begin, all.begin() + end)) << begin;
    begin = end;
  }
  EXPECT_TRUE(world.shadeAll({}, {}).empty());
}

TEST(Shade, NeverReturnsWhatIsNotFinite) {
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  World world;
  world.material().emissive_color.value = {nan, 1, 1};
  world.material().diffuse_color.value = {inf, nan, 1};
  world.addGround();
  world.addLight(Light::Kind::Dome).radiance = {inf, 1, 1};
  world.addLight(Light::Kind::Distant).radiance = {1e38f, 1e38f, 1e38f};
  EXPECT_TRUE(isFinite(world.shadeOne(kFrom, kDown)));
}

}  // namespace
}  // namespace encore
