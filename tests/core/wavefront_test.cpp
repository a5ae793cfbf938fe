// Energy of whole paths, and the wavefront against Listing 2 as printed.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>

#include "core/path/path_random.h"
#include "core/shade/bsdf.h"
#include "core/shade/lights.h"
#include "path_world.h"

namespace encore {
namespace {

using namespace test;

bool sameBytes(const std::vector<PathVertex>& a, const std::vector<PathVertex>& b) {
  const auto same = [](const PathVertex& p, const PathVertex& q) {
    return p.hit.instance == q.hit.instance && p.hit.mesh == q.hit.mesh && p.hit.triangle == q.hit.triangle &&
           p.hit.b1 == q.hit.b1 && p.hit.b2 == q.hit.b2 && p.hit.t == q.hit.t && p.throughput == q.throughput &&
           p.direction == q.direction && p.dpdx == q.dpdx && p.dpdy == q.dpdy && p.pixel == q.pixel &&
           p.sample == q.sample;
  };
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), same);
}

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

// The twin: Listing 2 as printed, one path at a time.
struct Twin {
  World& world;
  ShadeContext context = world.context();
  Layer layer;
  PathVertex vertex;
  std::vector<std::pair<uint32_t, float>> inside{};  // solids, by instance, and their iors, in the order of entry

  // Solids of equal priority: the one entered last is there. False: the interface is passed straight.
  bool real(uint32_t instance, bool back) const {
    if (!back || inside.empty()) return true;
    return inside.back().first == instance;
  }
  void cross(uint32_t instance, float ior, bool back) {
    if (!back) return inside.push_back({instance, ior});
    for (size_t i = inside.size(); i-- > 0;)
      if (inside[i].first == instance) return void(inside.erase(inside.begin() + ptrdiff_t(i)));
  }
  float outside(bool back) const {  // of a real interface
    const size_t others = inside.size() - (back && !inside.empty() ? 1 : 0);
    return others == 0 ? 1 : inside[others - 1].second;
  }

  void pathTrace(Vec3f color, Hit hit, Vec3f direction, uint32_t bounce) {
    const Scene& scene = world.stage.scene;
    const SurfacePoint point = world.trace->surface(hit, direction);
    const Material& material = scene.materials[size_t(point.material)];
    const PathInputs& inputs = world.patterns->constantPath(point.material);
    const bool solid = feedsRefraction(material), back = point.side == 1;
    if (solid && !real(hit.instance, back)) {
      cross(hit.instance, inputs.ior, back);
      return goOn(color, point, direction, bounce);
    }
    const float other_ior = solid ? outside(back) : 1;
    const Lobes lobes = makeLobes(material, inputs, {back, false, other_ior}, world.settings);
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
    if (solid && effect == 2) cross(hit.instance, inputs.ior, back);
    goOn(color, point, out.direction, bounce + 1);
  }

  void goOn(Vec3f color, const SurfacePoint& point, Vec3f leaving, uint32_t bounce) {
    std::vector<Ray> ray(1);
    ray[0].origin = point.offsetOrigin(leaving), ray[0].direction = leaving;
    std::vector<Hit> next(1);
    world.trace->intersect(ray, next, Coherence::Incoherent);
    const LightHit light = intersectLights(context.lights, world.stage.scene.lights, ray[0].origin, leaving, next[0].t);
    if (light.valid) {
      vertex.throughput = color * light.radiance;
    } else if (next[0].valid() && maxComponent(color) > 0) {
      pathTrace(color, next[0], leaving, bounce);
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
        if (f.hit.valid()) twin.pathTrace({1, 1, 1}, f.hit, direction(world, f), 0);
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

// Outputs hold what vertices do, and vertices are complete where paths end on a surface.
TEST(Wavefront, OutputsAgreeWithVertices) {
  for (const bool lights_seen : {false, true})
    for (const bool footprints : {false, true}) {
      World world;
      mix(world);
      world.settings.dome_light_visible = lights_seen;
      if (footprints) world.settings.footprint_reuse = FootprintReuse::Metric;
      world.build();
      Batch batch = film(world, 8);
      for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
        follow(world, layer, batch);
        const size_t count = batch.first.size();
        std::vector<SurfaceKey> key(count, {1, 1});  // remains of another batch
        std::vector<Vec2f> uv(count, {2, 2});
        std::vector<Vec3f> throughput(count, {3, 3, 3});
        std::vector<float> footprint(count, 4);
        std::vector<PathVertex> lean(count, batch.vertices.back());
        SampleOutputs out{key, uv, throughput, {}, {}};
        if (footprints) out.footprint = footprint;
        uint64_t on_surface = 0;
        const uint64_t counted = tracePaths(world.context(), world.camera(), layer, batch.first, batch.ends, lean, out);
        for (size_t i = 0; i < count; ++i) {
          const PathVertex &v = batch.vertices[i], &w = lean[i];
          ASSERT_TRUE(key[i].instance == v.key.instance && key[i].primitive_side == v.key.primitive_side) << i;
          ASSERT_TRUE(uv[i] == v.uv && throughput[i] == v.throughput) << i;
          if (footprints) {
            ASSERT_EQ(footprint[i], v.footprint);
          }
          if (!v.hit.valid()) continue;
          ++on_surface;
          ASSERT_TRUE(w.hit.instance == v.hit.instance && w.hit.triangle == v.hit.triangle && w.hit.b1 == v.hit.b1 &&
                      w.hit.b2 == v.hit.b2 && w.direction == v.direction && w.throughput == v.throughput &&
                      w.pixel == v.pixel && w.sample == v.sample);
          if (footprints) {
            ASSERT_TRUE(w.dpdx == v.dpdx && w.dpdy == v.dpdy);
          }
        }
        EXPECT_EQ(counted, on_surface);
        EXPECT_GT(counted, 100u);
        EXPECT_LT(counted, count);
      }
    }
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
  ASSERT_TRUE(world.patterns->varies(PatternPart::Path, 3));
  Batch batch = film(world, 3);
  follow(world, Layer::Reflection, batch);
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const Vec3f d = direction(world, batch.first[i]), p = d * (-5 / d.z);
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

}  // namespace
}  // namespace encore
