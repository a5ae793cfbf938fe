#include "core/path/path.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstring>

#include "core/path/differentials.h"
#include "core/path/path_random.h"
#include "core/shade/lights.h"
#include "shapes.h"

namespace encore {
namespace {

using test::Stage;
using test::Stream;

Device& device() {
  static const std::shared_ptr<Device> shared = Device::create();
  return *shared;
}

Material matte() {  // nothing but diffuse
  Material m;
  m.ior = {1.0f};
  return m;
}
Material mirror(Vec3f tint = {1, 1, 1}) {
  Material m;
  m.metallic = {1.0f}, m.roughness = {0.0f}, m.diffuse_color = {tint};
  return m;
}
Material glass(float ior = 1.5f) {
  Material m;
  m.opacity = {0.0f}, m.roughness = {0.0f}, m.ior = {ior};
  return m;
}
enum : int32_t { kMatte = 0, kMirror = 1, kGlass = 2 };

// A stage with everything that tracing paths needs. Camera: at the origin, along -Z.
struct World {
  Stage stage;
  Settings settings;
  std::unique_ptr<TraceScene> trace;
  std::unique_ptr<Patterns> patterns;
  std::atomic<uint64_t> rays_traced{0};

  World() {
    stage.scene.materials = {matte(), mirror(), glass()};
    settings.width = settings.height = 32;
    stage.scene.camera.half_tangent = {0.3f, 0.3f};
  }
  void build() {
    trace = std::make_unique<TraceScene>(stage.scene, stage.diced);
    patterns = std::make_unique<Patterns>(device(), stage.scene);
  }
  ShadeContext context() { return {stage.scene, settings, *trace, *patterns, rays_traced}; }
  CameraRays camera() const { return CameraRays(stage.scene.camera, settings); }
};

struct Batch {
  std::vector<FirstHit> first;
  std::vector<uint32_t> ends;
  std::vector<PathVertex> vertices;
};

FirstHit filmPoint(float x, float y, uint32_t pixel, uint32_t sample) {
  FirstHit f;
  f.film_x = x, f.film_y = y, f.pixel = pixel, f.sample = sample, f.active = true;
  return f;
}

// per_pixel jittered samples in every pixel, in blocks of `block` pixels.
Batch film(World& world, uint32_t per_pixel, uint32_t block = 64) {
  Batch batch;
  const uint32_t width = world.settings.width, pixels = width * world.settings.height;
  for (uint32_t p = 0; p < pixels; ++p) {
    for (uint32_t s = 0; s < per_pixel; ++s) {
      const Vec2f u = sobol2(s, p + 1);
      batch.first.push_back(filmPoint(float(p % width) + u.x, float(p / width) + u.y, p, s));
    }
    if (p % block == block - 1 || p == pixels - 1) batch.ends.push_back(uint32_t(batch.first.size()));
  }
  batch.vertices.resize(batch.first.size());
  traceFirstHits(world.context(), world.camera(), batch.first, batch.ends);
  return batch;
}

void follow(World& world, Layer layer, Batch& batch) {
  tracePaths(world.context(), world.camera(), layer, batch.first, batch.ends, batch.vertices);
}

bool sameBytes(const std::vector<PathVertex>& a, const std::vector<PathVertex>& b) {
  const auto same = [](const PathVertex& p, const PathVertex& q) {
    return p.hit.instance == q.hit.instance && p.hit.mesh == q.hit.mesh && p.hit.triangle == q.hit.triangle &&
           p.hit.b1 == q.hit.b1 && p.hit.b2 == q.hit.b2 && p.hit.t == q.hit.t && p.throughput == q.throughput &&
           p.direction == q.direction && p.dpdx == q.dpdx && p.dpdy == q.dpdy && p.pixel == q.pixel &&
           p.sample == q.sample;
  };
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), same);
}

DicedMesh wall(float z, float size) {  // faces +Z
  DicedMesh mesh;
  test::addQuad(mesh, {-size, -size, z}, {size, -size, z}, {size, size, z}, {-size, size, z});
  return mesh;
}

Light dome(Vec3f radiance) {
  Light light;
  light.kind = Light::Kind::Dome;
  light.radiance = radiance;
  return light;
}

Vec3d position(const World& world, const PathVertex& v) {
  return toDouble(world.trace->surface(v.hit, v.direction).position);
}

// ---------------------------------------------------------------------------------------------------------

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
    batch.first.back().active = i % 3 != 0;
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
      const Ray ray = world.camera().ray(f.film_x, f.film_y);
      const bool expected = f.active && std::abs(ray.direction.x / ray.direction.z) < 0.1f;
      EXPECT_EQ(f.hit.valid(), expected) << i;
      EXPECT_EQ(batch.vertices[i].hit.valid(), expected && layer == Layer::Direct);
      EXPECT_EQ(batch.vertices[i].throughput, expected && layer == Layer::Direct ? (Vec3f{1, 1, 1}) : Vec3f{});
      EXPECT_EQ(batch.vertices[i].pixel, i);
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
    const Vec3d d = toDouble(f.direction), image{d.x, -d.y, d.z};
    const double t = -40 / d.z;
    const Vec3d expected{image.x * t, -2 + image.y * t, -40};
    EXPECT_LT(length(position(world, v) - expected), 4e-5);
    EXPECT_LT(length(toDouble(v.direction) - image), 1e-6);
    const Vec3f schlick = fresnelSchlick(-f.direction.y, {0.9f, 0.5f, 0.2f});
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
    const Vec3d d = toDouble(batch.first[i].direction);
    const double cosine = -d.z, sine = std::sqrt(1 - cosine * cosine), inner = sine / ior;
    const double tangent = sine / cosine, inner_tangent = inner / std::sqrt(1 - inner * inner);
    const double radius = tangent * 7 + inner_tangent * thickness;
    const double across = std::sqrt(d.x * d.x + d.y * d.y);
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
    const Vec3f d = batch.first[i].direction;
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
          const bool ball_seen = lights && intersectLight(ball, f.origin, f.direction) > 0;
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

// ---------------------------------------------------------------------------------------------------------

// Mean over the film of what the three layers carry when everything that absorbs has radiance 1.
struct Total {
  Vec3d mean;
  double deviation = 0;  // of the mean, largest channel
};
Total sumOfLayers(World& world, Batch& batch) {
  std::vector<Vec3d> sums(batch.first.size());
  for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
    follow(world, layer, batch);
    for (size_t i = 0; i < sums.size(); ++i) sums[i] += toDouble(batch.vertices[i].throughput);
  }
  Total total;
  Vec3d squares;
  for (const Vec3d& s : sums) total.mean += s, squares += s * s;
  const double n = double(sums.size());
  total.mean = total.mean / n;
  total.deviation = std::sqrt(std::max(0.0, maxComponent(squares / n - total.mean * total.mean)) / n);
  return total;
}

// Glass in a white sky is invisible: nothing is lost and nothing gained. Facets trap light for very long.
TEST(Energy, GlassInAWhiteSkyAddsUpToOne) {
  for (const bool smooth : {false, true}) {
    World world;
    world.settings.max_bounces = 400, world.settings.dome_light_visible = true;
    world.stage.add(test::sphere(24, smooth), kGlass, test::translation({0, 0, -3}));
    world.stage.scene.lights = {dome({1, 1, 1})};
    world.build();
    Batch batch = film(world, 64);
    const Total total = sumOfLayers(world, batch);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(total.mean[c], 1, 5 * total.deviation + 1e-3) << (smooth ? "smooth" : "flat");
    EXPECT_LT(total.deviation, 5e-3);
  }
}

TEST(Energy, NeverGrows) {
  Stream stream(77);
  for (int round = 0; round < 8; ++round) {
    World world;
    std::vector<Material>& materials = world.stage.scene.materials;
    materials.clear();
    for (int i = 0; i < 6; ++i) {
      Material m;
      m.diffuse_color = {{stream.next(), stream.next(), stream.next()}};
      m.roughness = {i % 2 ? 0.0f : stream.next(0, 0.3f)};
      m.ior = {stream.next(1, 2)};
      m.opacity = {i % 3 == 0 ? stream.next() : 1.0f};
      m.metallic = {i % 3 == 1 ? stream.next() : 0.0f};
      m.clearcoat = {i % 3 == 2 ? stream.next() : 0.0f};
      m.clearcoat_roughness = {stream.next(0, 0.3f)};
      m.use_specular_workflow = i == 4;
      m.specular_color = {{stream.next(), stream.next(), stream.next()}};
      materials.push_back(m);
    }
    for (int i = 0; i < 12; ++i) {
      const Vec3d place{stream.next(-1.5f, 1.5f), stream.next(-1.5f, 1.5f), stream.next(-7, -4)};
      const Affine3d m = test::translation(place) * test::rotation(toDouble(stream.onSphere()), stream.next(0, 6)) *
                         test::scaling({stream.next(0.2f, 1), stream.next(0.2f, 1), stream.next(-1, -0.2f)});
      world.stage.add(i % 2 ? test::sphere(8) : test::box({-1, -1, -1}, {1, 1, 1}), i % 6, m);
    }
    world.settings.dome_light_visible = true;
    world.settings.max_bounces = 8;
    world.stage.scene.lights = {dome({1, 1, 1})};
    world.build();
    Batch batch = film(world, 16);
    const Total total = sumOfLayers(world, batch);
    for (int c = 0; c < 3; ++c) {
      EXPECT_LE(total.mean[c], 1 + 4 * total.deviation) << round;
      EXPECT_GT(total.mean[c], 0.5) << round;
    }
  }
}

// ---------------------------------------------------------------------------------------------------------

// The twin: Listing 2 as printed, one path at a time.
struct Twin {
  World& world;
  ShadeContext context = world.context();
  Layer layer;
  PathVertex vertex;

  void pathTrace(Vec3f color, Hit hit, Vec3f direction, uint32_t bounce) {
    const Scene& scene = world.stage.scene;
    const SurfacePoint point = world.trace->surface(hit, direction);
    const Material& material = scene.materials[size_t(point.material)];
    const Lobes lobes = makeLobes(material, world.patterns->constantPath(point.material), point.side == 1,
                                  world.settings.roughness_limit);
    const Vec3f ng = point.side ? -point.ng : point.ng, wo = -direction;
    Vec3f n = point.side ? -point.ns : point.ns;
    if (dot(n, wo) <= 0) n = ng;
    const EffectWeights w =
        effectWeights(lobes, dot(n, wo), viewWeightInShading(material, world.settings.roughness_limit, false));
    const BounceRandom random(world.settings.seed, vertex.pixel, vertex.sample, layer, bounce);
    const float r = maxComponent(w.reflection), t = maxComponent(w.refraction), a = maxComponent(w.absorption);
    const float x = random.choice() * (r + t + a);
    int effect = x < r ? 1 : x < r + t ? 2 : 0;
    float probability = (effect == 1 ? r : effect == 2 ? t : a) / (r + t + a);
    if (bounce == 0) effect = int(layer), probability = 1;
    if (bounce == world.settings.max_bounces) {
      if (bounce == 0 && effect != 0) return;
      effect = 0, probability = 1;
    }
    if (effect == 0) {
      vertex.hit = hit, vertex.direction = direction;
      vertex.throughput = color * (1 / probability) * w.absorption;
      if (!(maxComponent(vertex.throughput) > 0)) vertex.hit = {}, vertex.throughput = {};
      return;
    }
    const auto u = random.lobe();
    Bounce out;
    for (const Vec3f& normal : {n, ng}) {
      out = effect == 1 ? sampleReflection(lobes, normal, wo, u.data()) : sampleRefraction(lobes, normal, wo, u.data());
      if (!out.valid || (dot(out.direction, ng) > 0) == (effect == 1)) break;
      out.valid = false;
    }
    if (!out.valid) return;
    color = color * (1 / probability) * out.weight;
    const std::vector<Ray> ray{{point.offsetOrigin(out.direction), 0, out.direction}};
    std::vector<Hit> next(1);
    world.trace->intersect(ray, next, Coherence::Incoherent);
    const LightHit light = intersectLights(scene.lights, ray[0].origin, out.direction, next[0].t);
    if (light.valid) {
      vertex.throughput = color * light.radiance;
    } else if (next[0].valid() && maxComponent(color) > 0) {
      pathTrace(color, next[0], out.direction, bounce + 1);
    }
  }
};

void mix(World& world) {
  std::vector<Material>& materials = world.stage.scene.materials;
  Material coated;
  coated.clearcoat = {1.0f}, coated.roughness = {0.2f}, coated.clearcoat_roughness = {0.0f};
  Material frosted = glass(1.3f);
  frosted.roughness = {0.25f}, frosted.opacity = {0.2f};
  materials.push_back(coated), materials.push_back(frosted);
  Stream stream(5);
  for (int i = 0; i < 10; ++i)
    world.stage.add(i % 3 ? test::sphere(10) : test::box({-1, -1, -1}, {1, 1, 1}), i % 5,
                    test::translation({stream.next(-1, 1), stream.next(-1, 1), stream.next(-6, -3)}) *
                        test::rotation(toDouble(stream.onSphere()), 1) * test::scaling({0.4, 0.4, 0.4}));
  world.stage.add(wall(-9, 6), kMatte);
  world.stage.scene.lights = {dome({0.5f, 0.6f, 0.7f})};
}

TEST(Wavefront, AgreesWithThePrintedRecursion) {
  World world;
  mix(world);
  world.build();
  Batch batch = film(world, 8);
  for (const uint32_t bounces : {0u, 1u, 2u, 5u})
    for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
      world.settings.max_bounces = bounces;
      follow(world, layer, batch);
      uint32_t different = 0, alive = 0;
      for (size_t i = 0; i < batch.first.size(); ++i) {
        const FirstHit& f = batch.first[i];
        Twin twin{world, world.context(), layer, {}};
        twin.vertex.pixel = f.pixel, twin.vertex.sample = f.sample;
        if (f.hit.valid()) twin.pathTrace({1, 1, 1}, f.hit, f.direction, 0);
        const PathVertex &a = batch.vertices[i], &b = twin.vertex;
        const bool same = a.hit.instance == b.hit.instance && a.hit.triangle == b.hit.triangle &&
                          length(a.throughput - b.throughput) <= 1e-4f * (1 + length(b.throughput));
        different += !same, alive += maxComponent(b.throughput) > 0;
      }
      // Other lanes in the packet may settle a tie at an edge differently.
      EXPECT_LE(different, batch.first.size() / 1000) << layerName(layer) << " " << bounces;
      if (layer == Layer::Direct || bounces > 0) {
        EXPECT_GT(alive, 100u) << layerName(layer) << " " << bounces;
      }
    }
}

TEST(Wavefront, DependsNeitherOnThreadsNorOnTheBatch) {
  World world;
  mix(world);
  world.build();
  std::vector<std::vector<PathVertex>> results;
  for (const int threads : {1, 2}) {
    tbb::task_arena arena(threads);
    arena.execute([&] {
      Batch batch = film(world, 8);
      for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
        follow(world, layer, batch);
        results.push_back(batch.vertices);
        // Block by block: batches of one.
        std::vector<PathVertex> pieces(batch.vertices.size());
        uint32_t begin = 0;
        for (const uint32_t end : batch.ends) {
          const uint32_t count = end - begin;
          tracePaths(world.context(), world.camera(), layer, std::span(batch.first).subspan(begin, count),
                     std::span(&count, 1), std::span(pieces).subspan(begin, count));
          begin = end;
        }
        EXPECT_TRUE(sameBytes(pieces, batch.vertices)) << layerName(layer);
      }
    });
  }
  for (size_t i = 0; i < 3; ++i) EXPECT_TRUE(sameBytes(results[i], results[i + 3]));
}

// Inputs that vary: a metal that takes its colour from the mesh, beside one of constant colour.
TEST(Wavefront, EvaluatesVaryingPathInputsWhereTheyAreNeeded) {
  World world;
  Material tinted = mirror();
  PatternNode node;
  node.kind = PatternNode::Kind::DisplayColor;
  tinted.nodes.push_back(node);
  tinted.diffuse_color = {{0, 0, 0}, 0, 0};
  world.stage.scene.materials.push_back(tinted);
  DicedMesh left, right;
  test::addQuad(left, {-50, -50, -5}, {0, -50, -5}, {0, 50, -5}, {-50, 50, -5});
  test::addQuad(right, {0, -50, -5}, {50, -50, -5}, {50, 50, -5}, {0, 50, -5});
  left.display_color = {{0, 0.2f, 1}, {1, 0.2f, 1}, {1, 0.2f, 0}, {0, 0.2f, 0}};  // (x + 50) / 50, 0.2, (50 - y) / 100
  world.stage.add(left, 3);
  world.stage.add(right, kMirror);
  world.stage.scene.lights = {dome({1, 1, 1})};
  world.build();
  ASSERT_TRUE(world.patterns->pathVaries(3));
  Batch batch = film(world, 3);
  follow(world, Layer::Reflection, batch);
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const Vec3f d = batch.first[i].direction, p = d * (-5 / d.z);
    if (std::abs(p.x) < 1e-3f) continue;
    const Vec3f f0 = p.x < 0 ? Vec3f{(p.x + 50) / 50, 0.2f, (50 - p.y) / 100} : Vec3f{1, 1, 1};
    EXPECT_LT(length(batch.vertices[i].throughput - fresnelSchlick(-d.z, f0)), 1e-3f);
  }
}

TEST(Random, SamplesOfAPixelStratify) {
  std::vector<int> choices(64), lobes(64);
  for (uint32_t s = 0; s < 64; ++s) {
    const BounceRandom random(3, 17, s, Layer::Refraction, 2);
    ++choices[size_t(random.choice() * 64)];
    const auto u = random.lobe();
    ++lobes[size_t(u[0] * 8) * 8 + size_t(u[1] * 8)];
    EXPECT_NE(random.choice(), BounceRandom(3, 17, s, Layer::Reflection, 2).choice());
    EXPECT_NE(random.choice(), BounceRandom(3, 17, s, Layer::Refraction, 3).choice());
  }
  for (int i = 0; i < 64; ++i) {
    EXPECT_EQ(choices[size_t(i)], 1);
    EXPECT_EQ(lobes[size_t(i)], 1);
  }
}

// ---------------------------------------------------------------------------------------------------------

TEST(Differentials, FormulasAgreeWithFiniteDifferences) {
  Stream stream(6);
  const auto refract = [](Vec3d d, Vec3d n, double eta) {
    const double c = -dot(d, n);
    return d / eta + n * (c / eta - std::sqrt(1 - (1 - c * c) / (eta * eta)));
  };
  for (int i = 0; i < 500; ++i) {
    const Vec3d n = toDouble(stream.onSphere()), d = normalize(toDouble(stream.onSphere()) * 0.9 - n);
    const Vec3d dn_any = toDouble(stream.onSphere()), dd_any = toDouble(stream.onSphere());
    const Vec3d dn = dn_any - n * dot(n, dn_any), dd = dd_any - d * dot(d, dd_any);  // unit vectors stay unit
    const double eta = double(stream.next(1.1f, 2)), h = 1e-5;
    const auto at = [&](double s, bool reflect) {
      const Vec3d di = normalize(d + dd * s), ni = normalize(n + dn * s);
      return reflect ? di - ni * (2 * dot(di, ni)) : refract(di, ni, eta);
    };
    const Vec3d reflected = (at(h, true) - at(-h, true)) / (2 * h),
                refracted = (at(h, false) - at(-h, false)) / (2 * h);
    const Vec3f df = toFloat(d), nf = toFloat(n), ddf = toFloat(dd), dnf = toFloat(dn);
    EXPECT_LT(length(toDouble(reflectDifferential(df, nf, ddf, dnf)) - reflected), 1e-5);
    EXPECT_LT(
        length(toDouble(refractDifferential(df, toFloat(refract(d, n, eta)), nf, float(eta), ddf, dnf)) - refracted),
        1e-4);
    // A plane through the ray's end.
    const Vec3d o{1, 2, 3}, dp = toDouble(stream.onSphere());
    const auto meet = [&](double s) {
      const Vec3d di = normalize(d + dd * s), oi = o + dp * s;
      return oi + di * (dot(o + d * 4 - oi, n) / dot(di, n));
    };
    const Vec3d moved = (meet(h) - meet(-h)) / (2 * h);
    EXPECT_LT(length(toDouble(transferDifferential(toFloat(dp), ddf, 4, df, nf)) - moved), 1e-5 * (1 + length(moved)));
  }
}

TEST(Differentials, AreLimited) {
  const float inf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(limited({1, inf, 0}, 5), Vec3f{});
  EXPECT_EQ(limited({std::nanf(""), 1, 0}, 5), Vec3f{});
  EXPECT_EQ(limited({3, 4, 0}, 5), (Vec3f{3, 4, 0}));
  EXPECT_NEAR(length(limited({3e30f, -3e30f, 1e30f}, 5)), 5, 1e-4);
  EXPECT_EQ(limited({1, 2, 3}, 0), Vec3f{});
}

struct FootprintErrors {
  size_t compared = 0;
  double median = 0, high = 0;  // relative; high: the 90th percentile
};

// dpdx and dpdy against where the same path ends for film points beside it.
FootprintErrors footprintErrors(World& world, Layer layer, uint32_t target) {
  const float h = 0.01f;
  Batch batch;
  Stream stream(15);
  for (uint32_t i = 0; i < 1500; ++i) {
    const float x = stream.next(1, 31), y = stream.next(1, 31);
    for (const Vec2f offset : {Vec2f{0, 0}, {h, 0}, {-h, 0}, {0, h}, {0, -h}})
      batch.first.push_back(filmPoint(x + offset.x, y + offset.y, i, 0));
  }
  batch.ends = {uint32_t(batch.first.size())};
  batch.vertices.resize(batch.first.size());
  traceFirstHits(world.context(), world.camera(), batch.first, batch.ends);
  follow(world, layer, batch);
  std::vector<double> errors;
  for (size_t i = 0; i < batch.vertices.size(); i += 5) {
    const PathVertex* v = &batch.vertices[i];
    if (std::any_of(v, v + 5, [&](const PathVertex& p) { return p.hit.instance != target; })) continue;
    const Vec3d dx = (position(world, v[1]) - position(world, v[2])) / (2 * double(h));
    const Vec3d dy = (position(world, v[3]) - position(world, v[4])) / (2 * double(h));
    const double size = std::max(length(dx), length(dy));
    errors.push_back(length(toDouble(v->dpdx) - dx) / size);
    errors.push_back(length(toDouble(v->dpdy) - dy) / size);
  }
  FootprintErrors result;
  result.compared = errors.size();
  if (errors.empty()) return result;
  std::sort(errors.begin(), errors.end());
  result.median = errors[errors.size() / 2], result.high = errors[errors.size() * 9 / 10];
  return result;
}

void expectAccurate(const FootprintErrors& errors, double median, double high) {
  EXPECT_GT(errors.compared, 800u);
  EXPECT_LT(errors.median, median);
  EXPECT_LT(errors.high, high);
}

TEST(Differentials, FootprintOnASlantedWall) {
  World world;
  const uint32_t target = world.stage.add(wall(-5, 50), kMatte, test::rotation({0, 1, 0}, 0.9));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Direct, target), 2e-3, 5e-3);
}

TEST(Differentials, FootprintInAPlaneMirror) {
  World world;
  world.stage.add(wall(-5, 50), kMirror, test::rotation({0, 1, 0}, 0.4));
  const uint32_t target = world.stage.add(wall(-8, 100), kMatte, test::rotation({0, 1, 0}, 3.0));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Reflection, target), 2e-3, 5e-3);
}

TEST(Differentials, FootprintInAMirrorBall) {
  World world;
  world.stage.add(test::sphere(60), kMirror, test::translation({0, 0, -4}) * test::scaling({0.9, 0.9, -0.9}));
  const uint32_t target =
      world.stage.add(test::sphere(10), kMatte, test::translation({0, 0, -4}) * test::scaling({30, 30, 30}));
  world.build();
  expectAccurate(footprintErrors(world, Layer::Reflection, target), 1e-2, 5e-2);
}

TEST(Differentials, FootprintThroughASlab) {
  World world;
  world.settings.max_bounces = 2;
  world.stage.add(test::box({-50, -50, -5}, {50, 50, -3}), kGlass, test::rotation({0, 1, 0}, 0.3));
  const uint32_t target = world.stage.add(wall(-9, 100), kMatte);
  world.build();
  expectAccurate(footprintErrors(world, Layer::Refraction, target), 5e-3, 2e-2);
}

TEST(Differentials, FootprintThroughAGlassBall) {
  World world;
  world.settings.max_bounces = 2;
  world.stage.add(test::sphere(60), kGlass, test::translation({0, 0, -4}));
  const uint32_t target = world.stage.add(wall(-9, 100), kMatte);
  world.build();
  expectAccurate(footprintErrors(world, Layer::Refraction, target), 2e-2, 1e-1);
}

TEST(Differentials, StayFiniteInAHallOfMirrorBalls) {
  World world;
  Stream stream(8);
  for (int i = 0; i < 20; ++i)
    world.stage.add(test::sphere(6), i % 2 ? kMirror : kGlass,
                    test::translation({stream.next(-1, 1), stream.next(-1, 1), stream.next(-5, -2)}) *
                        test::scaling({0.3, 0.3, 0.3}));
  world.stage.add(test::sphere(10), kMatte, test::scaling({20, 20, 20}));
  world.settings.max_bounces = 30;
  world.build();
  Batch batch = film(world, 8);
  size_t deep = 0;
  for (const Layer layer : {Layer::Reflection, Layer::Refraction}) {
    follow(world, layer, batch);
    for (const PathVertex& v : batch.vertices) {
      if (!v.hit.valid()) continue;
      ++deep;
      EXPECT_TRUE(isFinite(v.dpdx) && isFinite(v.dpdy));
      EXPECT_LE(length(v.dpdx), world.trace->diagonal() * 1.001f);
    }
  }
  EXPECT_GT(deep, 1000u);
}

}  // namespace
}  // namespace encore
