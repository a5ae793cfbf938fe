#include <gtest/gtest.h>
#include <tbb/task_arena.h>
#include <xmmintrin.h>

#include <cstring>

#include "core/scene/error.h"
#include "core/trace/trace_scene.h"
#include "shapes.h"

namespace encore {
namespace {

using test::Stage;
using test::Stream;

// The twin: every triangle of every instance, in double precision, in world space.
struct TwinHit {
  Hit hit;
  Vec3d position, outside;      // outside: unit normal
  double margin = 1;            // least distance of a barycentric coordinate of any triangle met from 0
  double nearest_other = 1e30;  // |t - t_hit| of the second nearest
};

Affine3d placed(const Instance& instance) {  // what a float32 tracer is given
  const Affine3f f = toFloat(instance.to_world);
  return {toDouble(f.ex), toDouble(f.ey), toDouble(f.ez), toDouble(f.origin)};
}

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

DicedMesh soup(Stream& stream, uint32_t count) {
  DicedMesh mesh;
  for (uint32_t i = 0; i < count; ++i) {
    const Vec3f centre = stream.inCube(1);
    test::addTriangle(mesh, centre + stream.inCube(0.4f), centre + stream.inCube(0.4f), centre + stream.inCube(0.4f));
  }
  return mesh;
}

Affine3d randomTransform(Stream& stream, int kind) {
  const Vec3d axis = toDouble(stream.onSphere());
  const Affine3d turn = test::rotation(axis, stream.next(0, 6)), move = test::translation(toDouble(stream.inCube(2)));
  switch (kind % 4) {
    case 0:
      return move * turn;
    case 1:
      return move * turn * test::scaling({1.5, -0.5, 0.8});  // mirrored
    case 2:
      return move * turn * test::scaling({2, 0.3, 1}) * test::rotation({0, 0, 1}, 0.7);  // sheared
    default:
      return move * turn * Affine3d{{1, 0, 0}, {0.8, -1, 0.2}, {0, 0.3, -0.4}, {0, 0, 0}};
  }
}

Stage randomStage(uint32_t seed) {
  Stream stream(seed);
  Stage stage;
  const uint32_t a = stage.addMesh(soup(stream, 30)), b = stage.addMesh(soup(stream, 20)), c = stage.addMesh({});
  const uint32_t first = stage.addPrototype({a, c, b}), second = stage.addPrototype({b});
  stage.addPrototype({a});  // never placed
  for (int i = 0; i < 8; ++i) stage.addInstance(i % 2 ? second : first, randomTransform(stream, i));
  return stage;
}

std::vector<Ray> randomRays(uint32_t seed, size_t count) {
  Stream stream(seed);
  std::vector<Ray> rays(count);
  for (Ray& ray : rays) {
    ray.origin = stream.inCube(5);
    ray.direction = normalize(stream.inCube(2) - ray.origin);
  }
  return rays;
}

std::vector<Hit> intersect(const TraceScene& trace, const std::vector<Ray>& rays,
                           Coherence coherence = Coherence::Incoherent) {
  std::vector<Hit> hits(rays.size());
  trace.intersect(rays, hits, coherence);
  return hits;
}

bool same(const Hit& a, const Hit& b) { return std::memcmp(&a, &b, sizeof(Hit)) == 0; }

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

// Position against double precision: within position_error, and the bound is not idly large.
TEST(Surface, PositionErrorIsABound) {
  const Stage stage = randomStage(8);
  const TraceScene trace(stage.scene, stage.diced);
  const std::vector<Ray> rays = randomRays(31, 4000);
  const std::vector<Hit> hits = intersect(trace, rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    if (!hits[i].valid()) continue;
    const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
    const Instance& instance = stage.scene.instances[hits[i].instance];
    const DicedMesh& mesh = stage.diced[stage.scene.prototypes[instance.prototype].meshes[hits[i].mesh]];
    const auto corner = [&](uint32_t k) { return toDouble(mesh.positions[mesh.triangles[3 * hits[i].triangle + k]]); };
    const double b1 = hits[i].b1, b2 = hits[i].b2;
    const Vec3d exact = placed(instance).point(corner(0) + (corner(1) - corner(0)) * b1 + (corner(2) - corner(0)) * b2);
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(std::abs(exact[axis] - double(point.position[axis])), double(point.position_error[axis]));
      EXPECT_LT(point.position_error[axis], 2e-4f);
    }
  }
}

// Directions around a normal down to grazing ones, the tangent plane included.
Vec3f leaving(Stream& stream, Vec3f n) {
  const Basis basis(n);
  const float kind = stream.next();
  const float z = kind < 0.6f ? stream.next() : kind < 0.9f ? std::pow(10.0f, stream.next(-7, 0)) : 0.0f;
  const float phi = stream.next(0, 2 * kPi), r = std::sqrt(std::max(0.0f, 1 - z * z));
  const Vec3f direction = basis.toWorld({r * std::cos(phi), r * std::sin(phi), z});
  return dot(direction, n) < 0 ? -direction : direction;  // rounding, in the tangent plane
}

struct ConvexCase {
  const char* name;
  DicedMesh mesh;
};

// No ray that leaves a convex body outwards may meet it again, whatever its size and place; every ray
// that leaves it inwards must meet its other side.
TEST(SelfIntersection, ConvexBodiesAtAllScalesAndPlaces) {
  const ConvexCase bodies[] = {{"box", test::box({-1, -1, -1}, {1, 1, 1})},
                               {"flat box", test::box({-1, -0.01f, -0.3f}, {1, 0.01f, 0.3f})},
                               {"sphere", test::sphere(6, false)},
                               {"fine sphere", test::sphere(60, false)}};
  Stream stream(12);
  uint64_t outward = 0, inward = 0, false_hits = 0, leaks = 0;
  for (const ConvexCase& body : bodies)
    for (const double scale : {1e-6, 1e-3, 1.0, 37.0, 1e6})
      for (const double away : {0.0, 1.0, 1e3, 1e5})
        for (int kind = 0; kind < 3; ++kind) {
          const Affine3d stretch = kind == 2 ? test::scaling({1, -0.4, 1.7}) : Affine3d{};
          const Affine3d turn = kind == 0 ? Affine3d{} : test::rotation(toDouble(stream.onSphere()), 1.3);
          const Vec3d place = toDouble(stream.onSphere()) * (scale * away);
          Stage stage;
          stage.add(body.mesh, 0, test::translation(place) * test::scaling({scale, scale, scale}) * turn * stretch);
          const TraceScene trace(stage.scene, stage.diced);
          const float size = float(scale);
          std::vector<Ray> rays(400), out, in;
          for (Ray& ray : rays) {
            const Vec3f target = toFloat(place) + stream.inCube(0.5f) * size;
            ray.origin = target + stream.onSphere() * (4 * size);
            ray.direction = normalize(target - ray.origin);
          }
          const std::vector<Hit> hits = intersect(trace, rays);
          std::vector<float> depth;  // of the inward rays' start below the surface
          for (size_t i = 0; i < rays.size(); ++i) {
            if (!hits[i].valid()) continue;
            const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
            const Vec3f up = leaving(stream, point.ng), down = leaving(stream, -point.ng);
            out.push_back({point.offsetOrigin(up), 0, up});
            // Where world coordinates are coarse, a start near an edge may lie beyond the neighbouring face.
            const float edge = std::min({hits[i].b1, hits[i].b2, 1 - hits[i].b1 - hits[i].b2});
            const Vec3f e = point.position_error;
            const float reach = 4 * length(e),
                        height = length(cross(point.e1, point.e2)) /
                                 std::max({length(point.e1), length(point.e2), length(point.e1 - point.e2)});
            if (edge * height > reach && dot(down, point.ng) < -1e-2f && body.mesh.positions.size() < 1000)
              in.push_back({point.offsetOrigin(down), 0, down});
          }
          const std::vector<Hit> again = intersect(trace, out), opposite = intersect(trace, in);
          for (const Hit& hit : again) false_hits += hit.valid();
          for (size_t i = 0; i < in.size(); ++i) {
            const bool from_inside = opposite[i].valid() && trace.surface(opposite[i], in[i].direction).side == 1;
            // A flat body far away can be thinner than the numbers that place it.
            if (!from_inside) ++leaks;
          }
          outward += out.size(), inward += in.size();
        }
  EXPECT_EQ(false_hits, 0u) << "of " << outward;
  EXPECT_EQ(leaks, 0u) << "of " << inward;
  EXPECT_GT(outward, 60000u);
  EXPECT_GT(inward, 20000u);
}

// Big, thin and sharp triangles, hit near corners and edges too.
TEST(SelfIntersection, SingleTrianglesOfAnyShape) {
  Stream stream(5);
  uint64_t rays_left = 0, false_hits = 0;
  for (int round = 0; round < 400; ++round) {
    const float size = std::pow(10.0f, stream.next(-6, 6)), thin = std::pow(10.0f, stream.next(-4, 0));
    const Vec3f centre = stream.inCube(round % 2 ? 0.0f : 10 * size), along = stream.onSphere();
    const Vec3f across = Basis(along).t;
    DicedMesh mesh;
    const Vec3f corner[3] = {centre, centre + along * size,
                             centre + along * (size * stream.next()) + across * (size * thin)};
    const uint32_t turn = stream.index(3);
    test::addTriangle(mesh, corner[turn], corner[(turn + 1) % 3], corner[(turn + 2) % 3]);
    Stage stage;
    stage.add(mesh, 0, test::rotation(toDouble(stream.onSphere()), stream.next(0, 6)));
    const TraceScene trace(stage.scene, stage.diced);
    std::vector<Ray> out;
    for (int i = 0; i < 200; ++i) {
      float b1 = stream.next(), b2 = stream.next() * (1 - b1);
      if (i % 4 == 0) b1 = 0;
      if (i % 8 == 1) b1 = std::pow(10.0f, stream.next(-6, 0)), b2 = 0;
      const Hit hit{0, 0, 0, b1, b2, 1};
      const SurfacePoint point = trace.surface(hit, stream.onSphere());
      const Vec3f direction = leaving(stream, i % 2 ? point.ng : -point.ng);
      out.push_back({point.offsetOrigin(direction), 0, direction});
    }
    for (const Hit& hit : intersect(trace, out)) false_hits += hit.valid();
    rays_left += out.size();
  }
  EXPECT_EQ(false_hits, 0u) << "of " << rays_left;
}

TEST(Surface, ShadingNormalsTurnWithTheTransformAndFallBack) {
  Stage stage;
  DicedMesh quad;
  test::addQuad(quad, {-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0});
  quad.normals = {{0.6f, 0, 0.8f}, {0.6f, 0, 0.8f}, {0, 0, 1}, {0, 0, -1}};
  const Affine3d mirror = test::rotation({0, 1, 0}, 0.5) * test::scaling({-2, 1, 3});
  stage.add(quad, 0, mirror);
  const TraceScene trace(stage.scene, stage.diced);
  const SurfacePoint tilted = trace.surface({0, 0, 0, 0.5f, 0, 1}, {0, 0, -1});
  const Vec3d expected = normalize(inverse(mirror).transposedVector(Vec3d{0.6, 0, 0.8}));
  EXPECT_LT(length(toDouble(tilted.ns) - expected), 1e-6);
  EXPECT_GT(dot(tilted.ng, tilted.ns), 0);
  // The second triangle's normals point backwards at its last corner.
  const SurfacePoint wrong = trace.surface({0, 0, 1, 0.0f, 0.9f, 1}, {0, 0, -1});
  EXPECT_EQ(wrong.ns, wrong.ng);
  EXPECT_EQ(wrong.dn1, Vec3f{});
}

TEST(Surface, ChangesAgreeWithFiniteDifferences) {
  Stage stage;
  DicedMesh mesh = test::sphere(5);
  mesh.texcoords.resize(2);
  Stream stream(44);
  for (const Vec3f& p : mesh.positions) {
    mesh.texcoords[1].push_back({p.x + 2 * p.y, p.z * p.z});
    mesh.display_color.push_back({p.x * 0.5f + 0.5f, 0.25f, 1});
  }
  const uint32_t index = stage.addMesh(mesh);
  stage.scene.meshes[index].texcoords.resize(2);
  stage.scene.meshes[index].texcoords[0].name = "empty", stage.scene.meshes[index].texcoords[1].name = "st";
  stage.addInstance(stage.addPrototype({index}), test::translation({1, 2, 3}) * test::scaling({1e-3, -2e-3, 0.5e-3}));
  const TraceScene trace(stage.scene, stage.diced);
  for (uint32_t triangle = 0; triangle < mesh.triangleCount(); ++triangle) {
    const float b1 = 0.3f, b2 = 0.25f, h = 0.01f;
    const Hit hit{0, 0, triangle, b1, b2, 1}, hit1{0, 0, triangle, b1 + h, b2, 1}, hit2{0, 0, triangle, b1, b2 + h, 1};
    const SurfacePoint point = trace.surface(hit, {0, 0, 1});
    const SurfacePoint point1 = trace.surface(hit1, {0, 0, 1}), point2 = trace.surface(hit2, {0, 0, 1});
    EXPECT_LT(length((point1.ns - point.ns) / h - point.dn1), 0.02f);
    EXPECT_LT(length((point2.ns - point.ns) / h - point.dn2), 0.02f);
    const Vec3f dpdx = point.e1 * 0.2f - point.e2 * 0.1f, dpdy = point.e2 * 0.3f + point.ng * 1e-4f;
    const Vec2f bx = point.barycentricChange(dpdx), by = point.barycentricChange(dpdy);
    EXPECT_NEAR(bx.x, 0.2f, 1e-4);
    EXPECT_NEAR(bx.y, -0.1f, 1e-4);
    EXPECT_NEAR(by.x, 0.0f, 1e-4);
    EXPECT_NEAR(by.y, 0.3f, 1e-4);
    EXPECT_EQ(trace.texcoordSlot(hit, "st"), 1);
    EXPECT_EQ(trace.texcoordSlot(hit, "empty"), -1);
    EXPECT_EQ(trace.texcoordSlot(hit, "other"), -1);
    const TexcoordPoint st = trace.texcoord(hit, point, 1, dpdx, dpdy);
    const Hit moved{0, 0, triangle, b1 + 0.2f, b2 - 0.1f, 1};
    const Vec2f there = trace.texcoord(moved, point, 1, dpdx, dpdy).st;
    EXPECT_NEAR(there.x - st.st.x, st.dstdx.x, 1e-4);
    EXPECT_NEAR(there.y - st.st.y, st.dstdx.y, 1e-4);
    EXPECT_EQ(trace.texcoord(hit, point, -1, dpdx, dpdy).st, Vec2f{});
    const Vec2f ux = trace.surface(moved, {0, 0, 1}).uv - point.uv;
    const Hit moved2{0, 0, triangle, b1, b2 + 0.3f, 1};
    const Vec2f uy = trace.surface(moved2, {0, 0, 1}).uv - point.uv;
    EXPECT_NEAR(trace.parametricFootprint(hit, point, dpdx, dpdy),
                0.5f * (std::hypot(ux.x, ux.y) + std::hypot(uy.x, uy.y)), 1e-4);
    EXPECT_NEAR(trace.displayColor(hit).y, 0.25f, 1e-6);
  }
  SurfacePoint degenerate;
  EXPECT_EQ(degenerate.barycentricChange({1, 0, 0}), Vec2f{});
}

TEST(Surface, ParametersStayInTheUnitSquare) {
  Stage stage;
  stage.add(test::sphere(3));
  const TraceScene trace(stage.scene, stage.diced);
  for (const float b1 : {0.0f, 0.3333333f, 1.0f})
    for (uint32_t triangle = 0; triangle < stage.diced[0].triangleCount(); ++triangle) {
      const SurfacePoint point = trace.surface({0, 0, triangle, b1, 1 - b1, 1}, {0, 0, 1});
      EXPECT_TRUE(point.uv.x >= 0 && point.uv.x <= 1 && point.uv.y >= 0 && point.uv.y <= 1);
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

}  // namespace
}  // namespace encore
