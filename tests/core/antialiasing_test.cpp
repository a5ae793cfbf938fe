// traceAntialiasing() against the slow and obvious composition: positions, rays, hits, surface(), tracePaths().
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <bit>
#include <cstring>

#include "core/path/film_keys.h"
#include "core/path/footprint.h"
#include "core/shade/lights.h"
#include "path_world.h"

namespace encore {
namespace {

using namespace test;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

template <class T>
bool sameBytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

// Everything that a batch writes, filled with rubbish.
struct Values {
  std::vector<uint32_t> position;
  std::vector<float> coverage, depth, footprint;
  std::vector<Vec3f> normal, throughput;
  std::vector<SurfaceKey> key;
  std::vector<Vec2f> uv;
  std::vector<Vec4f> aspect;
  std::vector<FirstHit> first;
  uint64_t on_surface = 0;

  Values(size_t blocks, uint32_t per_pixel) {
    const size_t slots = blocks * kBlockArea * per_pixel;
    position.assign(slots, 77), coverage.assign(slots, -3), footprint.assign(slots, -3);
    depth.assign(blocks * kBlockArea, -3);
    normal.assign(slots, {9, 9, 9}), throughput.assign(slots, {9, 9, 9});
    key.assign(slots, {123, 456}), uv.assign(slots, {9, 9}), aspect.assign(slots, {9, 9, 9, 9});
    FirstHit rubbish;
    rubbish.film_x = rubbish.film_y = 9, rubbish.pixel = rubbish.sample = 9;
    first.assign(slots, rubbish);
  }
  SharedOutputs shared() { return {position, coverage, normal, depth}; }
  SampleOutputs direct() { return {key, uv, throughput, footprint, aspect}; }
};

std::vector<BlockOrigin> blocksOf(const Settings& settings) {
  std::vector<BlockOrigin> blocks;
  for (uint32_t y = 0; y < settings.height; y += kBlockPixels)
    for (uint32_t x = 0; x < settings.width; x += kBlockPixels) blocks.push_back({int32_t(x), int32_t(y)});
  return blocks;
}

// Those, and some of the overscan.
std::vector<BlockOrigin> blocksAround(const Settings& settings) {
  std::vector<BlockOrigin> blocks = blocksOf(settings);
  const int32_t width = int32_t(settings.width), height = int32_t(settings.height);
  blocks.insert(blocks.end(), {{-16, 0}, {-32, -16}, {width, 0}, {16, height}, {width + 16, height}, {0, -160}});
  return blocks;
}

// Correlated multi-jittering, from its definition: sample s is in column s % n and row s / n of n × n squares, and at
// the place in them where a permutation puts the other index.
uint32_t filmPosition(const Settings& settings, uint32_t pixel, uint32_t s) {
  const uint32_t n = settings.samples, patterns = std::bit_floor(std::clamp(4096 / (n * n), 8u, 64u));
  const auto permuted = [&](uint32_t index, uint32_t i) {
    std::vector<uint32_t> order;
    for (uint32_t k = 0; k < n; ++k) {
      order.push_back(k);
      std::swap(order[k], order[pcg4d(index, k, n, 0x5bd1e995u)[0] % (k + 1)]);
    }
    return order[i];
  };
  const auto which = pcg4d(pixel, 0xffffffffu, uint32_t(RandomUse::FilmPosition), settings.seed);
  const auto random = pcg4d(pixel, s, uint32_t(RandomUse::FilmPosition), settings.seed);
  const uint32_t column = s % n * n + permuted(2 * (which[0] % patterns), s / n),
                 row = s / n * n + permuted(2 * (which[1] % patterns) + 1, s % n);
  const auto place = [&](uint32_t stratum, uint32_t bits) {
    return std::min(65535u, uint32_t((float(stratum) + toUnit(bits)) / float(n * n) * 65536.0f));
  };
  return place(row, random[1]) << 16 | place(column, random[0]);
}

// The twin.
Values slowly(World& world, std::span<const BlockOrigin> blocks) {
  const Settings& settings = world.settings;
  const CameraRays camera = world.camera();
  const uint32_t per_pixel = settings.samples * settings.samples;
  Values values(blocks.size(), per_pixel);
  std::vector<uint32_t> ends;
  size_t slot = 0;
  for (const BlockOrigin block : blocks) {
    for (uint32_t p = 0; p < kBlockArea; ++p) {
      const int32_t x = block.x + int32_t(p % kBlockPixels), y = block.y + int32_t(p / kBlockPixels);
      const uint32_t pixel = pixelKey(settings, x, y);
      for (uint32_t s = 0; s < per_pixel; ++s, ++slot) {
        values.first[slot] = {}, values.position[slot] = 0;
        if (block.x >= 0 && block.x < int32_t(settings.width) && x >= int32_t(settings.width)) continue;
        if (block.y >= 0 && block.y < int32_t(settings.height) && y >= int32_t(settings.height)) continue;
        const uint32_t position = values.position[slot] = filmPosition(settings, pixel, s);
        FirstHit& f = values.first[slot];
        f.film_x = float(x) + float(position & 0xffffu) * 0x1p-16f,
        f.film_y = float(y) + float(position >> 16) * 0x1p-16f;
        f.pixel = pixel, f.sample = s;
      }
    }
    ends.push_back(uint32_t(slot));
  }
  traceFirstHits(world.context(), camera, values.first, ends);
  std::vector<PathVertex> vertices(slot);
  values.on_surface = tracePaths(world.context(), camera, Layer::Direct, values.first, ends, vertices, values.direct());
  std::fill(values.depth.begin(), values.depth.end(), kInfinity);
  for (size_t i = 0; i < slot; ++i) {
    const FirstHit& f = values.first[i];
    values.coverage[i] = 0, values.normal[i] = {};
    if (!f.active()) continue;
    const Ray ray = camera.ray(f);
    if (!f.hit.valid()) {
      const bool light =
          settings.lights_visible && intersectLights(world.context().lights, world.stage.scene.lights, ray.origin,
                                                     ray.direction, std::numeric_limits<float>::max())
                                         .valid;
      values.coverage[i] = settings.dome_light_visible || light ? 1 : 0;
      continue;
    }
    const SurfacePoint point = world.trace->surface(f.hit, ray.direction, false);
    values.coverage[i] = 1;
    values.normal[i] = point.side ? -point.ns : point.ns;
    float& depth = values.depth[i / per_pixel];
    depth = std::min(depth, camera.depth(ray.origin + ray.direction * f.hit.t));
  }
  return values;
}

Values quickly(World& world, std::span<const BlockOrigin> blocks) {
  Values values(blocks.size(), world.settings.samples * world.settings.samples);
  values.on_surface =
      traceAntialiasing(world.context(), world.camera(), blocks, values.first, values.shared(), values.direct());
  return values;
}

void expectEqual(const Values& a, const Values& b, const std::string& what) {
  EXPECT_TRUE(sameBytes(a.position, b.position)) << what;
  EXPECT_TRUE(sameBytes(a.coverage, b.coverage)) << what;
  EXPECT_TRUE(sameBytes(a.depth, b.depth)) << what;
  EXPECT_TRUE(sameBytes(a.footprint, b.footprint)) << what;
  EXPECT_TRUE(sameBytes(a.key, b.key)) << what;
  EXPECT_TRUE(sameBytes(a.uv, b.uv)) << what;
  EXPECT_TRUE(sameBytes(a.throughput, b.throughput)) << what;
  EXPECT_TRUE(sameBytes(a.aspect, b.aspect)) << what;
  EXPECT_TRUE(sameBytes(a.first, b.first)) << what;
  EXPECT_EQ(a.on_surface, b.on_surface) << what;
  size_t different = 0;  // -0 and 0 are equal
  for (size_t i = 0; i < a.normal.size(); ++i) different += !(a.normal[i] == b.normal[i]);
  EXPECT_EQ(different, 0u) << what;
}

// Bodies with and without normals, seen from both sides, mirrored and sheared, in several meshes of a prototype.
void furnish(World& world, int32_t material = -1) {
  Stream stream(11);
  const auto kind = [&](int i) { return material >= 0 ? material : i % int(world.stage.scene.materials.size()); };
  DicedMesh open = sphere(7);
  open.triangles.resize(open.triangles.size() / 2), open.triangle_primitive.resize(open.triangles.size() / 3);
  DicedMesh needle;  // without area: no normal
  addTriangle(needle, {-1, -1, 0}, {1, 1, 0}, {0, 0, 0});
  const uint32_t a = world.stage.addMesh(sphere(9), kind(3)), b = world.stage.addMesh(open, kind(4)),
                 c = world.stage.addMesh(soup(stream, 40), kind(0)), d = world.stage.addMesh(needle, kind(0)),
                 e = world.stage.addMesh(box({-0.5f, -0.5f, -0.5f}, {0.5f, 0.5f, 0.5f}), kind(1));
  const uint32_t first = world.stage.addPrototype({a, d, c}), second = world.stage.addPrototype({b}),
                 third = world.stage.addPrototype({e, b});
  const uint32_t prototypes[] = {first, second, third};
  for (int i = 0; i < 12; ++i)
    world.stage.addInstance(prototypes[i % 3], translation({0, 0, -9}) * randomTransform(stream, i),
                            i == 7 ? kMatte : -1);
  world.stage.scene.meshes[e].face_materials = {0, kind(3), -1, 0, kind(2), -1};
}

void frame(World& world, uint32_t width, uint32_t height, uint32_t samples) {
  world.settings.width = width, world.settings.height = height, world.settings.samples = samples;
  world.stage.scene.camera.half_tangent = {0.4f, 0.4f * float(height) / float(width)};
}

TEST(Antialiasing, AgreesWithTheObviousWay) {
  struct Case {
    uint32_t width, height, samples;
  };
  for (const Case c : {Case{48, 32, 1}, {37, 21, 1}, {33, 50, 4}, {5, 3, 2}, {35, 18, 11}, {17, 17, 23}}) {
    World world;
    Material plastic, tinted_glass = glass();
    plastic.roughness = {0.0f};
    tinted_glass.opacity = {0.3f};
    world.stage.scene.materials.push_back(plastic), world.stage.scene.materials.push_back(tinted_glass);
    furnish(world);
    frame(world, c.width, c.height, c.samples);
    world.settings.seed = c.width;
    world.build();
    const auto blocks = blocksOf(world.settings);
    const Values slow = slowly(world, blocks), quick = quickly(world, blocks);
    expectEqual(quick, slow, std::to_string(c.width) + " " + std::to_string(c.samples));
    EXPECT_EQ(world.rays_traced, 2u * c.width * c.height * c.samples * c.samples);
    if (c.width < 10) continue;
    uint64_t back = 0, front = 0, missed = 0, weighted = 0;
    for (size_t i = 0; i < quick.key.size(); ++i) {
      const bool hit = quick.key[i].instance != kNoInstance;
      back += hit && (quick.key[i].primitive_side & 1), front += hit && !(quick.key[i].primitive_side & 1);
      missed += quick.first[i].active() && !quick.first[i].hit.valid();
      weighted += hit && quick.throughput[i].x != 1;
    }
    EXPECT_GT(back, c.samples == 1 ? 0u : 20u);
    EXPECT_GT(front, 100u);
    EXPECT_GT(missed, 20u);
    EXPECT_GT(weighted, 20u);
  }
}

TEST(Antialiasing, OfPlainMaterialsToo) {
  World world;  // every weight is 1: the shortest way
  furnish(world, kMatte);
  world.stage.scene.materials.resize(1);
  frame(world, 40, 40, 5);
  world.stage.scene.camera.to_world = translation({0.2, -0.1, 0.5}) * rotation({0, 1, 0}, 0.1);
  world.stage.scene.camera.near_clip = 7, world.stage.scene.camera.far_clip = 11;
  world.build();
  const auto blocks = blocksAround(world.settings);
  expectEqual(quickly(world, blocks), slowly(world, blocks), "plain");
}

TEST(Antialiasing, SeesLightsWhereTheyAreVisible) {
  for (const bool lights : {false, true})
    for (const bool sky : {false, true}) {
      World world;
      furnish(world);
      Light ball;
      ball.kind = Light::Kind::Sphere;
      ball.radiance = {7, 6, 5}, ball.centre = {0.5, 0, -6}, ball.radius = 1;
      Light black = ball;
      black.radiance = {0, 0, 0}, black.centre = {-2, 1, -6};
      world.stage.scene.lights = {ball, dome({0.5f, 0.25f, 0.125f}), black};
      world.settings.lights_visible = lights, world.settings.dome_light_visible = sky;
      frame(world, 40, 30, 3);
      world.build();
      const auto blocks = blocksOf(world.settings);
      const Values quick = quickly(world, blocks);
      expectEqual(quick, slowly(world, blocks), "lights");
      uint64_t on_ball = 0;
      for (const Vec3f t : quick.throughput) on_ball += t == ball.radiance;
      EXPECT_EQ(on_ball > 100, lights);
    }
}

// A metal whose colour varies, a dielectric whose roughness does, and materials that do not.
TEST(Antialiasing, EvaluatesVaryingMaterials) {
  World world;
  Material varied;
  varied.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
  varied.metallic = {0.5f}, varied.roughness = {0.0f};
  varied.diffuse_color = {{0, 0, 0}, 0, 0};
  world.stage.scene.materials.push_back(varied);
  furnish(world);
  for (DicedMesh& mesh : world.stage.diced)
    for (const Vec3f& p : mesh.positions) mesh.display_color.push_back({p.x * 0.5f + 0.5f, 0.3f, 0.9f});
  frame(world, 40, 30, 3);
  world.settings.max_reuse_distance = 2;
  world.build();
  ASSERT_TRUE(world.patterns->varies(PatternPart::Path, 3));
  const auto blocks = blocksOf(world.settings);
  expectEqual(quickly(world, blocks), slowly(world, blocks), "varying");
}

TEST(Antialiasing, KeysCarryOctavesAndParametersTheirScaleWhereAskedFor) {
  World world;
  furnish(world);
  frame(world, 40, 30, 4);
  world.settings.footprint_reuse = FootprintReuse::Octaves;
  world.build();
  world.trace = std::make_unique<TraceScene>(world.stage.scene, world.stage.diced, true);
  const auto blocks = blocksOf(world.settings);
  const Values quick = quickly(world, blocks);
  expectEqual(quick, slowly(world, blocks), "octaves");
  std::vector<uint32_t> octaves(64);
  for (size_t i = 0; i < quick.key.size(); ++i) {
    if (quick.key[i].instance == kNoInstance) continue;
    const uint32_t octave = quick.key[i].instance >> 26;
    EXPECT_EQ(quick.key[i].instance & (kOctaveInstances - 1), quick.first[i].hit.instance);
    ++octaves[octave];
  }
  EXPECT_GT(std::count_if(octaves.begin(), octaves.end(), [](uint32_t c) { return c > 10; }), 3);
}

// Cameras with a lens, without perspective, or in motion; and moving things before a camera at rest.
TEST(Antialiasing, OfAllCameras) {
  for (int kind = 0; kind < 16; ++kind) {
    World world;
    Material plastic;
    plastic.roughness = {0.0f};
    world.stage.scene.materials.push_back(plastic);
    furnish(world);
    frame(world, 37, 21, 3);
    Camera& camera = world.stage.scene.camera;
    if (kind & 1) camera.lens_radius = 0.3f, camera.focus_distance = 8;
    if (kind & 2) camera.projection = Camera::Projection::Orthographic, camera.half_tangent = {3, 3.0f * 21 / 37};
    if (kind & 4) camera.motion = {camera.to_world, translation({0.5, 0, 0})};
    if (kind & 8) camera.clipping_planes = {{{0, 0, -1}, -8.5f}};
    Light ball;
    ball.kind = Light::Kind::Sphere;
    ball.radiance = {7, 6, 5}, ball.centre = {0.5, 0, -6}, ball.radius = 0.4f;
    world.stage.scene.lights = {ball};
    world.settings.lights_visible = true;
    world.settings.max_reuse_distance = 2;
    world.settings.reuse_time_weight = 0.5f, world.settings.reuse_direction_weight = 2;
    world.build();
    const auto blocks = blocksOf(world.settings);
    const Values quick = quickly(world, blocks);
    expectEqual(quick, slowly(world, blocks), "camera " + std::to_string(kind));
    size_t on_ball = 0, surfaces = 0;
    for (size_t i = 0; i < quick.key.size(); ++i) {
      on_ball += quick.throughput[i] == ball.radiance;
      if (quick.key[i].instance == kNoInstance) continue;
      ++surfaces;
      const Vec4f a = quick.aspect[i];
      EXPECT_NEAR(length(Vec3f{a.x, a.y, a.z}), 2, 1e-5f);
      EXPECT_EQ(a.w, 0.5f * quick.first[i].hit.time);
      if (!(kind & 4)) {
        EXPECT_EQ(a.w, 0);
      }
    }
    EXPECT_GT(surfaces, 300u);
    EXPECT_GT(on_ball, 10u);
  }
}

// What is partly there, in front of lights, background and materials that vary.
TEST(Antialiasing, PassesThroughPresence) {
  for (const bool together : {false, true}) {
    World world;
    Material veil = matte();
    veil.opacity = {0.4f}, veil.opacity_mode = OpacityMode::Presence;
    Material varied;
    varied.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
    varied.metallic = {0.5f}, varied.roughness = {0.0f};
    varied.diffuse_color = {{0, 0, 0}, 0, 0};
    if (together) {
      veil.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
      veil.opacity = {1, 0, 1};
    }
    world.stage.scene.materials.push_back(veil), world.stage.scene.materials.push_back(varied);
    furnish(world);
    for (DicedMesh& mesh : world.stage.diced)
      for (const Vec3f& p : mesh.positions) mesh.display_color.push_back({p.x * 0.5f + 0.5f, 0.4f, 0.9f});
    frame(world, 40, 30, 3);
    Light ball;
    ball.kind = Light::Kind::Sphere;
    ball.radiance = {7, 6, 5}, ball.centre = {0.5, 0, -9}, ball.radius = 0.5f;
    world.stage.scene.lights = {ball};
    world.settings.lights_visible = true;
    world.settings.footprint_reuse = FootprintReuse::Octaves;
    world.settings.reuse_direction_weight = 1;
    world.build();
    const auto blocks = blocksOf(world.settings);
    expectEqual(quickly(world, blocks), slowly(world, blocks), "presence");
  }
}

TEST(Antialiasing, DependsOnNothingButTheBlock) {
  World world;
  furnish(world);
  frame(world, 70, 45, 3);
  world.build();
  auto blocks = blocksOf(world.settings);
  Values together(0, 9);
  for (const int threads : {1, 2}) tbb::task_arena(threads).execute([&] { together = quickly(world, blocks); });
  const size_t slots = kBlockArea * 9;
  for (size_t b = blocks.size(); b-- > 0;) {
    const Values alone = quickly(world, std::span(blocks).subspan(b, 1));
    EXPECT_EQ(std::memcmp(alone.first.data(), &together.first[b * slots], slots * sizeof(FirstHit)), 0);
    EXPECT_EQ(std::memcmp(alone.uv.data(), &together.uv[b * slots], slots * sizeof(Vec2f)), 0);
    EXPECT_EQ(std::memcmp(alone.depth.data(), &together.depth[b * kBlockArea], kBlockArea * sizeof(float)), 0);
  }
}

TEST(Antialiasing, WritesNothingThatIsNotNeeded) {
  World world;
  furnish(world);
  frame(world, 20, 20, 2);
  world.build();
  const auto blocks = blocksOf(world.settings);
  const Values all = quickly(world, blocks);
  Values some(blocks.size(), 4);
  EXPECT_EQ(traceAntialiasing(world.context(), world.camera(), blocks, {}, {}, {{}, some.uv, {}, {}, {}}),
            all.on_surface);
  EXPECT_TRUE(sameBytes(some.uv, all.uv));
  EXPECT_EQ(traceAntialiasing(world.context(), world.camera(), blocks, {}, {{}, {}, some.normal, {}}, {}), 0u);
  EXPECT_TRUE(sameBytes(some.normal, all.normal));
  EXPECT_EQ(traceAntialiasing(world.context(), world.camera(), blocks, some.first, {}, {}), 0u);
  EXPECT_TRUE(sameBytes(some.first, all.first));
  EXPECT_EQ(traceAntialiasing(world.context(), world.camera(), {}, {}, {}, {}), 0u);
}

TEST(Antialiasing, TracesSingleSlotsAgain) {
  for (const uint32_t samples : {1u, 3u, 11u}) {
    World world;
    furnish(world);
    frame(world, 39, 21, samples);
    world.build();
    const auto blocks = blocksAround(world.settings);
    const Values all = quickly(world, blocks);
    Stream stream(samples);
    std::vector<uint32_t> slots;
    for (uint32_t i = 0; i < all.first.size(); ++i)
      if (stream.next() < 0.05f) slots.push_back(i);
    std::vector<FirstHit> first(slots.size());
    retraceFirstHits(world.context(), world.camera(), blocks, slots, first);
    for (size_t i = 0; i < slots.size(); ++i)
      ASSERT_EQ(std::memcmp(&first[i], &all.first[slots[i]], sizeof(FirstHit)), 0) << slots[i];
    retraceFirstHits(world.context(), world.camera(), blocks, {}, {});
    // Through a lens, while the camera moves.
    world.stage.scene.camera.lens_radius = 0.2f, world.stage.scene.camera.focus_distance = 8;
    world.stage.scene.camera.motion = {{}, translation({0.3, 0, 0})};
    const Values blurred = quickly(world, blocks);
    retraceFirstHits(world.context(), world.camera(), blocks, slots, first);
    for (size_t i = 0; i < slots.size(); ++i)
      ASSERT_EQ(std::memcmp(&first[i], &blurred.first[slots[i]], sizeof(FirstHit)), 0) << slots[i];
  }
}

TEST(Antialiasing, PositionsAreJitteredInTheirStrata) {
  World world;
  frame(world, 37, 21, 4);
  world.build();
  const auto blocks = blocksOf(world.settings);
  const Values values = quickly(world, blocks);
  size_t active = 0;
  uint32_t columns = 0, rows = 0;
  for (size_t i = 0; i < values.first.size(); ++i) {
    const uint32_t pixel = uint32_t(i / 16 % kBlockArea), block = uint32_t(i / 16 / kBlockArea), s = uint32_t(i % 16);
    const uint32_t x = blocks[block].x + pixel % kBlockPixels, y = blocks[block].y + pixel / kBlockPixels;
    const FirstHit& f = values.first[i];
    ASSERT_EQ(f.active(), x < 37 && y < 21);
    if (!f.active()) continue;
    ++active;
    EXPECT_EQ(f.film_x, float(x) + float(values.position[i] & 0xffff) * 0x1p-16f);
    EXPECT_EQ(f.film_y, float(y) + float(values.position[i] >> 16) * 0x1p-16f);
    EXPECT_NEAR((f.film_x - float(x)) * 4, float(s % 4) + 0.5f, 0.5f + 1e-3f);
    EXPECT_NEAR((f.film_y - float(y)) * 4, float(s / 4) + 0.5f, 0.5f + 1e-3f);
    if (s == 0) columns = rows = 0;
    columns |= 1u << uint32_t((f.film_x - float(x)) * 16), rows |= 1u << uint32_t((f.film_y - float(y)) * 16);
    if (s == 15) {
      EXPECT_EQ(columns, (1u << 16) - 1);  // each once
      EXPECT_EQ(rows, (1u << 16) - 1);
    }
  }
  EXPECT_EQ(active, size_t(37) * 21 * 16);
}

TEST(RawTrace, CountsWholePackets) {
  World world;
  furnish(world);
  frame(world, 37, 21, 4);
  world.build();
  const RawTrace raw = timeRawPrimaryRays(*world.trace, world.camera(), world.settings);
  EXPECT_EQ(raw.rays, 37u * 21 * 16);
  EXPECT_GT(raw.seconds, 0);
}

}  // namespace
}  // namespace encore
