// Points, traced as spheres: against brute force in double precision.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/dice/spheres.h"
#include "core/scene/error.h"
#include "core/trace/packets.h"
#include "core/trace/sphere.h"
#include "core/trace/trace_scene.h"
#include "core/trace/traced_triangle.h"
#include "moving_shapes.h"

namespace encore {
namespace {

using test::Stream;

Mesh pointCloud(uint32_t seed, size_t count, size_t keys = 0) {
  Stream stream(seed);
  Mesh mesh;
  mesh.path = "/points", mesh.shape = Shape::Points;
  mesh.widths.interpolation = Interpolation::Vertex;
  for (size_t i = 0; i < count; ++i) {
    mesh.points.push_back(stream.inCube(3));
    mesh.widths.values.push_back(stream.next(0.2f, 1.5f));
  }
  for (size_t key = 0; key < keys; ++key) {
    std::vector<Vec3f> points = mesh.points.get();
    for (Vec3f& p : points) p += Vec3f{std::sin(p.y), float(key) * 0.7f, std::cos(p.x + float(key))};
    mesh.motion_points.push_back(points);
  }
  return mesh;
}

struct Cloud {
  Scene scene;
  DicedMeshes diced;

  explicit Cloud(std::vector<Mesh> meshes) {
    std::vector<DicedMesh> made;
    scene.materials.resize(2);
    for (const Mesh& mesh : meshes) {
      validateMesh(mesh, 2);
      made.push_back(diceMesh(mesh, 1, 1u << 30));
    }
    scene.meshes = std::move(meshes);
    Prototype prototype{"/p", {}};
    for (uint32_t i = 0; i < scene.meshes.size(); ++i) prototype.meshes.push_back(i);
    scene.prototypes = {prototype};
    diced = DicedMeshes(std::move(made));
  }
  void place(const Affine3d& to_world, std::vector<Affine3d> motion = {}) {
    scene.instances.push_back({"/i", 0, to_world, std::move(motion)});
  }
};

// All crossings of all spheres, in order.
struct Crossing {
  double t;
  uint32_t instance, mesh, point;
  Vec3d position, normal;  // world
  double miss = 0;         // how far from the silhouette the ray is, over the radius
};

std::vector<Crossing> bruteForce(const Cloud& cloud, const Ray& ray) {
  std::vector<Crossing> found;
  for (uint32_t i = 0; i < cloud.scene.instances.size(); ++i) {
    const Affine3d m = test::placedAt(cloud.scene.instances[i], ray.time), w = inverse(m);
    const Vec3d o = w.point(toDouble(ray.origin)), d = w.vector(toDouble(ray.direction));
    for (uint32_t slot = 0; slot < cloud.scene.meshes.size(); ++slot) {
      const Mesh& mesh = cloud.scene.meshes[slot];
      const std::vector<Vec3f> now =
          mesh.motion_points.empty()
              ? mesh.points.get()
              : test::atTime(mesh.motion_points.get(), ray.time,
                             [](const auto& a, const auto& b, double x) { return test::mix(a, b, x); });
      for (uint32_t k = 0; k < now.size(); ++k) {
        const double r = double(mesh.widths.values.get()[k]) / 2;
        const Vec3d c = toDouble(now[k]);
        const double a = dot(d, d), b = dot(d, c - o), rest = b * b - a * (dot(c - o, c - o) - r * r);
        if (rest < 0) continue;
        for (const double t : {(b - std::sqrt(rest)) / a, (b + std::sqrt(rest)) / a}) {
          if (!(t > ray.tnear && t < ray.tfar)) continue;
          const Vec3d p = o + d * t;
          found.push_back({t, i, slot, k, m.point(p), normalize(w.transposedVector((p - c) / r)), rest / (a * r * r)});
        }
      }
    }
  }
  std::sort(found.begin(), found.end(), [](const Crossing& x, const Crossing& y) { return x.t < y.t; });
  return found;
}

std::vector<Ray> randomRays(uint32_t seed, size_t count, bool timed) {
  Stream stream(seed);
  std::vector<Ray> rays;
  for (size_t i = 0; i < count; ++i) {
    Ray ray;
    ray.origin = stream.inCube(6), ray.direction = normalize(stream.inCube(3) - ray.origin);
    if (timed) ray.time = stream.next(0, 1);
    rays.push_back(ray);
  }
  return rays;
}

// Near silhouettes single precision may decide otherwise.
constexpr double kClear = 1e-3;

void expectHitsOf(const Cloud& cloud, bool timed, double tolerance) {
  const TraceScene trace(cloud.scene, cloud.diced);
  const std::vector<Ray> rays = randomRays(5, 4000, timed);
  for (const Coherence coherence : {Coherence::Coherent, Coherence::Incoherent}) {
    std::vector<Hit> hits(rays.size());
    std::vector<uint8_t> occluded(rays.size());
    trace.intersect(rays, hits, coherence);
    trace.occluded(rays, occluded, coherence);
    size_t seen = 0;
    for (size_t i = 0; i < rays.size(); ++i) {
      const std::vector<Crossing> truth = bruteForce(cloud, rays[i]);
      if (std::any_of(truth.begin(), truth.end(), [](const Crossing& c) { return c.miss < kClear; })) continue;
      ASSERT_EQ(hits[i].valid(), !truth.empty()) << i;
      EXPECT_EQ(occluded[i] != 0, !truth.empty()) << i;
      if (truth.empty()) continue;
      ++seen;
      const Crossing& first = truth[0];
      ASSERT_EQ(hits[i].instance, first.instance);
      ASSERT_EQ(hits[i].mesh, first.mesh);
      ASSERT_EQ(hits[i].triangle, first.point);
      EXPECT_EQ(trace.element(hits[i]), first.point);
      EXPECT_NEAR(hits[i].t, first.t, tolerance * 10);
      const SurfacePoint point = trace.surface(hits[i], rays[i].direction);
      EXPECT_LT(length(toDouble(point.position) - first.position), tolerance * 10) << i;
      EXPECT_LT(length(toDouble(point.ng) - first.normal), tolerance * 10) << i;
      EXPECT_LT(length(toDouble(point.ns) - first.normal), tolerance * 10) << i;
      EXPECT_EQ(point.side, dot(first.normal, toDouble(rays[i].direction)) > 0 ? 1u : 0u);
      EXPECT_EQ(point.uv.x, hits[i].b1 * 2);
      EXPECT_EQ(point.uv.y, hits[i].b2 * 2);
    }
    EXPECT_GT(seen, rays.size() / 12);
  }
}

TEST(Points, AreTheSpheresThatTheyAre) {
  Cloud cloud({pointCloud(1, 20), pointCloud(2, 10)});
  cloud.place({});
  expectHitsOf(cloud, false, 1e-5);
}

TEST(Points, AreEllipsoidsWhereInstancesStretchThem) {
  Cloud cloud({pointCloud(3, 12)});
  Affine3d m = test::rotation({1, 2, 3}, 0.7);
  m.ex = m.ex * 2.0, m.ey = m.ey * 0.4, m.ez = m.ez * -1.0, m.origin = {0.5, 1, -1};
  cloud.place(m);
  cloud.place(test::translation({0, -2, 0}));
  expectHitsOf(cloud, false, 3e-5);
}

TEST(Points, MoveAndSoDoTheirInstances) {
  Cloud cloud({pointCloud(4, 12, 3)});
  cloud.place({});
  expectHitsOf(cloud, true, 2e-5);
  const Affine3d start = test::translation({1, 0, 0});
  cloud.place(start, test::turning({0, 1, 1}, 1.0, {0, 2, 0}, start, 5));
  expectHitsOf(cloud, true, 5e-5);
}

TEST(Points, OfWidthZeroAreNotThere) {
  Mesh mesh = pointCloud(1, 3);
  mesh.widths.values = {1, 0, 1};
  mesh.points = {{-3, 0, 0}, {0, 0, 0}, {3, 0, 0}};
  Cloud cloud({mesh});
  cloud.place({});
  const TraceScene trace(cloud.scene, cloud.diced);
  std::vector<Ray> rays(3);
  for (size_t i = 0; i < 3; ++i) rays[i].origin = mesh.points[i] + Vec3f{0, 0, 5}, rays[i].direction = {0, 0, -1};
  std::vector<Hit> hits(3);
  trace.intersect(rays, hits, Coherence::Incoherent);
  EXPECT_TRUE(hits[0].valid() && !hits[1].valid() && hits[2].valid());
  EXPECT_EQ(trace.primitiveCount(), 3u);
}

TEST(Points, AreRoundFromFarAway) {
  Mesh mesh = pointCloud(1, 1);
  mesh.points = {{0, 0, 0}}, mesh.widths.values = {0.02f};
  Cloud cloud({mesh});
  cloud.place({});
  const TraceScene trace(cloud.scene, cloud.diced);
  Stream stream(3);
  for (int i = 0; i < 300; ++i) {
    const Vec3d target = toDouble(stream.onSphere()) * 0.006;
    Ray ray;
    ray.origin = stream.onSphere() * 300;  // 30,000 radii
    ray.direction = toFloat(normalize(target - toDouble(ray.origin)));
    Hit hit;
    trace.intersect({&ray, 1}, {&hit, 1}, Coherence::Coherent);
    ASSERT_TRUE(hit.valid());
    const SurfacePoint point = trace.surface(hit, ray.direction);
    EXPECT_NEAR(length(toDouble(point.position)), 0.01, 1e-8);
    const auto truth = bruteForce(cloud, ray);
    ASSERT_FALSE(truth.empty());
    EXPECT_LT(length(toDouble(point.ng) - truth[0].normal), 1e-5);
  }
}

// Rays that leave a sphere do not meet it again on the outside, at any angle; those that enter it leave it once.
TEST(Points, AreLeftAndEnteredOnce) {
  Cloud cloud({pointCloud(8, 1)});
  Stream stream(17);
  for (const double scale : {1e-3, 1.0, 1e3})
    for (const Vec3d away : {Vec3d{0, 0, 0}, Vec3d{50, 20, 10}}) {
      cloud.scene.instances.clear();
      Affine3d m = test::rotation({1, 2, 3}, 0.7);
      m.ex = m.ex * scale, m.ey = m.ey * (0.5 * scale), m.ez = m.ez * scale, m.origin = away * scale;
      cloud.place(m);
      const TraceScene trace(cloud.scene, cloud.diced);
      const Vec3f centre = toFloat(m.point(toDouble(cloud.scene.meshes[0].points[0])));
      for (int i = 0; i < 2000; ++i) {
        Ray ray;
        ray.origin = centre + stream.onSphere() * float(scale * 5);
        ray.direction = normalize(centre + stream.inCube(1) * float(0.1 * scale) - ray.origin);
        Hit hit;
        trace.intersect({&ray, 1}, {&hit, 1}, Coherence::Incoherent);
        if (!hit.valid()) continue;
        const SurfacePoint point = trace.surface(hit, ray.direction);
        EXPECT_EQ(point.side, 0u);
        // From grazing to straight.
        const Basis basis(point.ng);
        const float z = std::pow(10.0f, -stream.next(0, 6)), a = stream.next(0, 6.2f), s = std::sqrt(1 - z * z);
        Ray leaving;
        leaving.direction = basis.toWorld({s * std::cos(a), s * std::sin(a), z});
        leaving.origin = point.offsetOrigin(leaving.direction);
        trace.intersect({&leaving, 1}, {&hit, 1}, Coherence::Incoherent);
        EXPECT_FALSE(hit.valid()) << scale << ' ' << z;
        if (z < 0.05f) continue;  // chords that are none
        Ray entering;
        entering.direction = basis.toWorld({s * std::cos(a), s * std::sin(a), -z});
        entering.origin = point.offsetOrigin(entering.direction);
        trace.intersect({&entering, 1}, {&hit, 1}, Coherence::Incoherent);
        ASSERT_TRUE(hit.valid()) << scale << ' ' << z;
        EXPECT_EQ(trace.surface(hit, entering.direction).side, 1u);
        EXPECT_GT(hit.t, 0.01f * z * float(scale)) << z;
      }
    }
}

// The derivatives, by differences.
TEST(Points, ChangeAlongTheirParameters) {
  Cloud cloud({pointCloud(6, 1)});
  Affine3d m = test::rotation({1, 1, 0}, 0.5);
  m.ex = m.ex * 3.0;
  cloud.place(m);
  const TraceScene trace(cloud.scene, cloud.diced);
  Stream stream(2);
  for (int i = 0; i < 500; ++i) {
    Hit hit{0, 0, 0, stream.next(0, 0.499f), stream.next(0, 0.499f), 1, 0};
    const float x = 4 * hit.b1 - 1, y = 4 * hit.b2 - 1, h = 1e-3f;
    const auto nearFold = [&](float v) { return std::abs(v) < 0.02f; };
    if (nearFold(x) || nearFold(y) || nearFold(1 - std::abs(x) - std::abs(y))) continue;
    const SurfacePoint point = trace.surface(hit, {0, 0, 1});
    EXPECT_NEAR(dot(normalize(cross(point.e1, point.e2)), point.ng), 1, 1e-3);
    Hit along1 = hit, along2 = hit;
    along1.b1 += h, along2.b2 += h;
    const SurfacePoint p1 = trace.surface(along1, {0, 0, 1}), p2 = trace.surface(along2, {0, 0, 1});
    const float size = length(point.e1) + length(point.e2);
    EXPECT_LT(length((p1.position - point.position) * (1 / h) - point.e1), 0.02f * size);
    EXPECT_LT(length((p2.position - point.position) * (1 / h) - point.e2), 0.02f * size);
    EXPECT_LT(length((p1.ns - point.ns) * (1 / h) - point.dn1), 0.3f);
    EXPECT_LT(length((p2.ns - point.ns) * (1 / h) - point.dn2), 0.3f);
    EXPECT_NEAR(trace.parametricFootprint(hit, point, point.e1 * h, point.e2 * h), 2 * h, 1e-4f);
  }
}

// Packets give what single hits give.
TEST(Points, AreTheSameInPackets) {
  Cloud cloud({pointCloud(1, 20, 2)});
  cloud.place({});
  const TraceScene trace(cloud.scene, cloud.diced);
  PacketTracer tracer(trace, {0, 0, 0}, true);
  const std::vector<Ray> rays = randomRays(9, 16 * 40, true);
  for (size_t first = 0; first < rays.size(); first += 16) {
    RayPacket packet;
    for (uint32_t k = 0; k < 16; ++k) {
      const Ray& ray = rays[first + k];
      packet.ox[k] = ray.origin.x, packet.oy[k] = ray.origin.y, packet.oz[k] = ray.origin.z, packet.time[k] = ray.time;
      packet.dx[k] = ray.direction.x, packet.dy[k] = ray.direction.y, packet.dz[k] = ray.direction.z;
      packet.tnear[k] = 0, packet.tfar[k] = ray.tfar;
    }
    HitPacket hits;
    SurfacePacket points;
    tracer.intersect(packet, 16, hits);
    tracer.surface(packet, hits, points);
    std::vector<Hit> single(16);
    trace.intersect(std::span(rays).subspan(first, 16), single, Coherence::Coherent);
    for (uint32_t k = 0; k < 16; ++k) {
      const Hit hit = hits.hit(k);
      ASSERT_EQ(hit.valid(), single[k].valid());
      if (!hit.valid()) continue;
      EXPECT_EQ(hit.triangle, single[k].triangle);
      EXPECT_EQ(hit.b1, single[k].b1);
      EXPECT_EQ(hit.b2, single[k].b2);
      const SurfacePoint point = trace.surface(hit, rays[first + k].direction);
      EXPECT_EQ(points.primitive_side[k], point.key(0).primitive_side);
      EXPECT_EQ(points.u[k], point.uv.x);
      EXPECT_EQ(points.v[k], point.uv.y);
      EXPECT_EQ(tracer.geometricNormal(packet, hits, k), point.ng);
      const Vec3f dpdx = point.e1 * 0.01f, dpdy = point.e2 * 0.01f;
      EXPECT_EQ(tracer.gradients(hits, k).footprint(dpdx, dpdy), trace.parametricFootprint(hit, point, dpdx, dpdy));
      TriangleCache triangles(trace);
      const SurfacePoint cached = triangles.triangle(hit).surface(hit, rays[first + k].direction);
      EXPECT_EQ(cached.position, point.position);
      EXPECT_EQ(cached.ns, point.ns);
    }
  }
}

TEST(Points, CarryOneValueEach) {
  Mesh mesh = pointCloud(1, 3);
  mesh.points = {{-3, 0, 0}, {0, 0, 0}, {3, 0, 0}};
  mesh.display_color = {"displayColor", Interpolation::Vertex, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {}};
  mesh.texcoords = {{"st", Interpolation::Varying, {{1, 2}, {3, 4}}, {0, 1, 0}}};
  mesh.primvars = {{"all", Interpolation::Constant, {{1, 2, 3, 4}}, {}}};
  mesh.face_materials = {-1, 1, 0};
  Cloud cloud({mesh});
  cloud.place({});
  const TraceScene trace(cloud.scene, cloud.diced);
  for (uint32_t i = 0; i < 3; ++i) {
    const Hit hit{0, 0, i, 0.1f, 0.3f, 1, 0};
    EXPECT_EQ(trace.material(hit), i == 1 ? 1 : 0);
    EXPECT_EQ(trace.surface(hit, {0, 0, 1}).material, i == 1 ? 1 : 0);
    EXPECT_EQ(trace.displayColor(hit), mesh.display_color.values.get()[i]);
    const SurfacePoint point = trace.surface(hit, {0, 0, 1});
    const TexcoordPoint st = trace.texcoord(hit, point, trace.texcoordSlot(hit, "st"), {1, 0, 0}, {0, 1, 0});
    EXPECT_EQ(st.st, (i == 1 ? Vec2f{3, 4} : Vec2f{1, 2}));
    EXPECT_EQ(st.dstdx, Vec2f{});
    EXPECT_EQ(trace.primvar(hit, trace.primvarSlot(hit, "all")), (Vec4f{1, 2, 3, 4}));
    Vec3f s, t;
    EXPECT_FALSE(trace.tangents(hit, point, trace.texcoordSlot(hit, "st"), s, t));
    EXPECT_LT(length(trace.objectPosition(hit) - point.position), 1e-6f);
  }
}

// Every crossing of every sphere, as often as it is asked for more.
TEST(Points, LetLightThroughAtAllTheirCrossings) {
  for (const size_t keys : {0, 3}) {
    Cloud cloud({pointCloud(11, 60, keys)});
    cloud.place({});
    cloud.place(test::translation({0.3, 0.2, 0.1}));
    cloud.scene.meshes[0].material = 1;
    const std::vector<uint8_t> passes{0, 1};
    const TraceScene trace(cloud.scene, cloud.diced, false, passes);
    ASSERT_TRUE(trace.needsShadowHits());
    const std::vector<Ray> rays = randomRays(21, 800, keys > 0);
    size_t most = 0;
    for (const Ray& ray : rays) {
      const std::vector<Crossing> truth = bruteForce(cloud, ray);
      if (std::any_of(truth.begin(), truth.end(), [](const Crossing& c) { return c.miss < kClear; })) continue;
      std::vector<Hit> found;
      ShadowHits hits;
      trace.shadows({&ray, 1}, {}, {&hits, 1}, Coherence::Incoherent);
      for (;;) {
        ASSERT_FALSE(hits.occluded);
        found.insert(found.end(), hits.hits.begin(), hits.hits.begin() + hits.count);
        if (!hits.overflow) break;
        trace.shadows({&ray, 1}, {{}, true}, {&hits, 1}, Coherence::Incoherent);
      }
      ASSERT_EQ(found.size(), truth.size());
      most = std::max(most, found.size());
      for (size_t i = 0; i < found.size(); ++i) {
        EXPECT_NEAR(found[i].t, truth[i].t, 1e-4);
        EXPECT_EQ(found[i].triangle, truth[i].point);
        const SurfacePoint point = trace.surface(found[i], ray.direction);
        EXPECT_LT(length(toDouble(point.position) - truth[i].position), 1e-4);
      }
    }
    EXPECT_GT(most, kRecordedHits);
  }
}

TEST(Points, EndShadowRaysWhereTheyAreOpaque) {
  Cloud cloud({pointCloud(11, 20), pointCloud(12, 20)});
  cloud.scene.meshes[0].material = 1;
  cloud.place({});
  const std::vector<uint8_t> passes{0, 1};
  const TraceScene trace(cloud.scene, cloud.diced, false, passes);
  for (const Ray& ray : randomRays(3, 1500, false)) {
    const std::vector<Crossing> truth = bruteForce(cloud, ray);
    if (std::any_of(truth.begin(), truth.end(), [](const Crossing& c) { return c.miss < kClear; })) continue;
    const bool ends = std::any_of(truth.begin(), truth.end(), [](const Crossing& c) { return c.mesh == 1; });
    ShadowHits hits;
    trace.shadows({&ray, 1}, {}, {&hits, 1}, Coherence::Incoherent);
    EXPECT_EQ(hits.occluded, ends);
  }
}

TEST(Points, TakeSixteenBytesAndTheirTree) {
  Mesh mesh = pointCloud(1, 200000);
  mesh.widths = {"widths", Interpolation::Constant, {0.01f}, {}};
  mesh.display_color = {"displayColor", Interpolation::Constant, {{1, 0, 0}}, {}};
  Cloud cloud({mesh});
  cloud.place({});
  const TraceScene trace(cloud.scene, cloud.diced, true);
  EXPECT_EQ(trace.primitiveCount(), 200000u);
  EXPECT_LT(trace.memoryBytes(), 200000u * 64);
  const Hit hit{0, 0, 17, 0.1f, 0.2f, 1, 0};
  EXPECT_EQ(trace.surface(hit, {0, 0, 1}).uv, (Vec2f{0.2f, 0.4f}));
  EXPECT_EQ(trace.displayColor(hit), (Vec3f{1, 0, 0}));
}

TEST(Points, ThatAreWrongAreNamed) {
  const auto messageOf = [](const Mesh& mesh) -> std::string {
    try {
      validateMesh(mesh, 1);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  Mesh mesh = pointCloud(1, 3);
  EXPECT_EQ(messageOf(mesh), "");
  mesh.widths.values = {1, 2};
  EXPECT_NE(messageOf(mesh).find("/points.widths"), std::string::npos);
  mesh.widths.values = {1, 2, -3};
  EXPECT_NE(messageOf(mesh).find("below 0"), std::string::npos);
  mesh.widths.values = {1, 2, 3};
  mesh.points[1].y = std::numeric_limits<float>::infinity();
  EXPECT_NE(messageOf(mesh).find("/points.points"), std::string::npos);
  EXPECT_THROW(diceMesh(pointCloud(1, 3), 1, 2), Error);
}

}  // namespace
}  // namespace encore
