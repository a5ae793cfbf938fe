// Undiced polygons: triangles, coordinates, authored normals.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "core/dice/polygon.h"
#include "core/scene/error.h"
#include "tests/core/dice_meshes.h"

namespace encore {
namespace {

using test::makeMesh;

double signedArea(const std::vector<PlanePoint>& p) {
  double sum = 0;
  for (size_t i = 0; i < p.size(); ++i) {
    const PlanePoint a = p[i], b = p[(i + 1) % p.size()];
    sum += (a.x * b.y - a.y * b.x) / 2;
  }
  return sum;
}

double area(PlanePoint a, PlanePoint b, PlanePoint c) {
  return ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) / 2;
}

// n - 2 triangles, none of them turned over, that sum up to the polygon's area: they cover it exactly.
void expectExactCover(const std::vector<PlanePoint>& polygon) {
  const auto triangles = earClip(polygon);
  ASSERT_EQ(triangles.size(), 3 * (polygon.size() - 2));
  const double whole = signedArea(polygon);
  double sum = 0;
  for (size_t i = 0; i < triangles.size(); i += 3) {
    const double part = area(polygon[triangles[i]], polygon[triangles[i + 1]], polygon[triangles[i + 2]]);
    EXPECT_GE(part, -1e-12 * whole);
    sum += part;
  }
  EXPECT_NEAR(sum, whole, 1e-12 * whole);
}

TEST(EarClip, CoversConcavePolygons) {
  expectExactCover({{0, 0}, {4, 0}, {4, 1}, {1, 1}, {1, 3}, {0, 3}});                          // L
  expectExactCover({{0, 0}, {3, 0}, {3, 3}, {2, 3}, {2, 1}, {1, 1}, {1, 3}, {0, 3}});          // U
  expectExactCover({{0, 0}, {1, 0.2}, {2, 0}, {1.8, 1}, {2, 2}, {1, 1.8}, {0, 2}, {0.2, 1}});  // dents
  expectExactCover({{0, 0},
                    {5, 0},
                    {5, 4},
                    {1, 4},
                    {1, 2},
                    {3, 2},
                    {3, 3},
                    {2, 3},
                    {2, 3.5},
                    {4.5, 3.5},  // spiral
                    {4.5, 0.5},
                    {0.5, 0.5},
                    {0.5, 4},
                    {0, 4}});
}

TEST(EarClip, CoversStarsAndCombs) {
  std::mt19937 random(3);
  for (int n : {5, 6, 7, 20, 101, 400}) {
    std::vector<PlanePoint> star, comb;
    for (int i = 0; i < n; ++i) {
      const double r = 0.1 + double(random() % 1000) / 1000, a = 2 * 3.14159265358979 * i / n;
      star.push_back({r * std::cos(a), r * std::sin(a)});
    }
    expectExactCover(star);
    for (int i = 0; i < n; ++i) comb.push_back({double(i), i % 2 == 0 ? 0.0 : 0.9 * (1 + double(random() % 9))});
    comb.push_back({double(n), 20});
    comb.push_back({-1, 20});
    expectExactCover(comb);
  }
}

// Corners on straight edges must all be used as corners of triangles with area, or neighbours would have
// T-junctions with this polygon.
TEST(EarClip, GivesCollinearCornersTrianglesWithArea) {
  const std::vector<PlanePoint> square{{0, 0}, {1, 0}, {2, 0}, {3, 0}, {3, 1}, {3, 3}, {1.5, 3}, {0, 3}, {0, 2}};
  const auto triangles = earClip(square);
  expectExactCover(square);
  for (size_t i = 0; i < triangles.size(); i += 3)
    EXPECT_GT(area(square[triangles[i]], square[triangles[i + 1]], square[triangles[i + 2]]), 0.01);
}

// A frame: the hole is joined to the outline by an edge that is passed twice.
TEST(EarClip, CoversPolygonsWithBridges) {
  expectExactCover({{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0}, {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}});
}

TEST(EarClip, SurvivesDegeneratePolygons) {
  EXPECT_EQ(earClip(std::vector<PlanePoint>(6)).size(), 12u);
  EXPECT_EQ(earClip(std::vector<PlanePoint>{{0, 0}, {1, 0}, {2, 0}, {3, 0}, {1.5, 0}}).size(), 9u);
  EXPECT_EQ(earClip(std::vector<PlanePoint>{{0, 0}, {1, 1}, {1, 0}, {0, 1}, {0.5, 2}}).size(), 9u);
}

TEST(Polygon, ProjectionKeepsLengthsAndTurnsCounterclockwise) {
  const std::vector<Vec3f> pentagon{{1, 0, 2}, {3, 0, 4}, {3, 1, 4}, {2, 3, 3}, {1, 1, 2}};  // in a tilted plane
  const auto plane = projectToPlane(pentagon);
  EXPECT_GT(signedArea(plane), 0);
  EXPECT_NEAR(signedArea(plane), length(newellNormal(pentagon)) / 2, 1e-12);
  for (size_t i = 0; i < plane.size(); ++i) {
    const size_t j = (i + 1) % plane.size();
    EXPECT_NEAR(std::hypot(plane[j].x - plane[i].x, plane[j].y - plane[i].y),
                length(toDouble(pentagon[j]) - toDouble(pentagon[i])), 1e-12);
  }
}

Mesh oneFace(std::vector<Vec3f> points) {
  std::vector<int32_t> face(points.size());
  std::iota(face.begin(), face.end(), 0);
  return makeMesh(std::move(points), {face}, SubdivisionScheme::None);
}

DicedMesh undiced(const Mesh& mesh) { return diceMesh(mesh, 1, test::kNoCap); }

TEST(Undiced, TrianglesAndQuadsKeepTheirCorners) {
  const DicedMesh triangle = undiced(oneFace({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(triangle.uv, (std::vector<Vec2f>{{0, 0}, {1, 0}, {0, 1}}));
  EXPECT_EQ(triangle.triangles, (std::vector<uint32_t>{0, 1, 2}));
  const DicedMesh quad = undiced(oneFace({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}));
  EXPECT_EQ(quad.uv, (std::vector<Vec2f>{{0, 0}, {1, 0}, {1, 1}, {0, 1}}));
  EXPECT_EQ(quad.triangles, (std::vector<uint32_t>{0, 1, 2, 0, 2, 3}));
  EXPECT_EQ(quad.micropolygons, 1u);
  EXPECT_TRUE(quad.normals.empty());
}

TEST(Undiced, ConcaveQuadsAreCutAtTheDent) {
  for (int start = 0; start < 4; ++start) {
    std::vector<Vec3f> dart{{0, 0, 0}, {2, -1, 0}, {0.5f, 0, 0}, {2, 1, 0}};
    std::swap(dart[1], dart[3]);  // clockwise, too: the outside is then below
    std::rotate(dart.begin(), dart.begin() + start, dart.end());
    const DicedMesh diced = undiced(oneFace(dart));
    ASSERT_EQ(diced.triangleCount(), 2u);
    double smallest = 0;
    EXPECT_NEAR(test::parametricAreas(diced, smallest)[0], 1.0, 1e-6);
    EXPECT_GT(smallest, 0.0);
    const Vec3d a = test::areaVector(diced, 0), b = test::areaVector(diced, 1);
    EXPECT_LT(a.z, 0) << start;
    EXPECT_LT(b.z, 0) << start;
    EXPECT_NEAR(length(a) + length(b), 0.5, 1e-6);
  }
}

TEST(Undiced, LargerPolygonsSpanTheirBounds) {
  const std::vector<Vec3f> points{{10, 0, 0}, {14, 0, 0}, {14, 1, 0}, {11, 1, 0}, {11, 2, 0}, {10, 2, 0}};
  const DicedMesh diced = undiced(oneFace(points));
  EXPECT_EQ(diced.triangleCount(), 4u);
  for (size_t i = 0; i < points.size(); ++i) {  // proportions kept: the shorter side spans half
    EXPECT_FLOAT_EQ(diced.uv[i].x, (points[i].x - 10) / 4);
    EXPECT_FLOAT_EQ(diced.uv[i].y, points[i].y / 4);
  }
  double sum = 0;
  for (size_t t = 0; t < diced.triangleCount(); ++t) sum += test::areaVector(diced, t).z;
  EXPECT_NEAR(sum, 5.0, 1e-6);
}

TEST(Undiced, LeftHandedMeshesTurnTheirTriangles) {
  Mesh mesh = test::prism(6);
  mesh.scheme = SubdivisionScheme::None;
  for (const bool left : {false, true}) {
    mesh.left_handed = left;
    const DicedMesh diced = undiced(mesh);
    for (size_t t = 0; t < diced.triangleCount(); ++t) {
      const Vec3d p = toDouble(diced.positions[diced.triangles[3 * t]]);
      EXPECT_GT(dot(test::areaVector(diced, t), p) * (left ? -1 : 1), 0);
    }
    EXPECT_EQ(test::openEdges(diced), 0u);
  }
}

TEST(Undiced, PrimvarsFollowTheirInterpolation) {
  Mesh mesh = makeMesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}}, SubdivisionScheme::None);
  mesh.texcoords = {{"c", Interpolation::Constant, {{9, 9}}, {}},
                    {"u", Interpolation::Uniform, {{1, 0}, {2, 0}}, {1, 0}},
                    {"v", Interpolation::Vertex, {{0, 0}, {1, 0}, {2, 0}, {3, 0}}, {}},
                    {"f", Interpolation::FaceVarying, {{5, 0}, {6, 0}}, {0, 0, 1, 1, 0, 1}}};
  mesh.display_color = {"displayColor", Interpolation::Uniform, {{1, 0, 0}, {0, 1, 0}}, {}};
  const DicedMesh diced = undiced(mesh);
  const auto firsts = [&](int i) {
    std::vector<float> values;
    for (const Vec2f v : diced.texcoords[i]) values.push_back(v.x);
    return values;
  };
  EXPECT_EQ(firsts(0), (std::vector<float>{9, 9, 9, 9, 9, 9}));
  EXPECT_EQ(firsts(1), (std::vector<float>{2, 2, 2, 1, 1, 1}));
  EXPECT_EQ(firsts(2), (std::vector<float>{0, 1, 2, 0, 2, 3}));
  EXPECT_EQ(firsts(3), (std::vector<float>{5, 5, 6, 6, 5, 6}));
  EXPECT_EQ(diced.display_color[2], (Vec3f{1, 0, 0}));
  EXPECT_EQ(diced.display_color[3], (Vec3f{0, 1, 0}));
}

TEST(Undiced, AuthoredNormalsAreNormalizedAndNotFlipped) {
  Mesh mesh = oneFace({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}});
  mesh.left_handed = true;
  mesh.normals = {"normals", Interpolation::FaceVarying, {{0, 0, 2}, {0, 3, 4}, {0, 0, 0}}, {0, 1, 2, 0}};
  const DicedMesh diced = undiced(mesh);
  EXPECT_EQ(diced.normals[0], (Vec3f{0, 0, 1}));
  EXPECT_NEAR(length(diced.normals[1] - Vec3f{0, 0.6f, 0.8f}), 0, 1e-6);
  EXPECT_EQ(diced.normals[2], (Vec3f{0, 0, -1}));  // no length: the polygon's own, which faces down
}

TEST(Undiced, DegenerateFacesKeepTheirNumberAndLoseTheirTriangles) {
  const Mesh mesh = makeMesh({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {2, 0, 0}},
                             {{0, 1, 2}, {0, 1, 4}, {1, 1, 2}, {0, 2, 3}}, SubdivisionScheme::None);
  const DicedMesh diced = undiced(mesh);
  EXPECT_EQ(diced.primitive_face, (std::vector<uint32_t>{0, 1, 2, 3}));
  EXPECT_EQ(diced.triangle_primitive, (std::vector<uint32_t>{0, 3}));
  EXPECT_EQ(diced.micropolygons, 4u);
}

TEST(Undiced, HolesMeanNothingWithoutSubdivision) {
  Mesh mesh = test::cube();
  mesh.scheme = SubdivisionScheme::None;
  mesh.hole_indices = {0, 3};
  EXPECT_EQ(undiced(mesh).triangleCount(), 12u);
}

TEST(Undiced, TheCapHoldsForPolygonsToo) {
  Mesh mesh = test::cube();
  mesh.scheme = SubdivisionScheme::None;
  EXPECT_NO_THROW(diceMesh(mesh, 1, 6));
  EXPECT_THROW(diceMesh(mesh, 1, 5), Error);
}

}  // namespace
}  // namespace encore
