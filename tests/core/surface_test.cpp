#include <gtest/gtest.h>

#include "core/trace/trace_scene.h"
#include "core/trace/traced_triangle.h"
#include "shapes.h"

namespace encore {
namespace {

using test::intersect;
using test::placed;
using test::randomRays;
using test::randomStage;
using test::Stage;
using test::Stream;

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

// Coordinates that are exactly 0 have no rounding error; rays must leave their plane all the same.
TEST(SelfIntersection, PlanesThroughTheOriginAreLeftToTheRightSide) {
  Stream stream(31);
  for (const float size : {1e-6f, 1.0f, 1e6f})
    for (int axis = 0; axis < 3; ++axis) {
      const auto at = [&](float a, float b) {
        return axis == 0 ? Vec3f{0, a, b} : axis == 1 ? Vec3f{b, 0, a} : Vec3f{a, b, 0};
      };
      DicedMesh quad;
      test::addQuad(quad, at(-size, -size), at(size, -size), at(size, size), at(-size, size));
      Stage stage;
      stage.add(quad);
      const TraceScene trace(stage.scene, stage.diced);
      const FlushDenormals flush;
      std::vector<Ray> rays;
      for (int i = 0; i < 200; ++i) {
        const float b1 = stream.next(), b2 = stream.next() * (1 - b1);
        const SurfacePoint point = trace.surface({0, 0, uint32_t(i % 2), b1, b2, 1}, stream.onSphere());
        const Vec3f direction = leaving(stream, i % 3 ? point.ng : -point.ng);
        const Vec3f origin = point.offsetOrigin(direction);
        EXPECT_GT(dot(origin, dot(point.ng, direction) < 0 ? -point.ng : point.ng), 0.0f);
        rays.push_back({origin, 0, direction});
      }
      for (const Hit& hit : intersect(trace, rays)) EXPECT_FALSE(hit.valid());
    }
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

// More triangles than there is room for, in an order in which they come back.
TEST(TriangleCache, AgreesWithSurface) {
  Stage stage;
  const uint32_t prototype = stage.addPrototype({stage.addMesh(test::sphere(16)), stage.addMesh(test::sphere(12))});
  stage.addInstance(prototype, test::translation({1, 2, 3}) * test::scaling({0.5, -2, 1}));
  stage.addInstance(prototype, test::rotation({0, 0, 1}, 0.7));
  const TraceScene trace(stage.scene, stage.diced);
  TriangleCache cache(trace);
  Stream stream(9);
  for (int i = 0; i < 20000; ++i) {
    const uint32_t mesh = i / 7 % 2;
    const uint32_t triangle = uint32_t(stream.next() * float(stage.diced[mesh].triangleCount() - 1));
    const float b1 = stream.next(), b2 = stream.next() * (1 - b1);
    const Hit hit{uint32_t(i / 5 % 2), mesh, triangle, b1, b2, 1};
    const Vec3f direction = stream.onSphere();
    const SurfacePoint a = trace.surface(hit, direction), b = cache.triangle(hit).surface(hit, direction);
    ASSERT_EQ(a.position, b.position);
    ASSERT_TRUE(a.ng == b.ng && a.ns == b.ns && a.dn1 == b.dn1 && a.dn2 == b.dn2 && a.uv == b.uv);
    ASSERT_TRUE(a.side == b.side && a.primitive == b.primitive && a.material == b.material);
    ASSERT_EQ(cache.triangle(hit).positionError(hit, b), a.position_error);
    ASSERT_EQ(trace.positionError(hit, b), a.position_error);
    const Vec3f dp = a.e1 * stream.next(-1, 1) + a.e2 * stream.next(-1, 1);
    const Vec2f exact = a.barycentricChange(dp), change = cache.triangle(hit).barycentricChange(dp);
    ASSERT_NEAR(change.x, exact.x, 1e-5f);
    ASSERT_NEAR(change.y, exact.y, 1e-5f);
  }
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

}  // namespace
}  // namespace encore
