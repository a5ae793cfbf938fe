// From (u, v) to points of faces, against looking at every triangle.
#include "core/render/face_shape.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "vertex_world.h"

namespace encore {
namespace {

using namespace test;

double distance(Vec2f a, Vec2f b) { return std::hypot(double(a.x - b.x), double(a.y - b.y)); }

void expectFindsItself(const DicedMesh& mesh, uint32_t primitive, Stream& stream) {
  const FaceShape shape(mesh, primitive);
  for (int i = 0; i < 300; ++i) {
    const Vec2f uv = i < 4 ? Vec2f{float(i % 2), float(i / 2)} : Vec2f{stream.next(), stream.next()};
    bool inside = false;  // the slow way: any triangle that holds it
    for (uint32_t t = 0; t < mesh.triangleCount(); ++t) {
      if (mesh.triangle_primitive[t] != primitive) continue;
      const uint32_t* c = &mesh.triangles[3 * size_t{t}];
      const auto turn = [&](Vec2f a, Vec2f b) {
        return double(b.x - a.x) * double(uv.y - a.y) - double(b.y - a.y) * double(uv.x - a.x);
      };
      const double t0 = turn(mesh.uv[c[0]], mesh.uv[c[1]]), t1 = turn(mesh.uv[c[1]], mesh.uv[c[2]]),
                   t2 = turn(mesh.uv[c[2]], mesh.uv[c[0]]);
      inside = inside || std::min({t0, t1, t2}) >= 0 || std::max({t0, t1, t2}) <= 0;
    }
    const auto found = shape.find(uv);
    if (inside) {
      ASSERT_TRUE(found);
      EXPECT_EQ(mesh.triangle_primitive[found->triangle], primitive);
      EXPECT_GE(std::min(found->b1, found->b2), 0);
      EXPECT_LE(found->b1 + found->b2, 1 + 1e-6f);
      EXPECT_LT(distance(uvAt(mesh, *found), uv), 1e-5);
    } else if (found) {
      EXPECT_LT(distance(uvAt(mesh, *found), uv), 1e-4);  // rounding at the border
    }
  }
}

TEST(FaceShape, FindsThePointsOfAllKindsOfFaces) {
  Stream stream(11);
  DicedMesh flat;
  addQuad(flat, {0, 0, 0}, {3, 0, 0}, {2, 1, 0}, {0, 1, 0});
  addTriangle(flat, {0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  expectFindsItself(flat, 0, stream);
  expectFindsItself(flat, 1, stream);
  EXPECT_FALSE(FaceShape(flat, 0).triangular());
  EXPECT_TRUE(FaceShape(flat, 1).triangular());
  expectFindsItself(diceMesh(concaveMesh(), 1, 1000), 0, stream);
  const DicedMesh grids = diceMesh(cube(), 0.1f, 1'000'000);  // hundreds of triangles to a primitive
  ASSERT_GT(grids.triangleCount() / grids.primitiveCount(), 100u);
  for (const uint32_t primitive : {0u, 5u}) expectFindsItself(grids, primitive, stream);
  const DicedMesh loop = diceMesh(octahedron(SubdivisionScheme::Loop), 0.1f, 1'000'000);
  EXPECT_TRUE(FaceShape(loop, 3).triangular());
  expectFindsItself(loop, 3, stream);
}

TEST(FaceShape, NearestIsTheNearestOfManyPoints) {
  Stream stream(12);
  const DicedMesh mesh = diceMesh(concaveMesh(), 1, 1000);
  const FaceShape shape(mesh, 0);
  const Vec2f step{0.11f, 0.07f};
  int found_outside = 0;
  for (int i = 0; i < 200; ++i) {
    const Vec2f uv{stream.next(), stream.next()};
    const auto nearest = shape.nearest(uv, step);
    // Points of the L in the box around uv, by brute force.
    double least = 1e30;
    for (int y = -40; y <= 40; ++y)
      for (int x = -40; x <= 40; ++x) {
        const Vec2f d{step.x * float(x) / 40, step.y * float(y) / 40}, p = uv + d;
        if (p.x < 0 || p.y < 0 || p.x > 1 || p.y > 1 || (p.x > 0.5f && p.y > 0.5f)) continue;
        least = std::min(least, std::hypot(double(x), double(y)) / 40);
      }
    EXPECT_EQ(nearest.has_value(), least < 1e30) << uv.x << " " << uv.y;
    if (!nearest) continue;
    const Vec2f at = uvAt(mesh, *nearest) - uv;
    EXPECT_LE(std::hypot(double(at.x / step.x), double(at.y / step.y)), least + 1e-4);
    found_outside += least > 0;
  }
  EXPECT_GT(found_outside, 10);
}

// The quad's second triangle is a line in space: no ray hits it, and no vertex stands on it.
TEST(FaceShape, OfASphereIsTheWholeSquare) {
  DicedMesh mesh;
  mesh.spheres = {{0, 0, 0, 1}, {1, 2, 3, 2}};
  const FaceShape shape(mesh, 1);
  EXPECT_FALSE(shape.triangular());
  for (const Vec2f uv : {Vec2f{0, 0}, Vec2f{1, 1}, Vec2f{0.25f, 0.75f}}) {
    const auto point = shape.find(uv);
    ASSERT_TRUE(point);
    EXPECT_EQ(point->triangle, 1u);
    EXPECT_EQ(point->b1, uv.x / 2);
    EXPECT_EQ(point->b2, uv.y / 2);
  }
  EXPECT_FALSE(shape.find({1.01f, 0.5f}));
  EXPECT_EQ(shape.nearest({1.01f, 0.5f}, {0.1f, 0.1f})->b1, 0.5f);
  EXPECT_EQ(shape.extrapolate({-0.5f, 0.5f}).b1, 0);
}

TEST(FaceShape, TrianglesWithoutAnAreaAreNotThere) {
  DicedMesh mesh;
  addQuad(mesh, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 1, 0});
  mesh.positions[3] = mesh.positions[2];
  const FaceShape shape(mesh, 0);
  EXPECT_FALSE(shape.find({0.1f, 0.9f}));
  const auto nearest = shape.nearest({0.1f, 0.3f}, {0.25f, 0.25f});
  ASSERT_TRUE(nearest);
  EXPECT_EQ(nearest->triangle, 0u);
  EXPECT_FALSE(shape.nearest({0.1f, 0.9f}, {0.25f, 0.25f}));
}

}  // namespace
}  // namespace encore
