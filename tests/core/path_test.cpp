#include "core/path/path.h"

#include <gtest/gtest.h>

#include "core/shade/bsdf.h"
#include "core/shade/lights.h"
#include "path_world.h"

namespace encore {
namespace {

using namespace test;

TEST(Layers, ExistWhereAMaterialInUseFeedsThem) {
  World world;
  world.stage.add(wall(-5, 1), kMatte);
  const auto layers = [&] { return sceneLayers(world.stage.scene, world.settings); };
  EXPECT_EQ(layers(), std::vector<Layer>{Layer::Direct});
  world.stage.addMesh(wall(-6, 1), kGlass);  // not placed
  EXPECT_EQ(layers(), std::vector<Layer>{Layer::Direct});
  world.stage.scene.instances[0].material = kMirror;
  EXPECT_EQ(layers(), (std::vector<Layer>{Layer::Direct, Layer::Reflection}));
  world.stage.scene.instances[0].material = -1;
  world.stage.scene.meshes[0].face_materials = {kGlass};
  EXPECT_EQ(layers(), (std::vector<Layer>{Layer::Direct, Layer::Reflection, Layer::Refraction}));
  world.stage.scene.meshes[0].face_materials = {-1};
  world.stage.scene.meshes[0].material = kMirror;
  EXPECT_EQ(layers(), (std::vector<Layer>{Layer::Direct, Layer::Reflection}));
  world.settings.max_bounces = 0;
  EXPECT_EQ(layers(), std::vector<Layer>{Layer::Direct});
  EXPECT_STREQ(layerName(Layer::Direct), "direct");
  EXPECT_STREQ(layerName(Layer::Reflection), "reflection");
  EXPECT_STREQ(layerName(Layer::Refraction), "refraction");
}

TEST(FirstHits, AreTracedOnceForActiveSlotsOnly) {
  World world;
  world.stage.add(wall(-5, 0.5f), kMatte);
  world.build();
  Batch batch;
  for (uint32_t i = 0; i < 100; ++i) {
    batch.first.push_back(filmPoint(float(i % 32) + 0.5f, 16.25f, i, 0));
    if (i % 3 == 0) batch.first.back().pixel = kNoPixel;
    batch.first.back().hit.instance = 9;  // left over
  }
  batch.ends = {30, 30, 100};
  batch.vertices.resize(100);
  traceFirstHits(world.context(), world.camera(), batch.first, batch.ends);
  EXPECT_EQ(world.rays_traced, 66u);
  for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
    follow(world, layer, batch);
    for (uint32_t i = 0; i < 100; ++i) {
      const FirstHit& f = batch.first[i];
      const Ray ray = world.camera().ray(f);
      const bool expected = f.active() && std::abs(ray.direction.x / ray.direction.z) < 0.1f;
      EXPECT_EQ(f.hit.valid(), expected) << i;
      EXPECT_EQ(batch.vertices[i].hit.valid(), expected && layer == Layer::Direct);
      EXPECT_EQ(batch.vertices[i].throughput, expected && layer == Layer::Direct ? (Vec3f{1, 1, 1}) : Vec3f{});
      EXPECT_EQ(batch.vertices[i].pixel, f.pixel);
    }
  }
  EXPECT_EQ(world.rays_traced, 66u);
}

TEST(Direct, ThroughputIsTheExactAbsorptionWeight) {
  World world;
  Material plastic;
  plastic.roughness = {0.0f};
  world.stage.scene.materials[kMatte] = plastic;
  world.stage.add(wall(-5, 10), kMatte);
  world.build();
  Batch batch = film(world, 1);
  follow(world, Layer::Direct, batch);
  for (const PathVertex& v : batch.vertices)
    EXPECT_NEAR(v.throughput.x, 1 - fresnelDielectric(-v.direction.z, 1.5f), 1e-6);
}

// A mirror in the plane y = -1 shows the wall behind the camera's mirror image.
TEST(Reflection, PlaneMirrorShowsTheExactImage) {
  World world;
  DicedMesh floor;
  test::addQuad(floor, {-100, -1, 100}, {100, -1, 100}, {100, -1, -100}, {-100, -1, -100});
  world.stage.add(floor, kMirror);
  world.stage.scene.materials[kMirror] = mirror({0.9f, 0.5f, 0.2f});
  const uint32_t target = world.stage.add(wall(-40, 100), kMatte);
  world.build();
  Batch batch = film(world, 4);
  follow(world, Layer::Reflection, batch);
  uint32_t reflected = 0;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const PathVertex& v = batch.vertices[i];
    const FirstHit& f = batch.first[i];
    if (f.hit.instance != 0) {
      EXPECT_FALSE(v.hit.valid());
      EXPECT_EQ(v.throughput, Vec3f{});
      continue;
    }
    ASSERT_EQ(v.hit.instance, target);
    const Vec3d d = toDouble(direction(world, f)), image{d.x, -d.y, d.z};
    const double t = -40 / d.z;
    const Vec3d expected{image.x * t, -2 + image.y * t, -40};
    EXPECT_LT(length(position(world, v) - expected), 4e-5);
    EXPECT_LT(length(toDouble(v.direction) - image), 1e-6);
    const Vec3f schlick = fresnelSchlick(-direction(world, f).y, {0.9f, 0.5f, 0.2f});
    EXPECT_LT(length(v.throughput - schlick), 1e-5f);
    ++reflected;
  }
  EXPECT_GT(reflected, 500u);
}

// A slab of thickness d shifts what lies behind by Snell's amount and keeps its direction.
TEST(Refraction, SlabShiftsByTheAmountOfSnell) {
  World world;
  world.settings.max_bounces = 2;
  const double thickness = 2, ior = 1.5;
  world.stage.add(test::box({-50, -50, -5}, {50, 50, -3}), kGlass);
  const uint32_t target = world.stage.add(wall(-9, 100), kMatte);
  world.build();
  Batch batch = film(world, 4);
  follow(world, Layer::Refraction, batch);
  size_t through = 0;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const PathVertex& v = batch.vertices[i];
    if (!v.hit.valid() || v.hit.instance != target) continue;  // reflected inside
    ++through;
    const Vec3d d = normalize(toDouble(direction(world, batch.first[i])));
    const double across = std::sqrt(d.x * d.x + d.y * d.y);
    const double cosine = -d.z, sine = across, inner = sine / ior;
    const double tangent = sine / cosine, inner_tangent = inner / std::sqrt(1 - inner * inner);
    const double radius = tangent * 7 + inner_tangent * thickness;
    const Vec3d expected{d.x / across * radius, d.y / across * radius, -9};
    EXPECT_LT(length(position(world, v) - expected), 5e-5);
    EXPECT_LT(length(toDouble(v.direction) - d), 1e-6);
    // The forced bounce has its exact weight; the second one's weight cancels with its probability.
    EXPECT_NEAR(v.throughput.x, 1 - fresnelDielectric(float(cosine), 1.5f), 1e-5);
  }
  EXPECT_NEAR(double(through) / double(batch.vertices.size()), 0.96, 0.01);
}

// A right-angled prism of glass turns a ray by 90 degrees without loss inside.
TEST(Refraction, PrismReflectsTotally) {
  World world;
  DicedMesh prism;
  const float l = 1, w = 5;
  // Legs: the face z = -3 towards the camera, and x = l. Hypotenuse from (-l, ·, -3) to (l, ·, -5).
  test::addQuad(prism, {-l, -w, -3}, {l, -w, -3}, {l, w, -3}, {-l, w, -3});
  test::addQuad(prism, {l, -w, -3}, {l, -w, -5}, {l, w, -5}, {l, w, -3});
  test::addQuad(prism, {l, -w, -5}, {-l, -w, -3}, {-l, w, -3}, {l, w, -5});
  world.stage.add(prism, kGlass);
  DicedMesh side;
  test::addQuad(side, {9, -50, -50}, {9, -50, 50}, {9, 50, 50}, {9, 50, -50});
  const uint32_t target = world.stage.add(side, kMatte);
  world.stage.scene.camera.half_tangent = {1e-3f, 1e-3f};
  world.build();
  Batch batch = film(world, 4);
  follow(world, Layer::Refraction, batch);
  size_t turned = 0;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const PathVertex& v = batch.vertices[i];
    if (!v.hit.valid()) continue;
    ASSERT_EQ(v.hit.instance, target);
    if (v.throughput.x > 0.961f) continue;
    ++turned;
    EXPECT_NEAR(v.direction.x, 1, 1e-5);
    EXPECT_NEAR(v.throughput.x, 0.96f, 1e-4);
    const Vec3d p = position(world, v);
    EXPECT_NEAR(p.z, -4, 0.02);
    EXPECT_NEAR(p.x, 9, 1e-5);
  }
  EXPECT_NEAR(double(turned) / double(batch.vertices.size()), 0.96, 0.01);
}

TEST(Time, StaysWithThePath) {
  World world;
  world.stage.add(wall(-5, 50), kMirror);
  DicedMesh back;
  test::addQuad(back, {90, -90, 5}, {-90, -90, 5}, {-90, 90, 5}, {90, 90, 5});
  world.stage.add(back, kMatte);
  world.stage.scene.camera.motion = {{}, test::translation({2, 0, 0})};
  world.settings.reuse_time_weight = 0.5f, world.settings.reuse_direction_weight = 3;
  world.build();
  Batch batch = film(world, 4);
  follow(world, Layer::Reflection, batch);
  float earliest = 1, latest = 0;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const PathVertex& v = batch.vertices[i];
    ASSERT_TRUE(v.hit.valid());
    const float time = world.camera().time(CameraRays::sampleOf(batch.first[i]));
    EXPECT_EQ(v.hit.time, time);
    EXPECT_EQ(v.aspect, (Vec4f{3 * v.direction.x, 3 * v.direction.y, 3 * v.direction.z, 0.5f * time}));
    // The camera was that far to the right.
    const Vec3f d = direction(world, batch.first[i]);
    EXPECT_NEAR(position(world, v).x, double(2 * time + d.x / -d.z * 15), 1e-4);
    earliest = std::min(earliest, time), latest = std::max(latest, time);
  }
  EXPECT_LT(earliest, 0.01f);
  EXPECT_GT(latest, 0.99f);
  world.settings.method = Method::Reference;
  follow(world, Layer::Reflection, batch);
  for (const PathVertex& v : batch.vertices) EXPECT_EQ(v.aspect, Vec4f{});
}

// Between two mirrors the number of bounces decides who is seen.
TEST(Bounces, AreLimitedAfterTheFirstHit) {
  World world;
  world.stage.scene.camera.half_tangent = {0.01f, 0.01f};
  world.stage.scene.camera.to_world = test::rotation({0, 1, 0}, -0.3);
  DicedMesh mirrors = wall(-1, 100);
  test::addQuad(mirrors, {100, -100, 1}, {-100, -100, 1}, {-100, 100, 1}, {100, 100, 1});
  world.stage.add(mirrors, kMirror);
  DicedMesh end;  // x = 3: met after several reflections
  test::addQuad(end, {3, -9, -1}, {3, -9, 1}, {3, 9, 1}, {3, 9, -1});
  const uint32_t target = world.stage.add(end, kMatte);
  world.build();
  Batch batch = film(world, 1);
  // Along z the ray needs 3 / tan(0.3) = 9.7 units to get to x = 3: at z = -1, 1, -1, 1, -1 it is reflected.
  for (uint32_t bounces = 0; bounces <= 7; ++bounces) {
    world.settings.max_bounces = bounces;
    follow(world, Layer::Reflection, batch);
    for (const PathVertex& v : batch.vertices) {
      EXPECT_EQ(v.hit.valid(), bounces >= 5) << bounces;
      if (v.hit.valid()) {
        EXPECT_EQ(v.hit.instance, target);
      }
      EXPECT_NEAR(v.throughput.x, bounces >= 5 ? 1 : 0, 1e-5) << bounces;
    }
  }
}

TEST(Lights, EndPathsThatMeetThem) {
  World world;
  DicedMesh back = wall(-5, 100);
  world.stage.add(back, kMirror);
  Light panel;  // behind the camera, shining along -Z
  panel.kind = Light::Kind::Rect;
  panel.radiance = {2, 3, 4}, panel.specular = 0.5f;
  panel.centre = {0, 0, 10}, panel.half_u = {1, 0, 0}, panel.half_v = {0, 1, 0};
  Light sky = dome({0.25f, 0.5f, 0.75f});
  world.stage.scene.lights = {panel, sky};
  world.build();
  Batch batch = film(world, 2);
  follow(world, Layer::Reflection, batch);
  uint32_t on_panel = 0;
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const Vec3f d = direction(world, batch.first[i]);
    const float x = d.x / -d.z * 20, y = d.y / -d.z * 20;
    if (std::abs(std::max(std::abs(x), std::abs(y)) - 1) < 1e-3f) continue;
    const bool panel_seen = std::abs(x) < 1 && std::abs(y) < 1;
    on_panel += panel_seen;
    EXPECT_FALSE(batch.vertices[i].hit.valid());
    EXPECT_LT(length(batch.vertices[i].throughput - (panel_seen ? panel.radiance * 0.5f : sky.radiance)), 1e-5f);
  }
  EXPECT_GT(on_panel, 10u);
}

TEST(Lights, AreSeenByTheCameraWhereAskedFor) {
  World world;
  world.stage.add(wall(-5, 0.5f), kMirror);
  Light ball;
  ball.kind = Light::Kind::Sphere;
  ball.radiance = {7, 7, 7};
  ball.centre = {0.2, 0, -3}, ball.radius = 0.1f;
  world.stage.scene.lights = {ball, dome({0.5f, 0.5f, 0.5f})};
  world.build();
  Batch batch = film(world, 2);
  for (const bool lights : {false, true})
    for (const bool sky : {false, true}) {
      world.settings.lights_visible = lights, world.settings.dome_light_visible = sky;
      for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
        follow(world, layer, batch);
        uint32_t on_ball = 0;
        for (size_t i = 0; i < batch.vertices.size(); ++i) {
          const FirstHit& f = batch.first[i];
          const bool ball_seen = lights && intersectLight(ball, world.camera().origin(), direction(world, f)) > 0;
          on_ball += ball_seen;
          Vec3f expected{};
          if (layer == Layer::Direct) {
            if (ball_seen)
              expected = ball.radiance;
            else if (sky && !f.hit.valid())
              expected = {0.5f, 0.5f, 0.5f};
          } else if (layer == Layer::Reflection && f.hit.valid() && !ball_seen) {
            expected = {0.5f, 0.5f, 0.5f};  // or the ball, from behind
          }
          const PathVertex& v = batch.vertices[i];
          EXPECT_FALSE(v.hit.valid());
          if (v.throughput.x > 1 && layer == Layer::Reflection && !ball_seen) continue;
          EXPECT_LT(length(v.throughput - expected), 1e-5f);
        }
        EXPECT_EQ(on_ball > 10, lights);
      }
    }
}

}  // namespace
}  // namespace encore
