#include <gtest/gtest.h>
#include <tbb/task_arena.h>
#include <xmmintrin.h>

#include <cstring>

#include "core/scene/error.h"
#include "core/trace/packets.h"
#include "core/trace/trace_scene.h"
#include "packet_agreement.h"
#include "shapes.h"

namespace encore {
namespace {

using test::intersect;
using test::placed;
using test::randomRays;
using test::randomStage;
using test::same;
using test::Stage;
using test::Stream;

// The twin: every triangle of every instance, in double precision, in world space.
struct TwinHit {
  Hit hit;
  Vec3d position, outside;      // outside: unit normal
  double margin = 1;            // least distance of a barycentric coordinate of any triangle met from 0
  double nearest_other = 1e30;  // |t - t_hit| of the second nearest
};

TwinHit bruteForce(const Stage& stage, const Ray& ray) {
  TwinHit best;
  double best_t = 1e300;
  const Vec3d o = toDouble(ray.origin), d = toDouble(ray.direction);
  for (uint32_t i = 0; i < stage.scene.instances.size(); ++i) {
    const Affine3d m = placed(stage.scene.instances[i]);
    const Prototype& prototype = stage.scene.prototypes[stage.scene.instances[i].prototype];
    for (uint32_t slot = 0; slot < prototype.meshes.size(); ++slot) {
      const DicedMesh& mesh = stage.diced[prototype.meshes[slot]];
      for (uint32_t t = 0; t < mesh.triangleCount(); ++t) {
        const auto corner = [&](int k) {
          return m.point(toDouble(mesh.positions[mesh.triangles[3 * t + uint32_t(k)]]));
        };
        const Vec3d p0 = corner(0), e1 = corner(1) - p0, e2 = corner(2) - p0;
        Vec3d n = cross(e1, e2);
        const double den = dot(n, d), distance = dot(p0 - o, n) / den;
        if (den == 0 || !(distance > ray.tnear && distance < ray.tfar)) continue;
        const Vec3d p = o + d * distance - p0;
        const double area2 = dot(n, n), b1 = dot(cross(p, e2), n) / area2, b2 = dot(cross(e1, p), n) / area2;
        const double inside = std::min({b1, b2, 1 - b1 - b2});
        best.margin = std::min(best.margin, std::abs(inside));
        if (inside < 0) continue;
        best.nearest_other = std::min(best.nearest_other, std::abs(distance - best_t));
        if (distance >= best_t) continue;
        best_t = distance;
        if (m.determinant() < 0) n = -n;
        best.hit = {i, slot, t, float(b1), float(b2), float(distance)};
        best.position = o + d * distance, best.outside = normalize(n);
      }
    }
  }
  return best;
}

TEST(Trace, AgreesWithBruteForce) {
  uint32_t compared = 0, hit_count = 0;
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const Stage stage = randomStage(seed);
    const TraceScene trace(stage.scene, stage.diced);
    const std::vector<Ray> rays = randomRays(seed + 100, 1500);
    for (const Coherence coherence : {Coherence::Coherent, Coherence::Incoherent}) {
      const std::vector<Hit> hits = intersect(trace, rays, coherence);
      for (size_t i = 0; i < rays.size(); ++i) {
        const TwinHit twin = bruteForce(stage, rays[i]);
        if (twin.margin < 1e-4 || twin.nearest_other < 1e-4) continue;  // an edge: either answer is right
        ++compared;
        ASSERT_EQ(hits[i].valid(), twin.hit.valid()) << "ray " << i << " of seed " << seed;
        if (!twin.hit.valid()) continue;
        ++hit_count;
        EXPECT_EQ(hits[i].instance, twin.hit.instance);
        EXPECT_EQ(hits[i].mesh, twin.hit.mesh);
        EXPECT_EQ(hits[i].triangle, twin.hit.triangle);
        EXPECT_NEAR(hits[i].t, twin.hit.t, 1e-4);
        EXPECT_NEAR(hits[i].b1, twin.hit.b1, 2e-3);
        EXPECT_NEAR(hits[i].b2, twin.hit.b2, 2e-3);
        const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
        EXPECT_LT(length(toDouble(point.position) - twin.position), 1e-4);
        EXPECT_GT(dot(toDouble(point.ng), twin.outside), 0.9999);
        EXPECT_EQ(point.side, dot(twin.outside, toDouble(rays[i].direction)) > 0 ? 1u : 0u);
      }
    }
  }
  EXPECT_GT(compared, 10000u);
  EXPECT_GT(hit_count, 3000u);
}

TEST(Trace, PacketsOfAnySizeKeepTheOrder) {
  const Stage stage = randomStage(3);
  const TraceScene trace(stage.scene, stage.diced);
  const std::vector<Ray> rays = randomRays(9, 40);
  for (size_t count = 0; count <= 17; ++count) {
    const std::vector<Ray> some(rays.begin(), rays.begin() + ptrdiff_t(count));
    const std::vector<Hit> hits = intersect(trace, some);
    for (size_t i = 0; i < count; ++i) {
      const TwinHit twin = bruteForce(stage, some[i]);
      ASSERT_EQ(hits[i].valid(), twin.hit.valid());
      if (!hits[i].valid()) continue;
      EXPECT_EQ(hits[i].triangle, twin.hit.triangle);
      EXPECT_EQ(hits[i].instance, twin.hit.instance);
    }
  }
}

TEST(Trace, RespectsTheEndsOfRays) {
  Stage stage;
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}));
  const TraceScene trace(stage.scene, stage.diced);
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Ray> rays = {
      {{0.1f, 0.2f, 5}, 0, {0, 0, -1}, inf},      // front
      {{0.1f, 0.2f, 5}, 4.5f, {0, 0, -1}, inf},   // starts inside: back
      {{0.1f, 0.2f, 5}, 0, {0, 0, -1}, 3.9f},     // ends before
      {{0.1f, 0.2f, 5}, 4.5f, {0, 0, -1}, 5.5f},  // within
      {{0.1f, 0.2f, 5}, 0, {0, 0, 1}, inf},       // away
      {{nan, 0.2f, 5}, 0, {0, 0, -1}, inf},      {{0.1f, 0.2f, 5}, 2, {0, 0, -1}, 1},
  };
  const std::vector<Hit> hits = intersect(trace, rays);
  const float expected[] = {4, 6, inf, inf, inf, inf, inf};
  std::vector<uint8_t> occluded(rays.size(), 7);
  trace.occluded(rays, occluded, Coherence::Incoherent);
  for (size_t i = 0; i < rays.size(); ++i) {
    EXPECT_FLOAT_EQ(hits[i].t, expected[i]) << i;
    EXPECT_EQ(hits[i].valid(), expected[i] < inf) << i;
    EXPECT_EQ(occluded[i], expected[i] < inf ? 1 : 0) << i;
  }
  EXPECT_EQ(trace.surface(hits[0], rays[0].direction).side, 0u);
  EXPECT_EQ(trace.surface(hits[1], rays[1].direction).side, 1u);
}

// Bounds without thickness, as planes have them, must not swallow rays.
TEST(Trace, FlatMeshesAreHitByEveryRay) {
  Stream stream(8);
  for (int axis = 0; axis < 3; ++axis) {
    DicedMesh quad;
    const auto at = [&](float a, float b) {
      return axis == 0 ? Vec3f{3, a, b} : axis == 1 ? Vec3f{b, 3, a} : Vec3f{a, b, 3};
    };
    test::addQuad(quad, at(-50, -50), at(50, -50), at(50, 50), at(-50, 50));
    Stage stage;
    stage.add(quad);
    stage.add(quad, 0, test::rotation({0.6, 0, 0.8}, 1) * test::translation({500, 0, 0}));
    const TraceScene trace(stage.scene, stage.diced);
    std::vector<Ray> rays(5000);
    for (Ray& ray : rays) {
      const Vec3f target = at(stream.next(-49.999f, 49.999f), stream.next(-49.999f, 49.999f));
      ray.origin = target + stream.onSphere() * stream.next(0.1f, 100);
      ray.direction = normalize(target - ray.origin);
    }
    uint32_t missed = 0;
    for (const Hit& hit : intersect(trace, rays)) missed += !hit.valid();
    EXPECT_EQ(missed, 0u);
  }
}

TEST(Trace, OcclusionIsWhetherThereIsAHit) {
  const Stage stage = randomStage(5);
  const TraceScene trace(stage.scene, stage.diced);
  std::vector<Ray> rays = randomRays(21, 3000);
  Stream stream(4);
  for (Ray& ray : rays) ray.tfar = stream.next(0.1f, 9);
  std::vector<uint8_t> occluded(rays.size());
  trace.occluded(rays, occluded, Coherence::Incoherent);
  uint32_t compared = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    const TwinHit twin = bruteForce(stage, rays[i]);
    if (twin.margin < 1e-4 || std::abs(twin.hit.t - rays[i].tfar) < 1e-3f) continue;
    EXPECT_EQ(occluded[i] != 0, twin.hit.valid()) << i;
    ++compared;
  }
  EXPECT_GT(compared, 2000u);
}

TEST(Trace, EmptySceneIsAllMisses) {
  const Stage stage;
  const TraceScene trace(stage.scene, stage.diced);
  for (const Hit& hit : intersect(trace, randomRays(1, 20))) EXPECT_FALSE(hit.valid());
  EXPECT_EQ(trace.diagonal(), 0);
  EXPECT_EQ(trace.primitiveCount(), 0u);
}

TEST(Trace, CountsPrimitivesPerInstanceAndMicropolygonsOnce) {
  Stage stage;
  const uint32_t cube = stage.addMesh(test::box({0, 0, 0}, {1, 1, 1})), ball = stage.addMesh(test::sphere(4));
  const uint32_t both = stage.addPrototype({cube, ball});
  for (int i = 0; i < 5; ++i) stage.addInstance(both, test::translation({3.0 * i, 0, 0}));
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_EQ(trace.primitiveCount(), 5u * (6 + 96));
  EXPECT_EQ(trace.micropolygonCount(), 6u + 96);
  EXPECT_GT(trace.memoryBytes(), stage.diced[1].positions.size() * 24);
  EXPECT_NEAR(trace.diagonal(), std::sqrt(14.0 * 14 + 4 + 4), 0.01);
}

TEST(Trace, PrimitivesOfLaterMeshesComeAfterThoseOfEarlierOnes) {
  Stage stage;
  const uint32_t cube = stage.addMesh(test::box({-1, -1, -1}, {1, 1, 1}), 0);
  const uint32_t top = stage.addMesh(test::box({-1, 2, -1}, {1, 3, 1}), 2);
  stage.scene.materials.resize(4);
  stage.scene.meshes[top].face_materials = {-1, -1, -1, -1, 1, -1};
  const uint32_t both = stage.addPrototype({cube, top});
  stage.addInstance(both);
  stage.addInstance(both, test::translation({10, 0, 0}), 3);
  const TraceScene trace(stage.scene, stage.diced);
  const std::vector<Ray> rays = {{{0.1f, 9, 0}, 0, {0, -1, 0}},
                                 {{0.1f, -9, 0}, 0, {0, 1, 0}},
                                 {{9, 2.5f, 0.1f}, 0, {-1, 0, 0}},
                                 {{10.1f, 9, 0}, 0, {0, -1, 0}}};
  const std::vector<Hit> hits = intersect(trace, rays);
  const uint32_t primitive[] = {6 + 4, 5, 6 + 2, 6 + 4};
  const int32_t material[] = {1, 0, 2, 3};
  for (size_t i = 0; i < rays.size(); ++i) {
    const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
    EXPECT_EQ(point.primitive, primitive[i]);
    EXPECT_EQ(point.material, material[i]);
    EXPECT_EQ(trace.material(hits[i]), material[i]);
    const SurfaceKey key = point.key(hits[i].instance);
    EXPECT_EQ(key.instance, i == 3 ? 1u : 0u);
    EXPECT_EQ(key.primitive_side, primitive[i] * 2);
  }
}

// Rays at shared vertices and edges have several right answers; threads must not choose among them.
TEST(Determinism, BuildsDoNotDependOnThreads) {
  Stream stream(2);
  Stage stage;
  stage.add(test::sphere(80));
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}), 0, test::rotation({0, 0, 1}, 0.3));
  const DicedMesh& ball = stage.diced[0];
  std::vector<Ray> rays;
  for (int i = 0; i < 60000; ++i) {
    const uint32_t t = stream.index(uint32_t(ball.triangleCount()));
    const Vec3f a = ball.positions[ball.triangles[3 * t]], b = ball.positions[ball.triangles[3 * t + 1]];
    const Vec3f target = i % 2 ? a : a + (b - a) * stream.next(), origin = target * stream.next(2, 4);
    rays.push_back({origin, 0, normalize(target - origin)});
  }
  std::vector<std::vector<Hit>> results;
  for (const int threads : {1, 2, 4, 1}) {
    tbb::task_arena arena(threads);
    arena.execute([&] {
      const TraceScene trace(stage.scene, stage.diced);
      results.push_back(intersect(trace, rays));
    });
  }
  for (const auto& result : results)
    for (size_t i = 0; i < rays.size(); ++i) ASSERT_TRUE(same(result[i], results[0][i])) << i;
}

TEST(Trace, LeavesOutAndNamesWhatSinglePrecisionCannotPlace) {
  Stage stage;
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}), 0, test::scaling({1, 1, 1e-60}));
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}), 0, test::scaling({1e-10, 1e-10, 1e-10}));
  stage.add(test::box({-1, -1, -3}, {1, 1, -2}));
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_EQ(trace.untraceable(), (std::vector<uint32_t>{0, 1}));
  const std::vector<Hit> hits = intersect(trace, {{{0, 0, 5}, 0, {0, 0, -1}}, {{1e12f, 0, 5}, 0, {0, 0, -1}}});
  EXPECT_EQ(hits[0].instance, 2u);
  EXPECT_FALSE(hits[1].valid());
}

TEST(FlushDenormals, SetsAndRestores) {
  const uint32_t before = _mm_getcsr();
  {
    const FlushDenormals flush;
    volatile float tiny = 1e-30f;
    EXPECT_EQ(tiny * 1e-15f, 0.0f);
    EXPECT_EQ(_mm_getcsr() & 0x8040u, 0x8040u);
  }
  volatile float tiny = 1e-30f;
  EXPECT_EQ((_mm_getcsr() ^ before) & 0x8040u, 0u);
  EXPECT_NE(tiny * 1e-15f, 0.0f);
}

// Sixteen at a time, with lanes that cannot be traced among them.
TEST(Packets, AgreeWithSingleRaysAndSurfaces) {
  for (const Vec3f origin : {Vec3f{0, 0, 6}, Vec3f{3, -4, 2}, Vec3f{1e19f, 0, 0}}) {
    const Stage stage = randomStage(4);
    const TraceScene trace(stage.scene, stage.diced);
    const FlushDenormals flush;
    PacketTracer tracer(trace, origin);
    Stream stream(8);
    test::PacketCounts counts;
    for (uint32_t round = 0; round < 100; ++round) {
      const uint32_t count = round % kPacketWidth + 1;
      std::vector<Ray> rays(count);
      for (uint32_t i = 0; i < count; ++i) {
        Ray& ray = rays[i];
        ray.origin = origin, ray.direction = normalize(stream.inCube(2) - origin);
        ray.tfar = stream.next() < 0.2f ? 4 : 1e20f;
        if (round == 20 && i == 3) ray.direction.y = std::numeric_limits<float>::quiet_NaN();
        if (round == 21 && i == 4) ray.tnear = 9, ray.tfar = 8;
      }
      test::expectAgreement(trace, tracer, rays, round, counts);
    }
    EXPECT_EQ(counts.hit > 100, origin.x < 1e18f);
  }
}

}  // namespace
}  // namespace encore
