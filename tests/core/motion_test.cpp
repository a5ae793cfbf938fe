#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cstring>

#include "core/trace/packets.h"
#include "core/trace/trace_scene.h"
#include "core/trace/traced_triangle.h"
#include "moving_shapes.h"
#include "packet_agreement.h"

namespace encore {
namespace {

using test::frozen;
using test::intersect;
using test::movingStage;
using test::placedAt;
using test::randomTimedRays;
using test::same;
using test::Stage;
using test::Stream;

// The twin: every triangle of every instance at the ray's time, in double precision, in world space.
struct TwinHit {
  Hit hit;
  double margin = 1, nearest_other = 1e30;  // least |barycentric coordinate| met, |t - t_hit| of the second nearest
};

TwinHit bruteForce(const Stage& stage, const Ray& ray) {
  TwinHit best;
  double best_t = 1e300;
  const Vec3d o = toDouble(ray.origin), d = toDouble(ray.direction);
  for (uint32_t i = 0; i < stage.scene.instances.size(); ++i) {
    const Affine3d m = placedAt(stage.scene.instances[i], ray.time);
    const Prototype& prototype = stage.scene.prototypes[stage.scene.instances[i].prototype];
    for (uint32_t slot = 0; slot < prototype.meshes.size(); ++slot) {
      const DicedMesh& mesh = stage.diced[prototype.meshes[slot]];
      const auto vertex = [&](uint32_t k) {
        if (mesh.motion_positions.empty()) return m.point(toDouble(mesh.positions[k]));
        const double scaled = double(ray.time) * double(mesh.motion_positions.size() - 1);
        const size_t key = std::min(mesh.motion_positions.size() - 2, size_t(scaled));
        return m.point(test::mix(toDouble(mesh.motion_positions[key][k]), toDouble(mesh.motion_positions[key + 1][k]),
                                 scaled - double(key)));
      };
      for (uint32_t t = 0; t < mesh.triangleCount(); ++t) {
        const Vec3d p0 = vertex(mesh.triangles[3 * t]), e1 = vertex(mesh.triangles[3 * t + 1]) - p0,
                    e2 = vertex(mesh.triangles[3 * t + 2]) - p0, n = cross(e1, e2);
        const double distance = dot(p0 - o, n) / dot(n, d);
        if (!(distance > ray.tnear && distance < ray.tfar)) continue;
        const Vec3d p = o + d * distance - p0;
        const double b1 = dot(cross(p, e2), n) / dot(n, n), b2 = dot(cross(e1, p), n) / dot(n, n);
        const double inside = std::min({b1, b2, 1 - b1 - b2});
        best.margin = std::min(best.margin, std::abs(inside));
        if (inside < 0) continue;
        best.nearest_other = std::min(best.nearest_other, std::abs(distance - best_t));
        if (distance >= best_t) continue;
        best_t = distance;
        best.hit = {i, slot, t, float(b1), float(b2), float(distance), ray.time};
      }
    }
  }
  return best;
}

TEST(Motion, AgreesWithBruteForce) {
  uint32_t compared = 0, hit_count = 0;
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const Stage stage = movingStage(seed);
    const TraceScene trace(stage.scene, stage.diced);
    EXPECT_TRUE(trace.untraceable().empty());
    const std::vector<Ray> rays = randomTimedRays(seed + 100, 1500);
    for (const Coherence coherence : {Coherence::Coherent, Coherence::Incoherent}) {
      const std::vector<Hit> hits = intersect(trace, rays, coherence);
      std::vector<uint8_t> occluded(rays.size());
      trace.occluded(rays, occluded, coherence);
      for (size_t i = 0; i < rays.size(); ++i) {
        const TwinHit twin = bruteForce(stage, rays[i]);
        if (twin.margin < 1e-4 || twin.nearest_other < 1e-4) continue;  // an edge: either answer is right
        ++compared;
        ASSERT_EQ(hits[i].valid(), twin.hit.valid()) << "ray " << i << " of seed " << seed;
        EXPECT_EQ(occluded[i] != 0, twin.hit.valid());
        if (!twin.hit.valid()) continue;
        ++hit_count;
        EXPECT_EQ(hits[i].instance, twin.hit.instance);
        EXPECT_EQ(hits[i].mesh, twin.hit.mesh);
        EXPECT_EQ(hits[i].triangle, twin.hit.triangle);
        EXPECT_EQ(hits[i].time, rays[i].time);
        EXPECT_NEAR(hits[i].t, twin.hit.t, 1e-4);
        EXPECT_NEAR(hits[i].b1, twin.hit.b1, 2e-3);
        const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
        EXPECT_LT(length(point.position - (rays[i].origin + rays[i].direction * twin.hit.t)), 1e-4f);
        EXPECT_EQ(point.time, rays[i].time);
      }
    }
  }
  EXPECT_GT(compared, 10000u);
  EXPECT_GT(hit_count, 3000u);
}

// At every time the moving scene is what a still one is that was built for that time.
TEST(Motion, AtAnyTimeIsAStillScene) {
  for (uint32_t seed = 1; seed <= 3; ++seed) {
    Stage stage = movingStage(seed);
    DicedMesh& mesh = stage.diced[1];
    Stream stream(seed);
    for (size_t i = 0; i < mesh.positions.size(); ++i) mesh.normals.push_back(stream.onSphere());
    for (size_t k = 0; k < mesh.motion_positions.size(); ++k) {
      mesh.motion_normals.push_back(mesh.normals);
      for (Vec3f& n : mesh.motion_normals.back()) n = normalize(n + stream.onSphere() * 0.5f);
    }
    const TraceScene trace(stage.scene, stage.diced);
    for (const float time : {0.0f, 0.3f, 0.5f, 0.875f, 1.0f}) {
      const Stage still = frozen(stage, time);
      const TraceScene expected(still.scene, still.diced);
      Stream where(seed + 5);
      for (uint32_t instance = 0; instance < stage.scene.instances.size(); ++instance)
        for (uint32_t slot = 0; slot < trace.meshCount(instance); ++slot)
          for (uint32_t triangle = 0; triangle < trace.triangleCount(instance, slot); ++triangle) {
            const float b1 = where.next(), b2 = where.next() * (1 - b1);
            const Hit hit{instance, slot, triangle, b1, b2, 1, time};
            const Vec3f direction = where.onSphere();
            const SurfacePoint a = trace.surface(hit, direction), b = expected.surface(hit, direction);
            ASSERT_LT(length(a.position - b.position), 4e-6f);
            ASSERT_LT(length(a.e1 - b.e1) + length(a.e2 - b.e2), 4e-6f);
            ASSERT_LT(length(a.ng - b.ng), 1e-4f);
            ASSERT_LT(length(a.ns - b.ns), 1e-4f);
            ASSERT_LT(length(trace.objectPosition(hit) - expected.objectPosition(hit)), 1e-6f);
            const auto corners = trace.triangle(instance, slot, triangle, time),
                       still_corners = expected.triangle(instance, slot, triangle, 0);
            for (size_t k = 0; k < 3; ++k) ASSERT_LT(length(corners[k] - still_corners[k]), 4e-6f);
            ASSERT_LT(length(corners[0] + (corners[1] - corners[0]) * b1 + (corners[2] - corners[0]) * b2 - a.position),
                      4e-6f);
            const Vec3f dp = a.e1 * 0.3f - a.e2 * 0.2f;
            ASSERT_NEAR(trace.parametricFootprint(hit, a, dp, dp), expected.parametricFootprint(hit, b, dp, dp), 1e-4f);
          }
    }
  }
}

// A box that turns once around and goes up: dense keys follow the circle.
TEST(Motion, DenseKeysFollowARotation) {
  Stage stage;
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}));
  stage.scene.instances[0].motion = test::turning({0, 0, 1}, 2 * double{kPi}, {0, 0, 4}, {}, kMaxMotionKeys);
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_NEAR(trace.diagonal(), std::sqrt(8 + 8 + 36.0f), 0.01f);  // of all times together
  Stream stream(3);
  for (int i = 0; i < 500; ++i) {
    const float time = stream.next(), angle = 2 * kPi * time;
    const auto turn = [&](Vec3f v) {
      return Vec3f{std::cos(angle) * v.x - std::sin(angle) * v.y, std::sin(angle) * v.x + std::cos(angle) * v.y, v.z};
    };
    const Vec3f place{0, 0, 4 * time};
    const Vec3f target{1, stream.next(-0.99f, 0.99f), stream.next(-0.99f, 0.99f)};
    const Ray ray{turn({5, target.y, target.z}) + place, 0, turn({-1, 0, 0}), 1e30f, time};
    const std::vector<Hit> hits = intersect(trace, {ray});
    ASSERT_TRUE(hits[0].valid());
    const SurfacePoint point = trace.surface(hits[0], ray.direction);
    EXPECT_LT(length(point.position - (turn(target) + place)), 1e-3f);  // 1 - cos(π / 128) of the chord
    EXPECT_GT(dot(point.ng, turn({1, 0, 0})), 0.99999f);
  }
}

// Vertices and matrix move at once: the path is a parabola that leaves the straight line between the ends.
TEST(Motion, CurvedPathsStayInBounds) {
  Stage stage;
  DicedMesh mesh, moved;
  test::addQuad(mesh, {-0.01f, -1, 0}, {0.01f, -1, 0}, {0.01f, 1, 0}, {-0.01f, 1, 0});
  test::addQuad(moved, {0.99f, -1, 0}, {1.01f, -1, 0}, {1.01f, 1, 0}, {0.99f, 1, 0});
  mesh.motion_positions = {mesh.positions, moved.positions};
  stage.add(mesh);
  // Several, so that their bounds are looked at.
  for (int i = 1; i < 20; ++i) stage.addInstance(0);
  for (size_t i = 0; i < 20; ++i) {
    const Affine3d place = test::translation({0, 10 * double(i), 0});
    stage.scene.instances[i].motion = {place, place * test::scaling({0.1, 1, 1})};
  }
  const TraceScene trace(stage.scene, stage.diced);
  for (int i = 0; i <= 100; ++i) {
    const float time = float(i) / 100, x = time * (1 - 0.9f * time);
    for (const float y : {-0.9f, 0.0f, 0.9f}) {
      const std::vector<Hit> hits =
          intersect(trace, {{{x, y, 5}, 0, {0, 0, -1}, 1e30f, time}, {{x + 0.05f, y, 5}, 0, {0, 0, -1}, 1e30f, time}});
      EXPECT_TRUE(hits[0].valid()) << time;
      EXPECT_FALSE(hits[1].valid()) << time;
    }
  }
  // The triangles that hold the bounds can not be hit.
  EXPECT_FALSE(intersect(trace, {{{-0.01f, -1, 5}, 0, {0, 0, -1}, 1e30f, 0.5f}})[0].valid());
}

TEST(Motion, TimesOutsideOfTheShutterHitNothing) {
  Stage stage;
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}));
  stage.scene.instances[0].motion = {test::translation({0, 0, 0}), test::translation({0, 0, -1})};
  const TraceScene trace(stage.scene, stage.diced);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<Ray> rays;
  for (const float time : {0.0f, 1.0f, -0.01f, 1.01f, nan}) rays.push_back({{0, 0, 5}, 0, {0, 0, -1}, 1e30f, time});
  const std::vector<Hit> hits = intersect(trace, rays);
  EXPECT_FLOAT_EQ(hits[0].t, 4);
  EXPECT_FLOAT_EQ(hits[1].t, 5);
  for (size_t i = 2; i < 5; ++i) EXPECT_FALSE(hits[i].valid());
}

TEST(Motion, LeavesOutWhatIsSingularAtAnyTime) {
  Stage stage;
  const uint32_t prototype = stage.addPrototype({stage.addMesh(test::box({-1, -1, -1}, {1, 1, 1}))});
  const std::vector<std::vector<Affine3d>> motions = {
      {test::scaling({1, 1, 1}), test::scaling({2, 1, 1e-3})},  // fine
      {test::scaling({1, 1, 1}), test::scaling({0, 0, 0})},     // ends in a point
      {test::scaling({1, 1, 1}), test::scaling({1, 1, -1})},    // flat half-way
      {test::scaling({1, 1, 1}), test::scaling({-1, -1, 1})},   // half a turn: a line half-way
      {test::scaling({1, 1, 1}), test::scaling({1, 1e-60, 1}), test::scaling({1, 1, 1})}  // a key between
  };
  for (const auto& motion : motions) {
    const uint32_t instance = stage.addInstance(prototype);
    stage.scene.instances[instance].motion = motion;
  }
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_EQ(trace.untraceable(), (std::vector<uint32_t>{1, 2, 3, 4}));
  EXPECT_EQ(intersect(trace, {{{0, 0, 5}, 0, {0, 0, -1}, 1e30f, 0.5f}})[0].instance, 0u);
}

TEST(Motion, IsCountedAsMemory) {
  Stage stage;
  stage.add(test::sphere(20));
  const uint64_t still = TraceScene(stage.scene, stage.diced).memoryBytes();
  const size_t key = stage.diced[0].positions.size() * sizeof(Vec3f);
  test::shake(stage.diced[0], 5, 0.1f);
  EXPECT_GT(TraceScene(stage.scene, stage.diced).memoryBytes(), still + 9 * key);  // ours and Embree's
  stage.diced[0].motion_positions.clear();
  stage.diced[0].primvars = {std::vector<Vec4f>(100000)};
  EXPECT_GE(TraceScene(stage.scene, stage.diced).memoryBytes(), still + 100000 * sizeof(Vec4f));
}

TEST(Motion, BuildsDoNotDependOnThreads) {
  Stage stage = movingStage(2);
  DicedMesh ball = test::sphere(60);
  test::shake(ball, 4, 0.05f);
  stage.add(ball);
  std::vector<std::vector<Hit>> results;
  for (const int threads : {1, 2, 4}) {
    tbb::task_arena arena(threads);
    arena.execute([&] {
      const TraceScene trace(stage.scene, stage.diced);
      results.push_back(intersect(trace, randomTimedRays(6, 20000)));
    });
  }
  for (const auto& result : results)
    for (size_t i = 0; i < result.size(); ++i) ASSERT_TRUE(same(result[i], results[0][i])) << i;
}

// Position against double precision at the time: within position_error.
TEST(MotionError, PositionErrorIsABound) {
  const Stage stage = movingStage(8);
  const TraceScene trace(stage.scene, stage.diced);
  const std::vector<Ray> rays = randomTimedRays(31, 4000);
  const std::vector<Hit> hits = intersect(trace, rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!hits[i].valid()) continue;
    const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
    EXPECT_EQ(trace.positionError(hits[i], trace.surface(hits[i], rays[i].direction, false)), point.position_error);
    const Instance& instance = stage.scene.instances[hits[i].instance];
    const DicedMesh& mesh = stage.diced[stage.scene.prototypes[instance.prototype].meshes[hits[i].mesh]];
    const double scaled = double(rays[i].time) * double(mesh.motion_positions.size()) - double(rays[i].time);
    const auto corner = [&](uint32_t k) {
      const uint32_t vertex = mesh.triangles[3 * hits[i].triangle + k];
      if (mesh.motion_positions.empty()) return toDouble(mesh.positions[vertex]);
      const size_t key = std::min(mesh.motion_positions.size() - 2, size_t(scaled));
      return test::mix(toDouble(mesh.motion_positions[key][vertex]), toDouble(mesh.motion_positions[key + 1][vertex]),
                       scaled - double(key));
    };
    const double b1 = hits[i].b1, b2 = hits[i].b2;
    const Vec3d local = corner(0) + (corner(1) - corner(0)) * b1 + (corner(2) - corner(0)) * b2;
    const Vec3d exact = placedAt(instance, rays[i].time).point(local);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(std::abs(exact[axis] - double(point.position[axis])), double(point.position_error[axis]));
      EXPECT_LT(point.position_error[axis], 4e-4f);
    }
  }
}

// No ray that leaves a convex body outwards may meet it again while it moves, whatever its size and place.
TEST(MotionError, MovingBodiesAreLeftBehind) {
  Stream stream(12);
  uint64_t left = 0, false_hits = 0;
  for (int deforming = 0; deforming < 3; ++deforming)  // 1: stretched by its vertices, 2: and by its transform too
    for (const double scale : {1e-6, 1e-3, 1.0, 1e6})
      for (const double away : {0.0, 1.0, 1e3, 1e5})
        for (const size_t keys : {size_t{2}, size_t{9}, kMaxMotionKeys}) {
          DicedMesh body = test::sphere(12, false);
          if (deforming > 0)
            for (const float stretch : {1.0f, 1.7f, 0.4f}) {
              body.motion_positions.push_back(body.positions);
              for (Vec3f& p : body.motion_positions.back()) p = p * Vec3f{stretch, 1, 0.5f + stretch};
            }
          const Vec3d place = toDouble(stream.onSphere()) * (scale * away);
          const Affine3d start = test::translation(place) * test::scaling({scale, scale, scale}) *
                                 test::rotation(toDouble(stream.onSphere()), 1.3);
          Stage stage;
          stage.add(body, 0, start);
          if (deforming != 1)
            stage.scene.instances[0].motion = test::turning(toDouble(stream.onSphere()), keys == 2 ? 0.5 : 3,
                                                            toDouble(stream.onSphere()) * scale * 5, start, keys);
          const TraceScene trace(stage.scene, stage.diced);
          std::vector<Ray> rays(300), out;
          for (Ray& ray : rays) {
            ray.time = stream.next();
            const auto corner = trace.triangle(0, 0, stream.index(trace.triangleCount(0, 0)), ray.time);
            const Vec3f target = corner[0] * 0.3f + corner[1] * 0.4f + corner[2] * 0.3f;
            ray.origin = target + stream.onSphere() * (4 * float(scale));
            ray.direction = normalize(target - ray.origin);
          }
          const std::vector<Hit> hits = intersect(trace, rays);
          for (size_t i = 0; i < rays.size(); ++i) {
            if (!hits[i].valid()) continue;
            const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
            const float z = i % 3 == 0 ? std::pow(10.0f, stream.next(-7, 0)) : i % 3 == 1 ? 0.0f : stream.next();
            const float phi = stream.next(0, 2 * kPi), r = std::sqrt(std::max(0.0f, 1 - z * z));
            Vec3f up = Basis(point.ng).toWorld({r * std::cos(phi), r * std::sin(phi), z});
            if (dot(up, point.ng) < 0) up = -up;
            out.push_back({point.offsetOrigin(up), 0, up, 1e30f, rays[i].time});
          }
          for (const Hit& hit : intersect(trace, out)) false_hits += hit.valid();
          left += out.size();
        }
  EXPECT_EQ(false_hits, 0u) << "of " << left;
  EXPECT_GT(left, 30000u);
}

// Sixteen at a time, with origins and times of their own or shared ones, unusable lanes among them.
TEST(MotionPackets, AgreeWithSingleRaysAndSurfaces) {
  for (const bool moving : {false, true})
    for (const bool own_origins : {false, true}) {
      const Stage stage = moving ? movingStage(4) : test::randomStage(4);
      const TraceScene trace(stage.scene, stage.diced);
      const FlushDenormals flush;
      const Vec3f origin{3, -4, 2};
      PacketTracer tracer(trace, origin, own_origins);
      Stream stream(8);
      test::PacketCounts counts;
      for (uint32_t round = 0; round < 200; ++round) {
        const uint32_t count = round % kPacketWidth + 1;
        std::vector<Ray> rays(count);
        for (uint32_t i = 0; i < count; ++i) {
          Ray& ray = rays[i];
          ray.origin = own_origins ? origin + stream.inCube(1) : origin;
          if (own_origins && round == 22 && i == 3) ray.origin.y = 1e19f;
          ray.direction = normalize(stream.inCube(2) - ray.origin);
          if (moving || own_origins) ray.time = moving ? stream.next() * 0.5f + 0.25f : 0;
          if (moving && round % 8 == 7) ray.time = 0.5f;
          if (moving && round == 23 && i == 5) ray.time = std::numeric_limits<float>::quiet_NaN();
          if (round == 20 && i == 3) ray.direction.y = std::numeric_limits<float>::quiet_NaN();
          if (round == 21 && i == 4) ray.tnear = 9, ray.tfar = 8;
        }
        test::expectAgreement(trace, tracer, rays, round, counts);
      }
      EXPECT_GT(counts.hit, 200u);
      EXPECT_GT(counts.missed, 200u);
    }
}

TEST(MotionCache, AgreesWithSurface) {
  Stage stage;
  DicedMesh shaken = test::sphere(6);
  test::shake(shaken, 3, 0.2f);
  const uint32_t prototype = stage.addPrototype({stage.addMesh(test::sphere(6)), stage.addMesh(shaken)});
  stage.addInstance(prototype, test::translation({1, 2, 3}) * test::scaling({0.5, -2, 1}));
  stage.addInstance(prototype);
  stage.scene.instances[1].motion = test::turning({0, 0, 1}, 1, {1, 1, 1}, {}, 4);
  const TraceScene trace(stage.scene, stage.diced);
  TriangleCache cache(trace);
  Stream stream(9);
  for (int i = 0; i < 20000; ++i) {
    const uint32_t mesh = i / 7 % 2;
    const float b1 = stream.next(), b2 = stream.next() * (1 - b1), time = float(stream.index(3)) / 4;
    const Hit hit{uint32_t(i / 5 % 2), mesh, stream.index(40), b1, b2, 1, time};
    const Vec3f direction = stream.onSphere();
    const SurfacePoint a = trace.surface(hit, direction), b = cache.triangle(hit).surface(hit, direction);
    ASSERT_EQ(a.position, b.position);
    ASSERT_TRUE(a.ng == b.ng && a.ns == b.ns && a.dn1 == b.dn1 && a.dn2 == b.dn2 && a.uv == b.uv);
    ASSERT_TRUE(a.e1 == b.e1 && a.e2 == b.e2 && a.time == time && b.time == time);
    ASSERT_EQ(cache.triangle(hit).positionError(hit, b), a.position_error);
  }
}

}  // namespace
}  // namespace encore
