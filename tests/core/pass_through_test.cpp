// Presence and cut-outs: what paths pass as if it were not there.
#include "core/path/pass_through.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cmath>

#include "core/shade/bsdf.h"
#include "path_world.h"

namespace encore {
namespace {

using namespace test;

Material present(float opacity) {
  Material m = matte();
  m.opacity = {opacity}, m.opacity_mode = OpacityMode::Presence;
  return m;
}
// Opacity is the red of the mesh's display colour.
Material painted(float threshold) {
  Material m = matte();
  m.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
  m.opacity = {1, 0, 0};
  m.opacity_threshold = threshold, m.opacity_mode = OpacityMode::Presence;
  return m;
}

void addSheets(World& world, uint32_t count, int32_t material) {
  for (uint32_t i = 0; i < count; ++i) world.stage.add(wall(-2 - 0.01f * float(i), 50), material);
}

TEST(Presence, LayersCoverByTheProduct) {
  for (const uint32_t sheets : {1u, 2u, 5u}) {
    World world;
    world.settings.samples = 4;
    world.stage.scene.materials.push_back(present(0.5f));
    addSheets(world, sheets, 3);
    world.build();
    EXPECT_TRUE(passesThrough(world.stage.scene));
    const std::vector<BlockOrigin> blocks{{0, 0}, {16, 0}, {0, 16}, {16, 16}};
    const size_t slots = blocks.size() * kBlockArea * 16;
    std::vector<float> coverage(slots), depth(blocks.size() * kBlockArea);
    std::vector<Vec3f> throughput(slots);
    std::vector<SurfaceKey> key(slots);
    SharedOutputs shared;
    shared.coverage = coverage, shared.depth = depth;
    SampleOutputs direct;
    direct.throughput = throughput, direct.key = key;
    const uint64_t on_surface = traceAntialiasing(world.context(), world.camera(), blocks, {}, shared, direct);
    std::vector<double> shares(sheets + 1);
    double covered = 0;
    for (size_t i = 0; i < slots; ++i) {
      const bool hit = key[i].instance != kNoInstance;
      EXPECT_EQ(coverage[i], hit ? 1 : 0);
      EXPECT_EQ(throughput[i], hit ? (Vec3f{1, 1, 1}) : Vec3f{});
      covered += hit, shares[hit ? key[i].instance : sheets] += 1;
    }
    EXPECT_EQ(uint64_t(covered), on_surface);
    // Stratified in every pixel: half of its samples meet the first sheet, exactly.
    EXPECT_EQ(shares[0], 0.5 * double(slots));
    double chi2 = 0;
    for (uint32_t k = 0; k <= sheets; ++k) {
      const double expected = double(slots) * std::pow(0.5, std::min(k + 1, sheets));
      chi2 += (shares[k] - expected) * (shares[k] - expected) / expected;
    }
    EXPECT_LT(chi2, sheets + 5 * std::sqrt(2.0 * sheets));
    for (const float d : depth) EXPECT_NEAR(d, 2, 0.01 * sheets);  // some sample of each pixel meets an early one
  }
}

TEST(Presence, CutOutsAreExactAlongTheirEdge) {
  World world;
  world.stage.scene.materials.push_back(painted(0.5f));
  DicedMesh mesh = wall(-5, 4);
  for (const Vec3f& p : mesh.positions) mesh.display_color.push_back({0.5f + p.x / 8, 0, 0});
  const uint32_t cut = world.stage.add(mesh, 3), behind = world.stage.add(wall(-6, 50), kMatte);
  world.build();
  Batch batch = film(world, 16);
  for (const FirstHit& f : batch.first) {
    const Vec3f d = direction(world, f);
    const float x = d.x / -d.z * 5;
    if (std::abs(x) < 1e-4f) continue;
    EXPECT_EQ(f.hit.instance, x > 0 ? cut : behind);
    EXPECT_NEAR(f.hit.t * -d.z, x > 0 ? 5 : 6, 1e-5);  // from the camera, though it was passed on
  }
  follow(world, Layer::Direct, batch);
  for (const PathVertex& v : batch.vertices) EXPECT_EQ(v.throughput, (Vec3f{1, 1, 1}));
}

// Half of the samples where opacity is a half; all and none at the ends.
TEST(Presence, VariesOverTheSurface) {
  World world;
  world.stage.scene.materials.push_back(painted(0));
  DicedMesh mesh = wall(-5, 1.5f);
  for (const Vec3f& p : mesh.positions) mesh.display_color.push_back({(p.x + 1.5f) / 3, 0, 0});
  world.stage.add(mesh, 3);
  world.build();
  Batch batch = film(world, 64);
  std::vector<double> met(32), expected(32);
  for (const FirstHit& f : batch.first) {
    const size_t column = f.pixel % 32;
    met[column] += f.hit.valid(), expected[column] += double(f.film_x) / 32;
  }
  for (size_t c = 0; c < 32; ++c) EXPECT_NEAR(met[c], expected[c], 0.01 * 64 * 32);
}

TEST(Presence, UsesUpNoBounceAndStaysInTheLayer) {
  World world;
  world.settings.max_bounces = 1;
  world.stage.scene.materials.push_back(present(0.25f));
  world.stage.add(wall(-5, 50), kMirror);
  for (int i = 0; i < 4; ++i) {  // behind the camera, seen in the mirror
    DicedMesh sheet;
    const float z = 1 + 0.5f * float(i);
    test::addQuad(sheet, {50, -50, z}, {-50, -50, z}, {-50, 50, z}, {50, 50, z});
    world.stage.add(sheet, 3);
  }
  DicedMesh end;
  test::addQuad(end, {90, -90, 9}, {-90, -90, 9}, {-90, 90, 9}, {90, 90, 9});
  const uint32_t target = world.stage.add(end, kMatte);
  world.build();
  Batch batch = film(world, 16);
  follow(world, Layer::Reflection, batch);
  std::vector<double> shares(target + 1);
  for (const PathVertex& v : batch.vertices) {
    ASSERT_TRUE(v.hit.valid());
    shares[v.hit.instance] += 1;
    EXPECT_NEAR(v.throughput.x, 1, 1e-5);
    const Vec3d p = position(world, v);
    // Its footprint is that of the whole way, in x and in y.
    const double way = (5 + 5 + p.z) * 0.6 / 32;
    EXPECT_NEAR(double(length(v.dpdx)), way, 1e-3 * way);
    EXPECT_NEAR(double(length(v.dpdy)), way, 1e-3 * way);
  }
  EXPECT_EQ(shares[0], 0);
  const double n = double(batch.vertices.size());
  double left = n, chi2 = 0;
  for (uint32_t k = 1; k <= target; ++k) {
    const double expected = k == target ? left : left * 0.25;
    chi2 += (shares[k] - expected) * (shares[k] - expected) / expected;
    left -= expected;
  }
  EXPECT_LT(chi2, 4 + 5 * std::sqrt(8.0));
}

TEST(Presence, LooksNoFurtherThanTheLimit) {
  World world;
  world.settings.width = world.settings.height = 4;
  world.stage.scene.materials.push_back(present(0));
  addSheets(world, PassThrough::kMostPassed + 20, 3);
  world.build();
  Batch batch = film(world, 1);
  for (const FirstHit& f : batch.first) EXPECT_EQ(f.hit.instance, PassThrough::kMostPassed);
  World fewer;
  fewer.stage.scene.materials.push_back(present(0));
  addSheets(fewer, PassThrough::kMostPassed, 3);
  fewer.build();
  for (const FirstHit& f : film(fewer, 1).first) EXPECT_FALSE(f.hit.valid());
}

TEST(Presence, CountsAsThereWhereOpacityIsNoNumber) {
  World world;
  world.stage.scene.materials.push_back(painted(0));
  DicedMesh mesh = wall(-5, 9);
  mesh.display_color.assign(mesh.positions.size(), Vec3f{std::nanf(""), 0, 0});
  world.stage.add(mesh, 3);
  world.build();
  for (const FirstHit& f : film(world, 2).first) EXPECT_TRUE(f.hit.valid());
}

// The twin: one ray after the other.
Hit passSlowly(World& world, const FirstHit& first, const std::vector<std::vector<Vec3f>>& paint) {
  std::vector<Ray> ray{world.camera().ray(first)};
  const Vec3f eye = ray[0].origin;
  for (uint32_t round = 0;; ++round) {
    std::vector<Hit> hit(1);
    world.trace->intersect(ray, hit, Coherence::Incoherent);
    if (!hit[0].valid()) return hit[0];
    const Vec3f d = ray[0].direction;
    const SurfacePoint point = world.trace->surface(hit[0], d);
    const Material& material = world.stage.scene.materials[size_t(point.material)];
    float opacity = material.opacity.value;
    if (material.opacity.node >= 0) {
      const uint32_t* corner = &world.stage.diced[hit[0].instance].triangles[3 * hit[0].triangle];
      const auto& colors = paint[hit[0].instance];
      const float b1 = hit[0].b1, b2 = hit[0].b2;
      opacity = colors[corner[0]].x * (1 - b1 - b2) + colors[corner[1]].x * b1 + colors[corner[2]].x * b2;
    }
    const auto keys = pcg4d(first.pixel, world.settings.seed, uint32_t(RandomUse::Presence), round);
    if (!material.hasPresence() || sobol2(first.sample, keys[0]).x < presence(material, opacity)) {
      hit[0].t = dot(point.position - eye, d);
      return hit[0];
    }
    ray[0].origin = point.offsetOrigin(d);
  }
}

TEST(Presence, AgreesWithOneRayAfterTheOther) {
  World world;
  world.settings.seed = 4;
  world.stage.scene.materials = {matte(), present(0.4f), painted(0), painted(0.3f)};
  Stream stream(12);
  std::vector<std::vector<Vec3f>> paint;
  for (int i = 0; i < 12; ++i) {
    DicedMesh mesh = i % 2 ? soup(stream, 60) : test::sphere(5);
    for (size_t k = 0; k < mesh.positions.size(); ++k) mesh.display_color.push_back({stream.next(), 0, 0});
    paint.push_back(mesh.display_color);
    world.stage.add(mesh, i % 4, translation({0, 0, -6}) * randomTransform(stream, i));
  }
  world.build();
  Batch batch = film(world, 4);
  size_t different = 0, passed = 0;
  for (const FirstHit& f : batch.first) {
    const Hit expected = passSlowly(world, f, paint);
    const bool same = f.hit.instance == expected.instance && f.hit.triangle == expected.triangle &&
                      (!f.hit.valid() || std::abs(f.hit.t - expected.t) < 1e-5f * expected.t);
    different += !same;
    std::vector<Hit> nearest(1);
    world.trace->intersect(std::vector<Ray>{world.camera().ray(f)}, nearest, Coherence::Incoherent);
    passed += nearest[0].instance != f.hit.instance;
  }
  EXPECT_LE(different, batch.first.size() / 500);  // ties at edges, and opacities at the threshold
  EXPECT_GT(passed, batch.first.size() / 20);
}

TEST(Presence, DependsOnNothingButTheBlock) {
  World world;
  world.stage.scene.materials.push_back(painted(0));
  Stream stream(3);
  for (int i = 0; i < 8; ++i) {
    DicedMesh mesh = test::sphere(6);
    for (size_t k = 0; k < mesh.positions.size(); ++k) mesh.display_color.push_back({stream.next(), 0, 0});
    world.stage.add(mesh, i % 2 ? 3 : kMirror, translation({0, 0, -6}) * randomTransform(stream, i));
  }
  world.stage.scene.lights = {dome({1, 1, 1})};
  world.build();
  std::vector<std::vector<PathVertex>> results;
  for (const int threads : {1, 2})
    tbb::task_arena(threads).execute([&] {
      Batch batch = film(world, 4);
      follow(world, Layer::Reflection, batch);
      results.push_back(batch.vertices);
      std::vector<PathVertex> pieces(batch.vertices.size());
      uint32_t begin = 0;
      for (const uint32_t end : batch.ends) {
        const uint32_t count = end - begin;
        std::vector<FirstHit> first(batch.first.begin() + begin, batch.first.begin() + end);
        traceFirstHits(world.context(), world.camera(), first, std::span(&count, 1));
        tracePaths(world.context(), world.camera(), Layer::Reflection, first, std::span(&count, 1),
                   std::span(pieces).subspan(begin, count));
        begin = end;
      }
      results.push_back(pieces);
    });
  size_t valid = 0;
  for (size_t k = 1; k < results.size(); ++k)
    for (size_t i = 0; i < results[0].size(); ++i) {
      const PathVertex &a = results[0][i], &b = results[k][i];
      ASSERT_TRUE(a.hit.instance == b.hit.instance && a.hit.t == b.hit.t && a.throughput == b.throughput &&
                  a.dpdx == b.dpdx);
      valid += a.hit.valid();
    }
  EXPECT_GT(valid, 300u);
}

}  // namespace
}  // namespace encore
