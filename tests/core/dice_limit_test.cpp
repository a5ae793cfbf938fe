// Diced vertices lie on the limit surface, and carry its normals and primvars: against closed forms.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/dice/dice.h"
#include "tests/core/dice_meshes.h"
#include "tests/core/twins/dice_twin.h"

namespace encore {
namespace {

using namespace test;

constexpr float kCoarsest = 1e6f;  // an edge length that dices nothing

twin::PolygonMesh polygons(const Mesh& mesh) {
  twin::PolygonMesh out;
  for (const Vec3f p : mesh.points) out.points.push_back(toDouble(p));
  out.faces = facesOf(mesh);
  return out;
}

double distanceToNearest(Vec3d p, const std::vector<Vec3d>& points) {
  double nearest = 1e300;
  for (const Vec3d q : points) nearest = std::min(nearest, length(p - q));
  return nearest;
}

Vec3d boxCentre(const DicedMesh& mesh) {
  Vec3d sum{0, 0, 0};
  for (const Vec3f p : mesh.positions) sum += toDouble(p);
  return sum / double(mesh.positions.size());
}

// Undiced, a mesh has the limits of the points after one subdivision step, at most.
TEST(Limit, CatmullClarkAgreesWithItsDefinition) {
  for (uint32_t seed = 20; seed < 26; ++seed) {
    const Mesh mesh = randomMesh(seed);
    const auto limit = twin::catmullClarkLimit(twin::catmullClarkStep(polygons(mesh)));
    const DicedMesh diced = diceMesh(mesh, kCoarsest, kNoCap);
    for (const Vec3f p : diced.positions) EXPECT_LT(distanceToNearest(toDouble(p), limit), 1e-5);
    for (size_t v = 0; v < mesh.points.size(); ++v) {  // and all base points are there
      const auto at = std::find_if(diced.positions.begin(), diced.positions.end(),
                                   [&](Vec3f p) { return length(toDouble(p) - limit[v]) < 1e-5; });
      EXPECT_NE(at, diced.positions.end());
    }
  }
}

// Two more levels: points in the inside of faces, where irregular surfaces are approximated by patches.
TEST(Limit, CatmullClarkInsideFacesIsClose) {
  const auto level3 = twin::catmullClarkStep(
      twin::catmullClarkStep(twin::catmullClarkStep(polygons(tetrahedron(SubdivisionScheme::CatmullClark)))));
  const auto limit = twin::catmullClarkLimit(level3);
  const DicedMesh diced = diceMesh(tetrahedron(SubdivisionScheme::CatmullClark), 0.12f, kNoCap);
  for (const Vec3d p : limit) {
    // The nearest vertex of the grid is at most half a cell's diagonal away; triangles are nearer.
    double nearest = 1e300;
    for (size_t t = 0; t < diced.triangleCount(); ++t) {
      const Vec3d a = toDouble(diced.positions[diced.triangles[3 * t]]);
      const Vec3d n = normalize(areaVector(diced, t));
      Vec3d middle{0, 0, 0};
      for (int k = 0; k < 3; ++k) middle += toDouble(diced.positions[diced.triangles[3 * t + k]]) / 3;
      if (length(p - middle) < 0.12) nearest = std::min(nearest, std::abs(dot(p - a, n)));
    }
    EXPECT_LT(nearest, 0.004);
  }
}

TEST(Limit, CornerOfTheCube) {
  const DicedMesh diced = diceMesh(cube(), kCoarsest, kNoCap);  // (9 v + 4 Σe + Σf) / 24 = v / 2
  for (const Vec3f p : diced.positions) EXPECT_NEAR(length(absolute(p) - Vec3f{0.5f, 0.5f, 0.5f}), 0, 1e-6);
}

TEST(Limit, LoopAgreesWithItsMask) {
  for (const Mesh& mesh : {tetrahedron(SubdivisionScheme::Loop), octahedron(SubdivisionScheme::Loop),
                           randomMesh(7, SubdivisionScheme::Loop)}) {
    std::vector<std::set<int32_t>> near(mesh.points.size());
    for (const auto& f : facesOf(mesh))
      for (int k = 0; k < 3; ++k) near[f[k]].insert({f[(k + 1) % 3], f[(k + 2) % 3]});
    std::vector<Vec3d> limit;
    for (size_t v = 0; v < mesh.points.size(); ++v) {
      std::vector<Vec3d> neighbours;
      for (const int32_t e : near[v]) neighbours.push_back(toDouble(mesh.points[e]));
      limit.push_back(twin::loopLimit(toDouble(mesh.points[v]), neighbours));
    }
    for (const Vec3f p : diceMesh(mesh, kCoarsest, kNoCap).positions)
      EXPECT_LT(distanceToNearest(toDouble(p), limit), 1e-5);
  }
}

// The middle face of a 5 × 5 sheet is one bicubic B-spline patch.
TEST(Limit, RegularPatchIsABSpline) {
  const auto height = [](float x, float y) { return std::sin(1.3f * x) * 0.7f + 0.2f * x * y; };
  Mesh mesh = sheet(5, 5, height);
  Primvar<Vec2f> st{"st", Interpolation::Vertex, {}, {}};
  Primvar<Vec2f> varying{"map", Interpolation::Varying, {}, {}};
  for (const Vec3f p : mesh.points) st.values.push_back({p.x * p.x, p.y});
  varying.values = st.values;
  mesh.texcoords = {st, varying};
  const DicedMesh diced = diceMesh(mesh, 0.11f, kNoCap);
  const auto control = [&](int i, int j) { return mesh.points[size_t((1 + j) * 6 + 1 + i)]; };
  size_t seen = 0;
  for (size_t i = 0; i < diced.triangles.size(); ++i) {
    if (diced.primitive_face[diced.triangle_primitive[i / 3]] != 12) continue;
    const uint32_t v = diced.triangles[i];
    const double u = diced.uv[v].x, w = diced.uv[v].y;
    const auto bu = twin::bspline(u), bv = twin::bspline(w);
    const Vec3d p = twin::tensor(bu, bv, control);
    const Vec3d n = normalize(
        cross(twin::tensor(twin::bsplineSlope(u), bv, control), twin::tensor(bu, twin::bsplineSlope(w), control)));
    EXPECT_LT(length(p - toDouble(diced.positions[v])), 2e-6);
    EXPECT_LT(length(n - toDouble(diced.normals[v])), 1e-5);
    const Vec3d s = twin::tensor(bu, bv, [&](int a, int b) {
      const Vec2f value = st.values[size_t((1 + b) * 6 + 1 + a)];
      return Vec3f{value.x, value.y, 0};
    });
    EXPECT_NEAR(s.x, diced.texcoords[0][v].x, 1e-5);
    EXPECT_NEAR(s.y, diced.texcoords[0][v].y, 1e-5);
    // Varying is linear between the face's own corners, (2, 2) to (3, 3).
    EXPECT_NEAR(4 + 5 * u, diced.texcoords[1][v].x, 1e-5);
    EXPECT_NEAR(2 + w, diced.texcoords[1][v].y, 1e-5);
    ++seen;
  }
  EXPECT_GT(seen, 300u);
}

TEST(Limit, InfinitelySharpCreasesKeepTheCube) {
  Mesh mesh = cube();
  mesh.crease_indices = {0, 1, 3, 2, 0, 4, 4, 5, 7, 6, 6, 4, 1, 5, 3, 7, 2, 6};
  mesh.crease_lengths = {6, 4, 2, 2, 2, 2};
  mesh.crease_sharpnesses = std::vector<float>(6, 10.0f);
  const DicedMesh diced = diceMesh(mesh, 0.25f, kNoCap);
  EXPECT_EQ(diced.micropolygons, 6u * 64u);
  double area = 0;
  for (size_t t = 0; t < diced.triangleCount(); ++t) area += length(areaVector(diced, t));
  EXPECT_NEAR(area, 24.0, 1e-4);
  for (size_t i = 0; i < diced.positions.size(); ++i) {
    EXPECT_NEAR(maxComponent(absolute(diced.positions[i])), 1, 1e-5);
    EXPECT_NEAR(maxComponent(absolute(diced.normals[i])), 1, 1e-4);  // one-sided at the creases
  }
}

TEST(Limit, SharpnessPerCreaseAndPerEdgeAgree) {
  Mesh per_crease = cube(), per_edge = cube();
  per_crease.crease_indices = per_edge.crease_indices = {0, 1, 3, 2, 0, 4, 5};
  per_crease.crease_lengths = per_edge.crease_lengths = {4, 3};
  per_crease.crease_sharpnesses = {2, 3};
  per_edge.crease_sharpnesses = {2, 2, 2, 3, 3};
  const DicedMesh a = diceMesh(per_crease, 0.2f, kNoCap), b = diceMesh(per_edge, 0.2f, kNoCap);
  EXPECT_EQ(a.positions, b.positions);
  EXPECT_NE(a.positions, diceMesh(cube(), 0.2f, kNoCap).positions);
}

TEST(Limit, CreasesWithoutAnEdgeHaveNoEffect) {
  Mesh mesh = cube();
  mesh.crease_indices = {0, 7, 3, 3};  // a diagonal, and a point with itself
  mesh.crease_lengths = {2, 2};
  mesh.crease_sharpnesses = {10, 10};
  EXPECT_EQ(diceMesh(mesh, 0.2f, kNoCap).positions, diceMesh(cube(), 0.2f, kNoCap).positions);
}

TEST(Limit, InfinitelySharpCornerIsKept) {
  Mesh mesh = cube();
  mesh.corner_indices = {7};
  mesh.corner_sharpnesses = {10};
  const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
  float furthest = 0;
  for (const Vec3f p : diced.positions) furthest = std::max(furthest, p.x + p.y + p.z);
  EXPECT_NEAR(furthest, 3, 1e-5);
}

// 3 × 3 quads over [0, 3]². Boundary curves are uniform cubic B-splines, with or without their corners.
TEST(Limit, BoundaryRules) {
  Mesh mesh = sheet(3, 3, [](float, float) { return 0.0f; });
  const auto bounds = [&](InterpolateBoundary rule) {
    mesh.boundary = rule;
    const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
    float low = 9, corner = 9;
    for (const Vec3f p : diced.positions) low = std::min(low, p.x), corner = std::min(corner, p.x + p.y);
    return std::array<float, 3>{low, corner, float(diced.primitiveCount())};
  };
  const auto corner = bounds(InterpolateBoundary::EdgeAndCorner);
  EXPECT_NEAR(corner[0], 0, 1e-6);
  EXPECT_NEAR(corner[1], 0, 1e-6);
  const auto edge = bounds(InterpolateBoundary::EdgeOnly);
  EXPECT_NEAR(edge[0], 0, 1e-5);
  EXPECT_NEAR(edge[1], 1.0f / 3, 1e-5);  // (P0 + 4 P1 + P2) / 6 at the corner
  const auto none = bounds(InterpolateBoundary::None);
  EXPECT_EQ(none[2], 1);  // only the middle face has all it needs
  EXPECT_NEAR(none[0], 1, 1e-5);
}

TEST(Limit, TriangleSubdivisionRuleIsHeeded) {
  Mesh mesh = octahedron(SubdivisionScheme::CatmullClark);
  const DicedMesh plain = diceMesh(mesh, 0.1f, kNoCap);
  mesh.triangle_subdivision = TriangleSubdivision::Smooth;
  EXPECT_NE(plain.positions, diceMesh(mesh, 0.1f, kNoCap).positions);
}

// A band of four quads around; st.x runs from 0 to 1 around it and has a seam.
Mesh band(FaceVaryingInterpolation rule) {
  Mesh mesh;
  std::vector<Vec3f> points;
  std::vector<std::vector<int32_t>> faces;
  Primvar<Vec2f> st{"st", Interpolation::FaceVarying, {}, {}};
  for (int row = 0; row < 4; ++row)
    for (int i = 0; i < 8; ++i) {
      const float angle = 2 * kPi * float(i) / 8;
      points.push_back({std::cos(angle), std::sin(angle), float(row)});
    }
  for (int row = 0; row < 4; ++row)
    for (int i = 0; i <= 8; ++i) st.values.push_back({float(i) / 8, float(row) / 3});
  for (int row = 0; row < 3; ++row)
    for (int i = 0; i < 8; ++i) {
      const int j = (i + 1) % 8;
      faces.push_back({row * 8 + i, row * 8 + j, row * 8 + 8 + j, row * 8 + 8 + i});
      for (const int value : {row * 9 + i, row * 9 + i + 1, row * 9 + 10 + i, row * 9 + 9 + i})
        st.indices.push_back(value);
    }
  mesh = makeMesh(points, faces);
  mesh.face_varying = rule;
  mesh.texcoords = {st};
  return mesh;
}

TEST(Limit, FaceVaryingSeamsStay) {
  using Rule = FaceVaryingInterpolation;
  for (const Rule rule :
       {Rule::None, Rule::CornersOnly, Rule::CornersPlus1, Rule::CornersPlus2, Rule::Boundaries, Rule::All}) {
    const Mesh mesh = band(rule);
    const DicedMesh diced = diceMesh(mesh, 0.1f, kNoCap);
    for (size_t i = 0; i < diced.triangles.size(); ++i) {
      const uint32_t face = diced.primitive_face[diced.triangle_primitive[i / 3]], v = diced.triangles[i];
      const Vec2f st = diced.texcoords[0][v], uv = diced.uv[v];
      // Both sides of the seam end at the seam's own values, 0 and 1, and never bleed into each other.
      // The smoothest rule rounds the corners of the st outline, which lie on the first and the last row.
      const bool keeps_corners = rule != Rule::None || face / 8 == 1;
      if (keeps_corners && face % 8 == 0 && uv.x == 0) {
        EXPECT_NEAR(st.x, 0, 1e-5);
      }
      if (keeps_corners && face % 8 == 7 && uv.x == 1) {
        EXPECT_NEAR(st.x, 1, 1e-5);
      }
      EXPECT_NEAR(st.x, (float(face % 8) + uv.x) / 8, 0.1);
      if (rule == Rule::All) {  // linear in each face
        EXPECT_NEAR(st.x, (float(face % 8) + uv.x) / 8, 1e-5);
        EXPECT_NEAR(st.y, (float(face / 8) + uv.y) / 3, 1e-5);
      }
    }
  }
}

// Smooth rules round the corners of the st outline, linear ones keep them (where the surface's own corners
// are not sharp already).
TEST(Limit, FaceVaryingRulesDiffer) {
  const auto lowest = [](FaceVaryingInterpolation rule) {
    Mesh mesh = sheet(3, 3, [](float, float) { return 0.0f; });
    mesh.boundary = InterpolateBoundary::EdgeOnly;
    mesh.face_varying = rule;
    Primvar<Vec2f> st{"st", Interpolation::FaceVarying, {}, mesh.face_vertex_indices};
    for (const Vec3f p : mesh.points) st.values.push_back({p.x, p.y});
    mesh.texcoords = {st};
    const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
    float low = 9;
    for (const Vec2f v : diced.texcoords[0]) low = std::min(low, v.x + v.y);
    return low;
  };
  EXPECT_NEAR(lowest(FaceVaryingInterpolation::None), 1.0f / 3, 1e-5);
  EXPECT_NEAR(lowest(FaceVaryingInterpolation::CornersOnly), 0, 1e-6);
  EXPECT_NEAR(lowest(FaceVaryingInterpolation::All), 0, 1e-6);
}

TEST(Limit, OtherInterpolationsOfPrimvars) {
  Mesh mesh = prism(5);
  Primvar<Vec2f> uniform{"id", Interpolation::Uniform, {{0, 0}, {1, 0}, {2, 0}}, {0, 1, 2, 2, 1, 0, 0}};
  mesh.texcoords = {uniform};
  mesh.display_color = {"displayColor", Interpolation::Constant, {{0.1f, 0.2f, 0.3f}}, {}};
  const DicedMesh diced = diceMesh(mesh, 0.3f, kNoCap);
  for (size_t i = 0; i < diced.triangles.size(); ++i) {
    const uint32_t face = diced.primitive_face[diced.triangle_primitive[i / 3]], v = diced.triangles[i];
    EXPECT_EQ(diced.texcoords[0][v].x, float(uniform.indices[face]));
    EXPECT_EQ(diced.display_color[v], (Vec3f{0.1f, 0.2f, 0.3f}));
  }
}

// Colours per point with indices; equal colours everywhere stay equal, and the range is kept.
TEST(Limit, IndexedVertexColours) {
  Mesh mesh = cube();
  mesh.display_color = {"displayColor", Interpolation::Vertex, {{1, 0, 0}, {0, 0, 1}}, {0, 0, 0, 0, 1, 1, 1, 1}};
  const DicedMesh diced = diceMesh(mesh, 0.3f, kNoCap);
  ASSERT_EQ(diced.display_color.size(), diced.positions.size());
  for (size_t i = 0; i < diced.positions.size(); ++i) {
    const Vec3f c = diced.display_color[i];
    EXPECT_NEAR(c.x + c.z, 1, 1e-5);
    EXPECT_NEAR(c.z, (diced.positions[i].z + 1) / 2, 1e-5);  // the same weights as the positions
  }
}

TEST(Limit, NormalsOfAConvexBodyPointAwayFromItsMiddle) {
  for (const Mesh& mesh : {cube(), prism(7), tetrahedron(SubdivisionScheme::Loop)}) {
    const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
    const Vec3d middle = boxCentre(diced);
    for (size_t i = 0; i < diced.positions.size(); ++i)
      EXPECT_GT(dot(toDouble(diced.normals[i]), toDouble(diced.positions[i]) - middle), 0);
  }
}

}  // namespace
}  // namespace encore
