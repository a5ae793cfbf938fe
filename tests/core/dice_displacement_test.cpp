// Displaced meshes, by closed forms: no cracks, short edges, normals of the displaced surface.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "core/dice/displacement.h"
#include "core/scene/error.h"
#include "tests/core/dice_meshes.h"

namespace encore {
namespace {

using namespace test;
using Scheme = SubdivisionScheme;

// What a closed form reads.
struct At {
  Vec2f st, dstdx, dstdy;
  Vec3f position, normal;
  Vec4f four;
};
using Form = std::function<DisplacementInputs(const At&)>;

// Material 0 stays, 1 is displaced by the closed form, 2 by the constant.
class ClosedForm : public DisplacementSource {
 public:
  explicit ClosedForm(Form form, DisplacementInputs constant = {}) : form_(std::move(form)), constant_(constant) {
    layout_.slots = {{PointSlot::Kind::Texcoord, "st"},
                     {PointSlot::Kind::ObjectPosition, ""},
                     {PointSlot::Kind::Normal, ""},
                     {PointSlot::Kind::Primvar, "four", {9, 8, 7, 6}}};
    layout_.size = 16;
  }
  bool varies(int32_t material) const override { return material == 1; }
  const PointLayout& layout(int32_t) const override { return layout_; }
  DisplacementInputs constant(int32_t material) const override {
    return material == 2 ? constant_ : DisplacementInputs{};
  }
  void evaluate(const PatternPoints& points, std::span<DisplacementInputs> values) override {
    ASSERT_EQ(points.size(), values.size());
    ASSERT_EQ(points.data.size(), points.size() * layout_.size);
    for (size_t i = 0; i < values.size(); ++i) {
      EXPECT_EQ(points.point[i].material, 1u);
      const float* f = &points.data[points.point[i].first];
      values[i] = form_({{f[0], f[1]},
                         {f[2], f[3]},
                         {f[4], f[5]},
                         {f[6], f[7], f[8]},
                         {f[9], f[10], f[11]},
                         {f[12], f[13], f[14], f[15]}});
    }
  }

 private:
  Form form_;
  DisplacementInputs constant_;
  PointLayout layout_;
};

ClosedForm constantly(float along) { return ClosedForm(nullptr, {{0, 0, 0}, along}); }
ClosedForm along(std::function<float(const At&)> height) {
  return ClosedForm([height](const At& at) { return DisplacementInputs{{0, 0, 0}, height(at)}; });
}

DicedMesh diceDisplaced(Mesh mesh, float edge_length, DisplacementSource& source, uint64_t cap = kNoCap) {
  std::vector<int32_t> materials = displacingMaterials(mesh, source);
  return DisplacedDicer(mesh, std::move(materials), edge_length, cap, source).dice(cap);
}

Mesh withMaterial(Mesh mesh, int32_t material) {
  mesh.material = material;
  return mesh;
}

// Every face has texture coordinates of its own, which agree with no neighbour's.
Mesh withSeams(Mesh mesh) {
  Primvar<Vec2f> st{"st", Interpolation::FaceVarying, {}, {}};
  for (size_t face = 0; face < mesh.face_vertex_counts.size(); ++face)
    for (int32_t k = 0; k < mesh.face_vertex_counts[face]; ++k) {
      const float angle = 2 * kPi * float(k) / float(mesh.face_vertex_counts[face]) + float(face);
      st.values.push_back({float(face) + 0.5f + 0.5f * std::cos(angle), 0.5f + 0.5f * std::sin(angle)});
    }
  mesh.texcoords = {st};
  return mesh;
}

DicedMesh atKey(const DicedMesh& diced, size_t key) {
  DicedMesh still = diced;
  still.positions = diced.motion_positions.at(key);
  still.normals = diced.motion_normals.at(key);
  return still;
}

std::vector<Mesh> closedMeshes() {
  std::vector<Mesh> meshes{cube(), prism(7), torus(9, 5), octahedron(Scheme::Loop)};
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::Loop, Scheme::Bilinear, Scheme::None})
    meshes.push_back(randomMesh(uint32_t(scheme) + 3, scheme));
  return meshes;
}

TEST(Displacement, HasNoCracksAcrossSeamsOfTextureCoordinates) {
  for (Mesh& mesh : closedMeshes()) {
    ClosedForm source =
        along([](const At& at) { return 0.1f * std::sin(7 * at.st.x) + 0.07f * std::cos(9 * at.st.y); });
    const DicedMesh diced = diceDisplaced(withMaterial(withSeams(mesh), 1), 0.15f, source);
    EXPECT_EQ(openEdges(diced), 0u);
    EXPECT_GT(diced.triangleCount(), 500u);
    for (const Vec3f n : diced.normals) ASSERT_NEAR(length(n), 1, 1e-5);
  }
}

TEST(Displacement, HasNoCracksWhereMaterialsMeetAndFacesThatAreNotDisplacedStay) {
  for (Mesh& mesh : closedMeshes()) {
    Mesh mixed = withSeams(mesh);
    for (size_t face = 0; face < mixed.face_vertex_counts.size(); ++face)
      mixed.face_materials.push_back(face % 4 == 3 ? -1 : int32_t(face % 4));
    ClosedForm source(
        [](const At& at) { return DisplacementInputs{{0, 0, 0.1f}, 0.2f * at.st.x - std::floor(at.st.x)}; },
        {{0.05f, 0, 0}, 0.1f});
    const DicedMesh diced = diceDisplaced(mixed, 0.3f, source);
    EXPECT_EQ(openEdges(diced), 0u);
    if (mesh.scheme != Scheme::None) continue;
    // Flat faces stay in their planes.
    size_t checked = 0;
    for (size_t t = 0; t < diced.triangleCount(); ++t) {
      const uint32_t face = diced.primitive_face[diced.triangle_primitive[t]];
      if (face % 4 == 1 || face % 4 == 2 || mesh.face_vertex_counts[face] != 3) continue;
      size_t first = 0;
      for (size_t f = 0; f < face; ++f) first += size_t(mesh.face_vertex_counts[f]);
      const Vec3d p = toDouble(mesh.points[size_t(mesh.face_vertex_indices[first])]);
      const Vec3d n = normalize(cross(toDouble(mesh.points[size_t(mesh.face_vertex_indices[first + 1])]) - p,
                                      toDouble(mesh.points[size_t(mesh.face_vertex_indices[first + 2])]) - p));
      for (int k = 0; k < 3; ++k, ++checked) {
        ASSERT_NEAR(dot(n, toDouble(diced.positions[diced.triangles[3 * t + k]]) - p), 0, 1e-6);
        ASSERT_GT(dot(n, toDouble(diced.normals[diced.triangles[3 * t + k]])), 0.99999);
      }
    }
    EXPECT_GT(checked, 0u);
  }
}

// A sphere of 24 × 24 faces on each side of a cube: its limit surface is a sphere within 1e-3.
Mesh sphere(int n, Scheme scheme = Scheme::CatmullClark) {
  std::map<std::array<int, 3>, int32_t> known;
  std::vector<Vec3f> points;
  std::vector<std::vector<int32_t>> faces;
  const auto point = [&](std::array<int, 3> at) {
    const auto [found, added] = known.try_emplace(at, int32_t(points.size()));
    const auto angle = [&](int i) { return std::tan((float(at[size_t(i)]) / float(n) - 0.5f) * kPi / 2); };
    if (added) points.push_back(normalize(Vec3f{angle(0), angle(1), angle(2)}));
    return found->second;
  };
  for (int axis = 0; axis < 3; ++axis)
    for (int far = 0; far < 2; ++far)
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
          const auto corner = [&](int a, int b) {
            std::array<int, 3> at{};
            at[size_t(axis)] = far * n;
            at[size_t((axis + 1) % 3)] = i + (far ? a : b);
            at[size_t((axis + 2) % 3)] = j + (far ? b : a);
            return point(at);
          };
          faces.push_back({corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)});
        }
  return makeMesh(points, faces, scheme);
}

TEST(Displacement, ConstantGrowsASphere) {
  const Mesh mesh = withMaterial(sphere(24), 2);
  const DicedMesh base = diceMesh(mesh, 0.1f, kNoCap);
  double least = 1e9, most = 0;
  for (const Vec3f p : base.positions) {
    least = std::min(least, length(toDouble(p)));
    most = std::max(most, length(toDouble(p)));
  }
  EXPECT_LT(most - least, 4e-3);
  for (const float d : {0.5f, -0.3f}) {
    ClosedForm source = constantly(d);
    const DicedMesh diced = diceDisplaced(mesh, 0.1f, source);
    EXPECT_EQ(openEdges(diced), 0u);
    EXPECT_LE(longestGridEdge(diced, false), 0.1 * SubdivisionDicer::kStretchTolerance);
    for (size_t v = 0; v < diced.positions.size(); ++v) {
      const double r = length(toDouble(diced.positions[v]));
      ASSERT_GT(r, least + d - 1e-4);
      ASSERT_LT(r, most + d + 1e-4);
      ASSERT_GT(dot(toDouble(diced.normals[v]), normalize(toDouble(diced.positions[v]))), 0.9999);
    }
  }
}

// Everything lands on the unit sphere, whose normals are known; faces of any kind.
TEST(Displacement, NormalsAreThoseOfTheDisplacedSurface) {
  ClosedForm source([](const At& at) { return DisplacementInputs{normalize(at.position) - at.position, 0}; });
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::Loop}) {
    const DicedMesh diced = diceDisplaced(withMaterial(randomMesh(6, scheme), 1), 0.05f, source);
    EXPECT_EQ(openEdges(diced), 0u);
    size_t off = 0;
    for (size_t v = 0; v < diced.positions.size(); ++v) {
      ASSERT_NEAR(length(diced.positions[v]), 1, 1e-6);
      off += dot(diced.normals[v], diced.positions[v]) < 0.999f;
    }
    EXPECT_LE(off, diced.positions.size() / 100);
  }
}

float wave(float x, float y) { return 0.2f * std::sin(3 * x) * std::cos(2 * y); }
Vec3f waveNormal(float x, float y) {
  return normalize(Vec3f{-0.6f * std::cos(3 * x) * std::cos(2 * y), 0.4f * std::sin(3 * x) * std::sin(2 * y), 1});
}

TEST(Displacement, NormalsOfAPlaneAgreeWithDerivatives) {
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::Bilinear, Scheme::None}) {
    Mesh plane = withMaterial(sheet(4, 2, [](float, float) { return 0.0f; }), 1);
    plane.scheme = scheme;
    ClosedForm source = along([](const At& at) { return wave(at.position.x, at.position.y); });
    double coarse_error = 0;
    for (const float edge_length : {0.1f, 0.025f}) {
      const DicedMesh diced = diceDisplaced(plane, edge_length, source);
      EXPECT_LE(longestGridEdge(diced, false), edge_length * SubdivisionDicer::kStretchTolerance);
      double error = 0;
      for (size_t v = 0; v < diced.positions.size(); ++v) {
        const Vec3f p = diced.positions[v];
        ASSERT_NEAR(p.z, wave(p.x, p.y), 1e-6);
        const bool border = p.x < 1e-4f || p.y < 1e-4f || p.x > 1.9999f || p.y > 1.9999f;
        const double off = length(toDouble(diced.normals[v]) - toDouble(waveNormal(p.x, p.y)));
        if (!border) error = std::max(error, off);
        ASSERT_LT(off, 1.5 * edge_length);  // the border has neighbours on one side only
      }
      if (edge_length > 0.05f) coarse_error = error;
      EXPECT_LT(error, edge_length > 0.05f ? 0.03 : coarse_error / 3);  // second order, but first where rates change
    }
  }
}

TEST(Displacement, EdgesOfAFacetedCubeStayClosedAndSharp) {
  Mesh box = withMaterial(cube(), 2);
  box.scheme = Scheme::None;
  ClosedForm source = constantly(0.5f);
  const DicedMesh diced = diceDisplaced(box, 0.25f, source);
  EXPECT_EQ(openEdges(diced), 0u);
  size_t inside = 0, edges = 0, corners = 0;
  for (size_t v = 0; v < diced.positions.size(); ++v) {
    const Vec3f p = diced.positions[v], n = diced.normals[v];
    const Vec2f uv = diced.uv[v];
    const int at_edges = (uv.x == 0 || uv.x == 1) + (uv.y == 0 || uv.y == 1);
    const float out = 0.5f / std::sqrt(float(at_edges + 1));  // along the mean of the faces' normals
    EXPECT_NEAR(maxComponent(absolute(p)), 1 + out, 1e-6);
    const bool middle = std::abs(uv.x - 0.5f) < 0.3f && std::abs(uv.y - 0.5f) < 0.3f;
    if (middle) {
      EXPECT_NEAR(maxComponent(absolute(n)), 1, 1e-6);
    }
    EXPECT_GT(maxComponent(absolute(n)), 0.85f);  // and not the 0.7 of a rounded edge
    (at_edges == 0 ? inside : at_edges == 1 ? edges : corners)++;
  }
  EXPECT_EQ(corners, 24u);
  EXPECT_GT(inside, edges);
}

TEST(Displacement, AuthoredNormalsStayWhereNothingMoves) {
  Mesh ball = withMaterial(sphere(6, Scheme::None), 1);
  ball.normals = {"normals", Interpolation::Vertex, ball.points, {}};
  ClosedForm nothing = along([](const At&) { return 0.0f; });
  const DicedMesh diced = diceDisplaced(ball, 0.05f, nothing);
  for (size_t v = 0; v < diced.positions.size(); ++v)
    ASSERT_GT(dot(toDouble(diced.normals[v]), normalize(toDouble(diced.positions[v]))), 0.999);
  ClosedForm grown = along([](const At& at) {
    EXPECT_NEAR(length(at.normal), 1, 1e-5);
    return 0.5f;
  });
  const DicedMesh larger = diceDisplaced(ball, 0.05f, grown);
  for (size_t v = 0; v < larger.positions.size(); ++v)
    ASSERT_GT(dot(toDouble(larger.normals[v]), normalize(toDouble(larger.positions[v]))), 0.998);
}

float spikes(const At& at) {
  const Vec3f n = normalize(at.position);
  const float s = std::sin(8 * n.x) * std::sin(8 * n.y) * std::sin(8 * n.z);
  return 0.3f * s * s * s * s;
}

TEST(Displacement, SpikesKeepTheEdgeLength) {
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::Loop, Scheme::None}) {
    Mesh mesh = scheme == Scheme::Loop ? octahedron(scheme) : sphere(4, scheme);
    mesh.material = 1;
    // Without them the facets' normals would pull their edges apart by more than any dicing closes.
    if (scheme == Scheme::None) mesh.normals = {"normals", Interpolation::Vertex, mesh.points, {}};
    ClosedForm source = along(spikes), still = along([](const At&) { return 0.0f; });
    const DicedMesh diced = diceDisplaced(mesh, 0.04f, source);
    EXPECT_EQ(openEdges(diced), 0u);
    EXPECT_LE(longestGridEdge(diced, scheme == Scheme::Loop), 0.04 * SubdivisionDicer::kStretchTolerance);
    // It had to work for that.
    EXPECT_GT(diced.micropolygons, 2 * diceDisplaced(mesh, 0.04f, still).micropolygons);
  }
}

TEST(Displacement, StepsDoNotDiceForEver) {
  Mesh plane = withMaterial(sheet(3, 1, [](float, float) { return 0.0f; }), 1);
  ClosedForm flat = along([](const At&) { return 0.0f; });
  const uint64_t before = diceDisplaced(plane, 0.05f, flat).micropolygons;
  ClosedForm step = along([](const At& at) { return at.position.x + 0.37f * at.position.y > 0.61f ? 5.0f : 0.0f; });
  const DicedMesh diced = diceDisplaced(plane, 0.05f, step);
  EXPECT_LE(diced.micropolygons, before * 80);
  EXPECT_GT(diced.micropolygons, before);
  try {
    diceDisplaced(plane, 0.05f, step, before);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Memory);
    EXPECT_EQ(error.where(), "/World/Mesh.primvars:encore:targetEdgeLength");
  }
}

TEST(Displacement, WhatIsNotFiniteCountsAsZero) {
  constexpr float kBad[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity(), std::numeric_limits<float>::max()};
  Mesh plane = withMaterial(sheet(2, 1, [](float, float) { return 1e38f; }), 1);
  for (const float bad : kBad) {
    ClosedForm source([bad](const At&) { return DisplacementInputs{{0, 0, 3e38f}, bad}; });
    const DicedMesh diced = diceDisplaced(plane, 0.25f, source);
    // One for each value; the finite one is too much for each of the 9 places.
    EXPECT_EQ(diced.lost_displacements, std::isfinite(bad) ? 9 : diced.positions.size()) << bad;
    for (const Vec3f p : diced.positions) ASSERT_EQ(p.z, 1e38f);
    for (const Vec3f n : diced.normals) ASSERT_TRUE(isFinite(n));
  }
}

// What patterns read.
TEST(Displacement, PointsTellOfCoordinatesAndTheirSpacing) {
  Mesh plane = withMaterial(sheet(2, 1, [](float, float) { return 0.0f; }), 1);
  plane.scheme = Scheme::Bilinear;
  Primvar<Vec2f> st{"st", Interpolation::Vertex, {}, {}};
  for (const Vec3f p : plane.points) st.values.push_back({3 * p.x + p.y, 2 * p.y});
  plane.texcoords = {{"other", Interpolation::Constant, {{5, 5}}, {}}, st};
  size_t asked = 0;
  ClosedForm source([&](const At& at) {
    EXPECT_NEAR(at.st.x, 3 * at.position.x + at.position.y, 1e-5);
    EXPECT_NEAR(at.st.y, 2 * at.position.y, 1e-5);
    // The grid's lines are 1/8 apart.
    EXPECT_NEAR(at.dstdx.x, 3.0 / 8, 1e-4);
    EXPECT_NEAR(at.dstdx.y, 0, 1e-4);
    EXPECT_NEAR(at.dstdy.x, 1.0 / 8, 1e-4);
    EXPECT_NEAR(at.dstdy.y, 2.0 / 8, 1e-4);
    EXPECT_EQ(at.normal, (Vec3f{0, 0, 1}));
    EXPECT_EQ(at.four, (Vec4f{9, 8, 7, 6}));
    ++asked;
    return DisplacementInputs{};
  });
  EXPECT_EQ(diceDisplaced(plane, 0.125f, source).positions.size(), asked);
  EXPECT_EQ(asked, 100u);
  plane.primvars = {{"four", Interpolation::Uniform, {{1, 0, 0, 0}, {2, 0, 0, 0}, {3, 0, 0, 0}, {4, 0, 0, 0}}, {}}};
  plane.texcoords.clear();
  ClosedForm again([&](const At& at) {
    const float face = 1 + float(at.position.x > 0.5f) + 2 * float(at.position.y > 0.5f);
    if (at.position.x != 0.5f && at.position.y != 0.5f) {
      EXPECT_EQ(at.four, (Vec4f{face, 0, 0, 0}));
    }
    EXPECT_EQ(at.st, (Vec2f{0, 0}));
    EXPECT_EQ(at.dstdx, (Vec2f{0, 0}));
    return DisplacementInputs{};
  });
  diceDisplaced(plane, 0.125f, again);
}

TEST(Displacement, MovesWithTheMesh) {
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::None}) {
    Mesh mesh = withSeams(withMaterial(randomMesh(8, scheme), 1));
    const auto turned = [](Vec3f p) { return Vec3f{p.y, p.z, p.x}; };
    mesh.motion_points.resize(2);
    for (const Vec3f p : mesh.points) {
      mesh.motion_points[0].push_back(p);
      mesh.motion_points[1].push_back(turned(p));
    }
    ClosedForm source = along([](const At& at) { return 0.2f * std::sin(5 * at.st.x); });
    const DicedMesh diced = diceDisplaced(mesh, 0.2f, source);
    EXPECT_EQ(diced.motion_positions[0], diced.positions);
    EXPECT_EQ(diced.motion_normals[0], diced.normals);
    EXPECT_EQ(openEdges(atKey(diced, 1)), 0u);
    for (size_t v = 0; v < diced.positions.size(); ++v) {
      ASSERT_LT(length(turned(diced.positions[v]) - diced.motion_positions[1][v]), 1e-5f);
      ASSERT_LT(length(turned(diced.normals[v]) - diced.motion_normals[1][v]), 1e-3f);
    }
    // What reads positions reads those of each key.
    ClosedForm raised([](const At& at) { return DisplacementInputs{{0, 0, 0.1f * at.position.z}, 0}; });
    const DicedMesh by_key = diceDisplaced(mesh, 0.2f, raised);
    EXPECT_EQ(openEdges(atKey(by_key, 1)), 0u);
    for (size_t v = 0; v < by_key.positions.size(); ++v)
      ASSERT_NEAR(by_key.motion_positions[1][v].z, by_key.positions[v].x * 1.1f, 1e-5f);
  }
}

TEST(Displacement, ConcavePolygonsDoNotFold) {
  Mesh mesh =
      makeMesh({{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {1, 0.3f, 0}, {0, 2, 0}, {3, 0, 0}, {2.3f, 0.3f, 0}, {3, 3, 0}},
               {{0, 1, 2, 3, 4}, {1, 5, 6, 7}}, Scheme::None);
  mesh.material = 2;
  mesh.display_color = {"displayColor", Interpolation::FaceVarying, {}, {}};
  for (const int32_t point : mesh.face_vertex_indices) mesh.display_color.values.push_back(mesh.points[size_t(point)]);
  ClosedForm source = constantly(0.25f);
  const DicedMesh diced = diceDisplaced(mesh, 0.1f, source);
  double area = 0;
  for (size_t t = 0; t < diced.triangleCount(); ++t) {
    EXPECT_GT(areaVector(diced, t).z, 0);
    area += areaVector(diced, t).z;
    EXPECT_LT(diced.primitive_face[diced.triangle_primitive[t]], 2u);
  }
  EXPECT_NEAR(area, 2.3 + 0.45, 1e-5);
  for (size_t v = 0; v < diced.positions.size(); ++v)
    ASSERT_LT(length(diced.positions[v] - diced.display_color[v] - Vec3f{0, 0, 0.25f}), 1e-5f);
}

TEST(Displacement, OnlyDisplacedPolygonsAreDiced) {
  Mesh box = cube();
  box.scheme = Scheme::None;
  box.face_materials = {-1, 2, 0, 0, 0, 0};
  ClosedForm source = constantly(0.1f);
  const DicedMesh diced = diceDisplaced(box, 0.25f, source);
  EXPECT_EQ(openEdges(diced), 0u);
  std::vector<size_t> triangles(6, 0);
  for (const uint32_t primitive : diced.triangle_primitive) ++triangles[diced.primitive_face[primitive]];
  EXPECT_EQ(triangles[0], 2u);  // opposite
  EXPECT_GE(triangles[1], 128u);
  box.face_materials.clear();
  EXPECT_TRUE(displacingMaterials(box, source).empty());
}

}  // namespace
}  // namespace encore
