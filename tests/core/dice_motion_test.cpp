// Meshes that deform while the shutter is open, and primvars on diced meshes.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "core/dice/dice.h"
#include "core/dice/edge_length.h"
#include "tests/core/dice_meshes.h"

namespace encore {
namespace {

using namespace test;
using Scheme = SubdivisionScheme;

// The diced mesh as it is at a key.
DicedMesh atKey(const DicedMesh& diced, size_t key) {
  DicedMesh still = diced;
  still.positions = diced.motion_positions.at(key);
  still.normals = diced.motion_normals.empty() ? std::vector<Vec3f>{} : diced.motion_normals.at(key);
  return still;
}

template <class Move>
Mesh moving(Mesh mesh, size_t keys, const Move& move) {
  for (size_t key = 0; key < keys; ++key) {
    mesh.motion_points.emplace_back();
    for (const Vec3f p : mesh.points) mesh.motion_points.back().push_back(move(p, key));
  }
  return mesh;
}

Vec3f twisted(Vec3f p, size_t key) {
  const float angle = 0.7f * float(key) * p.z, stretch = 1 + 0.6f * float(key);
  return {p.x * std::cos(angle) - p.y * std::sin(angle), p.x * std::sin(angle) + p.y * std::cos(angle), p.z * stretch};
}

Mesh still(const Mesh& mesh, size_t key) {
  Mesh frozen = mesh;
  frozen.points = mesh.motion_points[key];
  frozen.motion_points.clear();
  return frozen;
}

std::vector<Mesh> kinds() {
  Mesh bilinear = randomMesh(9, Scheme::Bilinear);
  bilinear.target_edge_length_world = 0.1f;
  return {cube(),
          prism(7),
          torus(9, 5),
          randomMesh(2),
          randomMesh(5),
          octahedron(Scheme::Loop),
          randomMesh(4, Scheme::Loop),
          bilinear};
}

TEST(DeformingMesh, HasNoCracksAndKeepsEdgesShortAtEveryKey) {
  for (const Mesh& mesh : kinds()) {
    const DicedMesh diced = diceMesh(moving(mesh, 3, twisted), 0.15f, kNoCap);
    ASSERT_EQ(diced.motion_positions.size(), 3u);
    ASSERT_EQ(diced.motion_normals.size(), 3u);
    const bool triangular = mesh.scheme == Scheme::Loop;
    EXPECT_EQ(openEdges(diced), 0u);
    EXPECT_LE(longestGridEdge(diced, triangular), 0.15 * 1.00002);
    for (size_t key = 0; key < 3; ++key) {
      const DicedMesh frozen = atKey(diced, key);
      EXPECT_EQ(openEdges(frozen), 0u);
      EXPECT_LE(longestGridEdge(frozen, triangular), 0.15 * 1.00002);
      for (const Vec3f n : frozen.normals) ASSERT_NEAR(length(n), 1, 1e-5);
    }
    // Stretching has a price: the still mesh is coarser.
    EXPECT_LT(diceMesh(mesh, 0.15f, kNoCap).micropolygons, diced.micropolygons);
  }
}

// Halving is exact, so that the largest pose alone says how it is diced, and every pose has the same bits.
TEST(DeformingMesh, AgreesWithStillMeshesOfTheSamePose) {
  for (const Mesh& mesh : kinds()) {
    const Mesh shrinking = moving(mesh, 3, [](Vec3f p, size_t key) {
      return p * (key == 0 ? 1 : key == 1 ? 0.5f : 0.25f);
    });
    const DicedMesh diced = diceMesh(shrinking, 0.12f, kNoCap);
    for (size_t key = 0; key < 3; ++key) {
      const DicedMesh frozen = diceMesh(still(shrinking, key),
                                        0.12f * (key == 0   ? 1
                                                 : key == 1 ? 0.5f
                                                            : 0.25f),
                                        kNoCap);
      EXPECT_EQ(diced.motion_positions[key], frozen.positions);
      EXPECT_EQ(diced.motion_normals[key], frozen.normals);
      EXPECT_EQ(diced.triangles, frozen.triangles);
    }
  }
}

// The least rates do not depend on the pose, so that any deformation can be compared.
TEST(DeformingMesh, AgreesWithStillMeshesOfAnyPoseWhereRatesDo) {
  for (const Mesh& mesh : {prism(6), randomMesh(3), tetrahedron(Scheme::Loop)}) {
    const Mesh bending = moving(mesh, 4, twisted);
    const DicedMesh diced = diceMesh(bending, 1000, kNoCap);
    EXPECT_EQ(diced.positions, diceMesh(mesh, 1000, kNoCap).positions);
    for (size_t key = 0; key < 4; ++key) {
      const DicedMesh frozen = diceMesh(still(bending, key), 1000, kNoCap);
      EXPECT_EQ(diced.motion_positions[key], frozen.positions);
      EXPECT_EQ(diced.motion_normals[key], frozen.normals);
    }
  }
}

TEST(DeformingMesh, PolygonsAreCutAsTheFrameSays) {
  // A quad that is concave at the frame's time at another corner than at its keys.
  Mesh mesh = makeMesh({{0, 0, 0}, {2, 0, 0}, {0.4f, 0.4f, 0}, {0, 2, 0}}, {{0, 1, 2, 3}}, Scheme::None);
  mesh.normals = {"normals", Interpolation::Vertex, {{0, 0, 2}, {0, 0, 1}, {0, 0, 0}, {0, 1, 0}}, {}};
  mesh.motion_points = {{{0, 0, 0}, {0.4f, 0.4f, 0}, {2, 2, 0}, {0, 2, 0}}, mesh.points};
  mesh.motion_normals = {{{3, 0, 0}, {0, 0, 1}, {0, 0, 0}, {0, 1, 0}}, mesh.normals.values};
  const DicedMesh diced = diceMesh(mesh, 1, kNoCap);
  Mesh frame = mesh;
  frame.motion_points.clear();
  const DicedMesh frozen = diceMesh(frame, 1, kNoCap);
  EXPECT_EQ(diced.triangles, frozen.triangles);
  EXPECT_EQ(diced.positions, frozen.positions);
  ASSERT_EQ(diced.motion_positions.size(), 2u);
  EXPECT_EQ(diced.motion_positions[0], mesh.motion_points[0]);
  EXPECT_EQ(diced.motion_positions[1], mesh.points);
  ASSERT_EQ(diced.motion_normals.size(), 2u);
  EXPECT_EQ(diced.motion_normals[0][0], (Vec3f{1, 0, 0}));
  EXPECT_EQ(diced.motion_normals[0][2], (Vec3f{0, 0, 1}));  // the polygon's
  EXPECT_EQ(diced.motion_normals[1], diced.normals);
  EXPECT_TRUE(frozen.motion_positions.empty());
  mesh.motion_normals.clear();  // they stay
  EXPECT_EQ(diceMesh(mesh, 1, kNoCap).motion_normals[0], diced.normals);
}

TEST(DeformingMesh, TrianglesThatHaveAreaAtSomeKeyStay) {
  Mesh mesh = makeMesh({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 1, 2}, {3, 4, 5}},
                       Scheme::None);
  mesh.motion_points = {mesh.points, mesh.points};
  mesh.motion_points[1][2] = {0, 1, 0};
  const DicedMesh diced = diceMesh(mesh, 1, kNoCap);
  EXPECT_EQ(diced.triangleCount(), 1u);
  EXPECT_EQ(diced.triangle_primitive[0], 0u);
  EXPECT_EQ(diced.primitiveCount(), 2u);
}

TEST(DeformingMesh, TheScaleOfMovingInstancesCounts) {
  Scene scene;
  scene.meshes = {cube()};
  scene.prototypes = {{"/World/Prototype", {0}}};
  Instance instance;
  const auto scaling = [](double s) { return Affine3d{{s, 0, 0}, {0, s, 0}, {0, 0, s}, {0, 0, 0}}; };
  instance.motion = {scaling(1), scaling(3)};
  scene.instances = {instance};
  Settings settings;
  settings.target_edge_length_world = 1;
  EXPECT_FLOAT_EQ(resolvedEdgeLengths(scene, settings)[0], 1.0f / 4);  // the octave that holds 3
  scene.instances[0].motion = {scaling(1), scaling(1)};
  EXPECT_FLOAT_EQ(resolvedEdgeLengths(scene, settings)[0], 1);
}

// What is s and t of texture coordinates and the rest of colours is all four channels of a primvar.
TEST(Primvars, AreDicedLikeTexcoordsAndColours) {
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::Loop, Scheme::Bilinear, Scheme::None})
    for (const Interpolation kind : {Interpolation::Constant, Interpolation::Uniform, Interpolation::Vertex,
                                     Interpolation::Varying, Interpolation::FaceVarying}) {
      SCOPED_TRACE(std::to_string(int(scheme)) + " " + std::to_string(int(kind)));
      Mesh mesh = randomMesh(7, scheme);
      const size_t count = kind == Interpolation::Constant      ? 1
                           : kind == Interpolation::Uniform     ? mesh.face_vertex_counts.size()
                           : kind == Interpolation::FaceVarying ? mesh.face_vertex_indices.size()
                                                                : mesh.points.size();
      Primvar<Vec2f> st{"st", kind, {}, {}};
      Primvar<Vec3f> color{"displayColor", kind, {}, {}};
      Primvar<Vec4f> four{"four", kind, {}, {}};
      for (size_t i = 0; i < count; ++i) {
        const Vec4f v{float(i), std::sin(float(i)), float(i % 5), 1 / (1 + float(i))};
        st.values.push_back({v.x, v.y});
        color.values.push_back({v.z, v.w, v.x});
        four.values.push_back(v);
      }
      Primvar<Vec4f> reversed = four;  // by indices
      std::reverse(reversed.values.begin(), reversed.values.end());
      for (size_t i = 0; i < count; ++i) reversed.indices.push_back(int32_t(count - 1 - i));
      mesh.texcoords = {st};
      mesh.display_color = color;
      mesh.primvars = {four, {"none", kind, {}, {}}, reversed};
      if (kind == Interpolation::FaceVarying) mesh.primvars.pop_back();  // indices are topology there
      const DicedMesh diced = diceMesh(mesh, 0.4f, kNoCap);
      ASSERT_EQ(diced.primvars.size(), mesh.primvars.size());
      for (size_t v = 0; v < diced.positions.size(); ++v) {
        const Vec2f s = diced.texcoords[0][v];
        const Vec3f c = diced.display_color[v];
        ASSERT_EQ(diced.primvars[0][v], (Vec4f{s.x, s.y, c.x, c.y}));
        ASSERT_EQ(diced.primvars[1][v], Vec4f{});
        if (diced.primvars.size() == 3) {
          ASSERT_EQ(diced.primvars[2][v], diced.primvars[0][v]);
        }
      }
    }
}

}  // namespace
}  // namespace encore
