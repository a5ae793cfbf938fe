// Diced subdivision surfaces: no cracks, short edges, the right side out.
#include "core/dice/dice.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <functional>
#include <set>
#include <string>

#include "core/scene/error.h"
#include "tests/core/dice_meshes.h"

namespace encore {
namespace {

using namespace test;

struct Case {
  std::string name;
  Mesh mesh;
  float edge_length;
};

Mesh creased(Mesh mesh, std::vector<int32_t> points, std::vector<int32_t> lengths, std::vector<float> sharpnesses) {
  mesh.crease_indices = std::move(points);
  mesh.crease_lengths = std::move(lengths);
  mesh.crease_sharpnesses = std::move(sharpnesses);
  return mesh;
}

// A mesh stretched so that neighbouring edges get very different rates.
Mesh uneven(Mesh mesh) {
  for (Vec3f& p : mesh.points) {
    if (p.x > 0) p = p + Vec3f{5 * p.x, 0, 0};
    if (p.z > 0) p = p + Vec3f{0, 0.7f * p.y * p.z, 0};
  }
  return mesh;
}

// Infinitely sharp corners, at which the surface's parametrization is infinitely fast.
Mesh spiky(Mesh mesh = cube()) {
  mesh.corner_indices = {0, 7};
  mesh.corner_sharpnesses = {10, 10};
  return mesh;
}

std::vector<Case> closedMeshes() {
  using Scheme = SubdivisionScheme;
  std::vector<Case> cases{{"cube", cube(), 0.1f},
                          {"uneven cube", uneven(cube()), 0.13f},
                          {"tetrahedron", tetrahedron(Scheme::CatmullClark), 0.07f},
                          {"loop tetrahedron", tetrahedron(Scheme::Loop), 0.07f},
                          {"loop octahedron", octahedron(Scheme::Loop), 0.05f},
                          {"uneven loop octahedron", uneven(octahedron(Scheme::Loop)), 0.11f},
                          {"prism", uneven(prism(7)), 0.11f},
                          {"torus", torus(9, 5), 0.2f},
                          {"uneven torus", uneven(torus(12, 6)), 0.3f},
                          {"coarse torus", torus(9, 5), 100.0f},
                          {"coarse prism", prism(5), 100.0f},
                          {"creased cube", creased(cube(), {0, 1, 3, 2, 0, 0, 4}, {5, 2}, {10, 2.5f}), 0.15f},
                          {"spiky cube", spiky(), 0.02f},
                          {"spiky prism", spiky(prism(6)), 0.03f},
                          {"semi-sharp prism", creased(prism(5), {5, 6, 7, 8, 9, 5}, {6}, {0.5f, 1, 3, 7, 10}), 0.1f}};
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    cases.push_back({"random " + std::to_string(seed), randomMesh(seed), seed % 2 ? 0.06f : 0.3f});
    cases.push_back({"random loop " + std::to_string(seed), randomMesh(seed, Scheme::Loop), seed % 2 ? 0.06f : 0.3f});
  }
  Case bilinear{"bilinear", randomMesh(9, Scheme::Bilinear), 0.1f};
  cases.push_back(bilinear);  // undiced, but n-gons are split
  bilinear.name = "diced bilinear";
  bilinear.mesh.target_edge_length_world = 0.1f;
  cases.push_back(bilinear);
  for (const FaceVaryingInterpolation rule : {FaceVaryingInterpolation::None, FaceVaryingInterpolation::All}) {
    Case with_primvars{"with face-varying primvar", randomMesh(11), 0.1f};
    with_primvars.mesh.face_varying = rule;
    Primvar<Vec2f> st{"st", Interpolation::FaceVarying, {}, {}};
    for (const int32_t point : with_primvars.mesh.face_vertex_indices) {
      const Vec3f p = with_primvars.mesh.points[size_t(point)];
      st.values.push_back({p.x, p.y});
    }
    with_primvars.mesh.texcoords = {st};
    cases.push_back(with_primvars);
  }
  return cases;
}

class ClosedMesh : public testing::TestWithParam<size_t> {
 protected:
  static const std::vector<Case>& cases() {
    static const std::vector<Case> all = closedMeshes();
    return all;
  }
  const Case& input() const { return cases()[GetParam()]; }
};

TEST_P(ClosedMesh, HasNoCracksAndNoTJunctions) {
  SCOPED_TRACE(input().name);
  const DicedMesh diced = diceMesh(input().mesh, input().edge_length, kNoCap);
  EXPECT_EQ(openEdges(diced), 0u);
}

TEST_P(ClosedMesh, KeepsGridEdgesWithinTheTarget) {
  SCOPED_TRACE(input().name);
  if (input().name == "bilinear") GTEST_SKIP() << "undiced by design";
  const DicedMesh diced = diceMesh(input().mesh, input().edge_length, kNoCap);
  const bool triangular = input().mesh.scheme == SubdivisionScheme::Loop;
  EXPECT_LE(longestGridEdge(diced, triangular), input().edge_length * 1.00002);
}

TEST_P(ClosedMesh, CoversEveryPrimitiveOnce) {
  SCOPED_TRACE(input().name);
  const DicedMesh diced = diceMesh(input().mesh, input().edge_length, kNoCap);
  double smallest = 0;
  const double whole = input().mesh.scheme == SubdivisionScheme::Loop ? 0.5 : 1.0;
  for (const double area : parametricAreas(diced, smallest)) EXPECT_NEAR(area, whole, 1e-5);
  EXPECT_GT(smallest, 0);
  for (const Vec2f uv : diced.uv) EXPECT_TRUE(uv.x >= 0 && uv.x <= 1 && uv.y >= 0 && uv.y <= 1);
}

// Σ p · area / 3 is the volume inside: positive when triangles face outwards.
TEST_P(ClosedMesh, FacesOutwardsAndNormalsAgree) {
  SCOPED_TRACE(input().name);
  for (const bool left : {false, true}) {
    Mesh mesh = input().mesh;
    mesh.left_handed = left;
    const DicedMesh diced = diceMesh(mesh, input().edge_length, kNoCap);
    double volume = 0;
    size_t disagree = 0;
    for (size_t t = 0; t < diced.triangleCount(); ++t) {
      const Vec3d area = areaVector(diced, t);
      volume += dot(area, toDouble(diced.positions[diced.triangles[3 * t]])) / 3;
      for (int k = 0; k < 3; ++k) disagree += dot(area, toDouble(diced.normals[diced.triangles[3 * t + k]])) <= 0;
    }
    EXPECT_GT(left ? -volume : volume, 0.05);
    // Sharp bends within a facet may turn a few corners of coarse grids away from it.
    EXPECT_LE(disagree, diced.triangles.size() / 50);
    for (const Vec3f n : diced.normals) EXPECT_NEAR(length(n), 1, 1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(All, ClosedMesh, testing::Range(size_t{0}, closedMeshes().size()));

TEST(Dice, NumbersPrimitivesByFaceAndCorner) {
  const DicedMesh diced = diceMesh(prism(5), 0.5f, kNoCap);
  ASSERT_EQ(diced.primitiveCount(), 15u);  // two pentagons of five quads each, and five quads
  std::vector<uint32_t> expected(5, 0);
  expected.insert(expected.end(), 5, 1);
  for (uint32_t face = 2; face < 7; ++face) expected.push_back(face);
  EXPECT_EQ(diced.primitive_face, expected);
  EXPECT_TRUE(std::is_sorted(diced.triangle_primitive.begin(), diced.triangle_primitive.end()));
}

TEST(Dice, CountsCellsOfGrids) {
  const DicedMesh diced = diceMesh(sheet(1, 1, [](float, float) { return 0.0f; }), 0.25f, kNoCap);
  EXPECT_EQ(diced.micropolygons, 16u);  // a target that divides the side exactly is met exactly
  EXPECT_EQ(diced.triangleCount(), 32u);
  EXPECT_EQ(diced.positions.size(), 25u);
}

// A patch whose border is short and whose inside bulges is diced for the bulge.
TEST(Dice, MeasuresInsideToo) {
  Mesh mesh = sheet(3, 0.3f, [](float, float) { return 0.0f; });
  mesh.points[5].z = mesh.points[6].z = mesh.points[9].z = mesh.points[10].z = 4;
  const DicedMesh diced = diceMesh(mesh, 0.5f, kNoCap);
  EXPECT_LE(longestGridEdge(diced, false), 0.5f * 1.00002);
  EXPECT_GT(diced.micropolygons, 20u);
}

// Sharp corners must not make everything around them fine: the count stays near what the area asks for.
TEST(Dice, SpikesStayAffordable) {
  const Mesh mesh = spiky(randomMesh(3));
  for (const float length : {0.04f, 0.01f}) {
    const DicedMesh diced = diceMesh(mesh, length, kNoCap);
    double area = 0;
    for (size_t t = 0; t < diced.triangleCount(); ++t) area += encore::length(areaVector(diced, t));
    EXPECT_LT(double(diced.micropolygons), 8 * area / (length * length));
    EXPECT_LE(longestGridEdge(diced, false), length * 1.00002);
  }
}

TEST(Dice, ScaleDoesNotChangeTheDicing) {
  const Mesh mesh = randomMesh(4);
  const DicedMesh reference = diceMesh(mesh, 0.0731f, kNoCap);
  for (const float scale : {1e-4f, 1e6f, 1e-12f}) {
    Mesh scaled = mesh;
    for (Vec3f& p : scaled.points) p = p * scale;
    const DicedMesh diced = diceMesh(scaled, 0.0731f * scale, kNoCap);
    EXPECT_EQ(diced.triangles, reference.triangles) << scale;
    for (size_t i = 0; i < diced.normals.size(); i += 17)
      EXPECT_NEAR(length(diced.normals[i] - reference.normals[i]), 0, 1e-3);
  }
}

TEST(Dice, FarFromTheOriginRatesStayFinite) {
  Mesh mesh = cube();
  for (Vec3f& p : mesh.points) p = p + Vec3f{1e7f, 0, 0};  // half a unit in the last place is 0.5
  const DicedMesh diced = diceMesh(mesh, 0.05f, kNoCap);
  EXPECT_LT(diced.micropolygons, 20'000u);
  const DicedMesh centred = diceMesh(cube(), 0.05f, kNoCap);
  EXPECT_LE(diced.micropolygons, centred.micropolygons);
}

TEST(Dice, HolesHaveNoPrimitives) {
  Mesh mesh = cube();
  mesh.hole_indices = {2};
  const DicedMesh whole = diceMesh(cube(), 0.2f, kNoCap), holed = diceMesh(mesh, 0.2f, kNoCap);
  EXPECT_EQ(holed.primitive_face, (std::vector<uint32_t>{0, 1, 3, 4, 5}));
  // The rest is where it was: a hole is no boundary of the surface.
  std::set<std::array<float, 3>> known;
  for (const Vec3f p : whole.positions) known.insert({p.x, p.y, p.z});
  for (const Vec3f p : holed.positions) {
    const auto near = known.lower_bound({p.x - 1e-5f, -9, -9});
    EXPECT_TRUE(
        std::any_of(near, known.end(), [&](const auto& q) { return length(Vec3f{q[0], q[1], q[2]} - p) < 1e-5f; }));
  }
  EXPECT_GT(openEdges(holed), 0u);
}

// Three quads at one edge: every pair of neighbours still shares its vertices.
TEST(Dice, NonManifoldMeshesHoldTogether) {
  const Mesh fin = makeMesh({{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {-1, 0, 0}, {-1, 1, 0}, {0, 0, 1}, {0, 1, 1}},
                            {{0, 2, 3, 1}, {4, 0, 1, 5}, {0, 6, 7, 1}});
  const DicedMesh diced = diceMesh(fin, 0.125f, kNoCap);
  std::vector<std::set<std::array<float, 3>>> on_edge(3);
  for (size_t t = 0; t < diced.triangles.size(); ++t) {
    const Vec3f p = diced.positions[diced.triangles[t]];
    if (p.x == 0 && p.z == 0) on_edge[diced.triangle_primitive[t / 3]].insert({p.x, p.y, p.z});
  }
  EXPECT_EQ(on_edge[0].size(), 9u);
  EXPECT_EQ(on_edge[0], on_edge[1]);
  EXPECT_EQ(on_edge[0], on_edge[2]);
}

// A quad whose far edge is one point: derivatives vanish there, normals do not.
TEST(Dice, CollapsedEdgesHaveNormals) {
  const Mesh mesh = makeMesh({{0, 0, 0}, {1, 0, 0}, {0.5f, 1, 0}, {0.5f, 1, 0}}, {{0, 1, 2, 3}});
  const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
  for (const Vec3f n : diced.normals) EXPECT_NEAR(n.z, 1, 1e-5);
  for (size_t t = 0; t < diced.triangleCount(); ++t) EXPECT_GT(areaVector(diced, t).z, 0);
}

TEST(Dice, PointsAtOnePlaceMakeNoTriangles) {
  const DicedMesh diced = diceMesh(makeMesh(std::vector<Vec3f>(4, {1, 2, 3}), {{0, 1, 2, 3}}), 1, kNoCap);
  EXPECT_EQ(diced.primitiveCount(), 1u);
  EXPECT_EQ(diced.triangleCount(), 0u);
  for (const Vec3f n : diced.normals) EXPECT_EQ(length(n), 1);
}

TEST(Dice, TheCapIsAnErrorThatNamesMeshLengthAndCount) {
  for (const float length : {0.01f, 1e-6f, 1e-30f}) {
    try {
      diceMesh(cube(), length, 1000);
      FAIL() << "no error";
    } catch (const Error& error) {
      const std::string text = error.what();
      EXPECT_EQ(error.kind(), ErrorKind::Memory);
      EXPECT_EQ(error.where(), "/World/Mesh.primvars:encore:targetEdgeLength");
      EXPECT_NE(text.find("1000"), std::string::npos);
      EXPECT_NE(text.find("longer primvars:encore:targetEdgeLength"), std::string::npos);
    }
  }
  const uint64_t exact = diceMesh(cube(), 0.1f, kNoCap).micropolygons;
  EXPECT_NO_THROW(diceMesh(cube(), 0.1f, exact));
  EXPECT_THROW(diceMesh(cube(), 0.1f, exact - 1), Error);
}

TEST(Dice, UnusableTopologyIsAnErrorThatNamesTheMesh) {
  Mesh mesh = cube();
  mesh.scheme = SubdivisionScheme::Loop;
  try {
    diceMesh(mesh, 0.1f, kNoCap);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Scene);
    EXPECT_EQ(error.where(), "/World/Mesh");
  }
}

bool sameBits(const DicedMesh& a, const DicedMesh& b) {
  return a.positions == b.positions && a.normals == b.normals && a.uv == b.uv && a.texcoords == b.texcoords &&
         a.display_color == b.display_color && a.triangles == b.triangles &&
         a.triangle_primitive == b.triangle_primitive && a.primitive_face == b.primitive_face &&
         a.micropolygons == b.micropolygons;
}

TEST(Dice, ThreadsDoNotChangeABit) {
  Mesh mesh = torus(60, 30);
  mesh.crease_indices = {0, 1, 2, 3, 4};
  mesh.crease_lengths = {5};
  mesh.crease_sharpnesses = {1.5f};
  const auto with = [&](size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return diceMesh(mesh, 0.05f, kNoCap);
  };
  const DicedMesh one = with(1);
  EXPECT_TRUE(sameBits(one, with(2)));
  EXPECT_TRUE(sameBits(one, with(7)));
}

}  // namespace
}  // namespace encore
