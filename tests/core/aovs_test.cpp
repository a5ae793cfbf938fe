// Settings::aovs of scenes where their values are known in closed form.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "core/path/antialiasing_samples.h"
#include "tests/core/render_scenes.h"

namespace encore {
namespace {

using Kind = Aov::Kind;

constexpr int32_t kSide = 40;    // pixels of the image
constexpr float kHalf = 0.5f;    // of its film window, tangent
constexpr double kDepth = 4;     // of the wall
constexpr float kAside = 0.03f;  // so that no edge of it lies between pixels

// 2 × 2 faces before a turned camera, wider than it sees on the left and as wide as half of the image on the right.
Scene wallScene() {
  Scene scene;
  scene.materials.resize(1);
  scene.materials[0].ior.value = 1;
  Light sky;
  sky.kind = Light::Kind::Dome;
  sky.path = "/sky";
  sky.radiance = {1, 1, 1};
  scene.lights = {sky};
  Mesh mesh;
  mesh.path = "/wall";
  mesh.scheme = SubdivisionScheme::None;
  std::vector<Vec4f> ramp;
  std::vector<Vec2f> st;
  std::vector<Vec3f> color;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) {
      const Vec3f p{float(3 * i - 5) + kAside, float(3 * j - 3) + kAside, 0};
      mesh.points.push_back(p);
      ramp.push_back({p.x, p.y, p.x + p.y, 2});
      st.push_back({p.x * 2, 1 - p.y});
      color.push_back({p.y, p.x, 0.5f});
    }
  mesh.face_vertex_counts = {4, 4, 4, 4};
  mesh.face_vertex_indices = {0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 6, 4, 5, 8, 7};
  mesh.primvars = {{"ramp", Interpolation::Vertex, ramp, {}}};
  mesh.texcoords = {{"st", Interpolation::Vertex, st, {}}};
  mesh.display_color = {"displayColor", Interpolation::Vertex, color, {}};
  place(scene, quad("/unseen", {100, 100, 100}, {1, 0, 0}, {0, 1, 0}, 0), {});
  place(scene, mesh, {});
  // Turned by 30 degrees around y, and somewhere else.
  const double c = std::sqrt(0.75), s = 0.5;
  scene.camera.to_world = {{c, 0, -s}, {0, 1, 0}, {s, 0, c}, {7, -3, 11}};
  scene.instances[1].to_world = scene.camera.to_world;
  scene.instances[1].to_world.origin = scene.camera.to_world.point({0, 0, -kDepth});
  scene.camera.half_tangent = {kHalf, kHalf};
  return scene;
}

Settings wallSettings() {
  Settings settings = smallFrame();
  settings.width = settings.height = uint32_t(kSide);
  settings.samples = 3;
  settings.occlusion_samples = 1;
  settings.aovs = {{Kind::Position, "P", "", 0},          {Kind::EyePosition, "Peye", "", 0},
                   {Kind::EyeNormal, "Neye", "", 0},      {Kind::Primvar, "ramp", "ramp", 4},
                   {Kind::Primvar, "st", "st", 3},        {Kind::Primvar, "color", "displayColor", 3},
                   {Kind::Primvar, "nothing", "none", 1}, {Kind::PrimId, "prim", "", 0},
                   {Kind::InstanceId, "instance", "", 0}, {Kind::ElementId, "element", "", 0}};
  return settings;
}

// Of a place on the film: x to the right, y up.
struct WallPoint {
  double x, y;
};
WallPoint wallPoint(double film_x, double film_y) {
  return {(film_x / kSide * 2 - 1) * double(kHalf) * kDepth, (1 - film_y / kSide * 2) * double(kHalf) * kDepth};
}
constexpr double kWallEnd = 1 + double(kAside);  // right border; the others are out of sight

class AovsTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    const auto vulkan = device();
    Scene scene = wallScene();
    settings_ = wallSettings();
    frame_ = render(scene, settings_, *vulkan);
  }
  static size_t pixels() { return size_t(kSide) * kSide; }
  static const FilmImages& images() { return frame_.images; }
  static const AovImage& aov(const char* name) {
    for (size_t i = 0; i < settings_.aovs.size(); ++i)
      if (settings_.aovs[i].name == name) return images().aovs[i];
    throw std::out_of_range(name);
  }
  static Vec3d value(const char* name, size_t pixel) {
    const float* v = &aov(name).values[3 * pixel];
    return {v[0], v[1], v[2]};
  }
  static inline Settings settings_;
  static inline Frame frame_;
};

TEST_F(AovsTest, PositionsAreOfASampleOfThePixel) {
  const Scene scene = wallScene();
  for (size_t i = 0; i < pixels(); ++i) {
    const double x = double(i % kSide), y = double(i / kSide);
    const Vec3d eye = value("Peye", i);
    if (std::isinf(images().depth[i])) {
      EXPECT_EQ(eye, Vec3d{});
      EXPECT_EQ(value("P", i), Vec3d{});
      continue;
    }
    EXPECT_NEAR(eye.z, -kDepth, 1e-5);
    EXPECT_NEAR(eye.z, -double(images().depth[i]), 1e-5);
    const WallPoint first = wallPoint(x, y), last = wallPoint(x + 1, y + 1);
    EXPECT_TRUE(eye.x > first.x - 1e-5 && eye.x < last.x + 1e-5) << i;
    EXPECT_TRUE(eye.y < first.y + 1e-5 && eye.y > last.y - 1e-5) << i;
    const Vec3d world = scene.camera.to_world.point(eye);
    EXPECT_LT(length(world - value("P", i)), 1e-5);
  }
}

TEST_F(AovsTest, EyeNormalsAreWeightedByAlpha) {
  for (size_t i = 0; i < pixels(); ++i) {
    const Vec3d n = value("Neye", i);
    EXPECT_NEAR(n.x, 0, 1e-6);
    EXPECT_NEAR(n.y, 0, 1e-6);
    EXPECT_NEAR(n.z, double(images().alpha[i]), 1e-5);
  }
  EXPECT_EQ(images().alpha[0], 1.0f);
  EXPECT_EQ(images().alpha[kSide - 1], 0.0f);
}

// Returns the numbers of pixels on each face. The aovs are those of wallSettings().
std::array<int, 4> expectIdsOfTheWall(const FilmImages& images) {
  const AovImage &eye = images.aovs[1], &prim = images.aovs[7], &instance = images.aovs[8], &element = images.aovs[9];
  std::array<int, 4> found{};
  for (size_t i = 0; i < images.depth.size(); ++i) {
    const bool hit = !std::isinf(images.depth[i]);
    EXPECT_EQ(prim.ids[i], hit ? 1 : -1) << i;
    EXPECT_EQ(instance.ids[i], hit ? 1 : -1) << i;
    const int32_t face = (eye.values[3 * i] > kAside - 2 ? 1 : 0) + (eye.values[3 * i + 1] > kAside ? 2 : 0);
    EXPECT_EQ(element.ids[i], hit ? face : -1) << i;
    if (hit) ++found[size_t(face)];
  }
  return found;
}

TEST_F(AovsTest, IdsAreThoseOfTheClosestSample) {
  const std::array<int, 4> found = expectIdsOfTheWall(images());
  EXPECT_GT(found[1], 100);
  EXPECT_GT(found[3], 100);
}

// Sums in double over the samples that the strata say there are.
TEST_F(AovsTest, PrimvarsAreFilteredAsTheNormalsAre) {
  const Strata strata(settings_.samples);
  const int32_t pad = int32_t(filterPad(settings_.filter_radius_pixels));
  const auto weight = [&](double x) {
    return double(filterWeight(settings_.filter, settings_.filter_radius_pixels, float(x)));
  };
  for (int32_t y = 0; y < kSide; ++y)
    for (int32_t x = 0; x < kSide; ++x) {
      double total = 0;
      std::array<double, 10> sums{};
      for (int32_t py = std::max(y - pad, 0); py <= std::min(y + pad, kSide - 1); ++py)
        for (int32_t px = std::max(x - pad, 0); px <= std::min(x + pad, kSide - 1); ++px) {
          const uint32_t key = pixelKey(settings_, px, py);
          const Strata::Pattern pattern = strata.pattern(key, settings_.seed);
          for (uint32_t s = 0; s < strata.count(); ++s) {
            const uint32_t position =
                jitteredPosition(pattern.column[s], pattern.row[s], strata.across(), key, s, settings_.seed);
            const double film_x = double(filmX(px, position)), film_y = double(filmY(py, position));
            const double w = weight(x + 0.5 - film_x) * weight(y + 0.5 - film_y);
            total += w;
            const WallPoint p = wallPoint(film_x, film_y);
            if (p.x >= kWallEnd) continue;
            const double values[] = {p.x, p.y, p.x + p.y, 2, p.x * 2, 1 - p.y, 0, p.y, p.x, 0.5};
            for (size_t c = 0; c < 10; ++c) sums[c] += w * values[c];
          }
        }
      const size_t i = size_t(y) * kSide + size_t(x);
      for (size_t c = 0; c < 4; ++c) ASSERT_NEAR(double(aov("ramp").values[4 * i + c]), sums[c] / total, 1e-4) << i;
      for (size_t c = 0; c < 3; ++c) {
        ASSERT_NEAR(double(aov("st").values[3 * i + c]), sums[4 + c] / total, 1e-4) << i;
        ASSERT_NEAR(double(aov("color").values[3 * i + c]), sums[7 + c] / total, 1e-4) << i;
      }
      ASSERT_EQ(aov("nothing").values[i], 0.0f);
    }
}

// First hits are what lies behind presence.
TEST_F(AovsTest, WhatIsPassedIsNotSeen) {
  const auto vulkan = device();
  Scene scene = wallScene();
  Material ghost = scene.materials[0];
  ghost.path = "/ghost";
  ghost.opacity.value = 0;
  ghost.opacity_mode = OpacityMode::Presence;
  scene.materials.push_back(ghost);
  place(scene, quad("/ghost", {-9, -9, 0}, {18, 0, 0}, {0, 18, 0}, 1), {});
  scene.instances[2].to_world = scene.camera.to_world;
  scene.instances[2].to_world.origin = scene.camera.to_world.point({0, 0, -1});
  const Frame frame = render(scene, settings_, *vulkan);
  const std::array<int, 4> found = expectIdsOfTheWall(frame.images);
  EXPECT_GT(found[1], 100);
  for (size_t i = 0; i < pixels(); ++i) {
    const bool hit = !std::isinf(images().depth[i]);
    ASSERT_NEAR(double(frame.images.aovs[1].values[3 * i + 2]), hit ? -kDepth : 0, 1e-4);
    for (size_t c = 0; c < 4; ++c)
      ASSERT_NEAR(frame.images.aovs[3].values[4 * i + c], images().aovs[3].values[4 * i + c], 1e-4);
  }
}

// What is asked for changes nothing else, and makes nothing that was not asked for.
TEST_F(AovsTest, OtherImagesStayAsTheyAre) {
  const auto vulkan = device();
  Scene scene = wallScene();
  Settings settings = wallSettings();
  settings.aovs.clear();
  const Frame without = render(scene, settings, *vulkan);
  EXPECT_TRUE(without.images.aovs.empty());
  expectSameImages(frame_, without, "without aovs ");
  EXPECT_EQ(without.statistics.rays_traced, frame_.statistics.rays_traced);
}

}  // namespace
}  // namespace encore
