// Displacement by materials: UsdPreviewSurface constants and textures, and GLSL, through real patterns.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "core/dice/dice.h"
#include "core/pattern/patterns.h"
#include "core/scene/error.h"
#include "core/vulkan/device.h"
#include "tests/core/dice_meshes.h"

namespace encore {
namespace {

using namespace test;
using Scheme = SubdivisionScheme;

class DiceMaterial : public testing::Test {
 protected:
  static void SetUpTestSuite() { device = Device::create({.select = {}, .validation = true}); }
  static void TearDownTestSuite() { device.reset(); }

  static DicedMeshes dice(const Scene& scene, float edge_length) {
    Settings settings;
    settings.target_edge_length_world = edge_length;
    Patterns patterns(*device, scene);
    return diceScene(scene, settings, &patterns);
  }

  static std::shared_ptr<Device> device;
};
std::shared_ptr<Device> DiceMaterial::device;

// A texture of one row: value(i) in texel i.
template <class Value>
Texture row(uint32_t width, const Value& value) {
  Texture texture;
  texture.path = "row.exr";
  texture.width = width;
  texture.height = 1;
  for (uint32_t i = 0; i < width; ++i) texture.rgba.insert(texture.rgba.end(), {value(i), 0, 0, 1});
  return texture;
}

Material displacing(int32_t texture, float scale = 1) {
  Material material;
  material.path = "/looks/displaced";
  PatternNode node;
  node.path = "/looks/displaced/map";
  node.texture = texture;
  node.wrap_s = node.wrap_t = WrapMode::Clamp;
  node.scale = {scale, scale, scale, scale};
  material.nodes = {node};
  material.displacement.node = 0;
  return material;
}

Mesh plane(Scheme scheme) {
  Mesh mesh = sheet(4, 1, [](float, float) { return 0.0f; });
  mesh.scheme = scheme;
  mesh.boundary = InterpolateBoundary::EdgeAndCorner;
  Primvar<Vec2f> st{"st", Interpolation::Vertex, {}, {}};
  for (const Vec3f p : mesh.points) st.values.push_back({p.x, p.y});
  mesh.texcoords = {st};
  return mesh;
}

Scene sceneOf(std::vector<Mesh> meshes, std::vector<Material> materials) {
  Scene scene;
  scene.meshes = std::move(meshes);
  scene.prototypes = {{"/World/Prototype", {}}};
  for (uint32_t i = 0; i < scene.meshes.size(); ++i) scene.prototypes[0].meshes.push_back(i);
  scene.instances.resize(1);
  scene.materials = std::move(materials);
  return scene;
}

TEST_F(DiceMaterial, TexturesDisplaceAlongTheNormal) {
  for (const Scheme scheme : {Scheme::CatmullClark, Scheme::Bilinear, Scheme::None}) {
    Scene scene = sceneOf({plane(scheme)}, {displacing(0, 0.5f)});
    scene.textures = {row(64, [](uint32_t i) { return (float(i) + 0.5f) / 64; })};
    const DicedMesh diced = dice(scene, 0.05f)[0];
    ASSERT_GT(diced.positions.size(), 500u);
    EXPECT_EQ(diced.lost_displacements, 0u);
    for (size_t v = 0; v < diced.positions.size(); ++v) {
      const Vec2f st = diced.texcoords[0][v];
      if (st.x < 0.1f || st.x > 0.9f) continue;  // the ramp ends
      ASSERT_NEAR(diced.positions[v].z, 0.5f * st.x, 1e-3f);
      if (st.y < 0.1f || st.y > 0.9f || st.x < 0.2f || st.x > 0.8f) continue;
      ASSERT_LT(length(diced.normals[v] - normalize(Vec3f{-0.5f, 0, 1})), 0.02f);
    }
    scene.materials[0].displacement.node = -1;
    EXPECT_EQ(dice(scene, 0.05f)[0].positions, diceScene(scene,
                                                         [] {
                                                           Settings settings;
                                                           settings.target_edge_length_world = 0.05f;
                                                           return settings;
                                                         }())[0]
                                                   .positions);
  }
}

// Stripes of a texel's width come out as their mean where vertices lie many texels apart.
TEST_F(DiceMaterial, FinePatternsAreFilteredToTheGrid) {
  Scene scene = sceneOf({plane(Scheme::CatmullClark)}, {displacing(0)});
  scene.textures = {row(1024, [](uint32_t i) { return float(i % 2); })};
  const DicedMesh diced = dice(scene, 0.1f)[0];
  for (const Vec3f p : diced.positions) ASSERT_NEAR(p.z, 0.5f, 0.01f);
  EXPECT_LT(diced.micropolygons, 600u);
}

TEST_F(DiceMaterial, ConstantsAndMaterialsOfFaces) {
  Mesh box = cube();
  box.scheme = Scheme::None;
  box.face_materials = {1, 1, 1, 1, 1, 1};
  Mesh other = cube();
  Scene scene = sceneOf({box, other}, {Material{}, Material{}});
  scene.materials[1].displacement.value = 0.25f;
  const auto diced = dice(scene, 0.5f);
  EXPECT_EQ(openEdges(diced[0]), 0u);
  float most = 0;
  for (const Vec3f p : diced[0].positions) most = std::max(most, maxComponent(absolute(p)));
  EXPECT_FLOAT_EQ(most, 1.25f);
  EXPECT_EQ(diced[1].positions, diceMesh(other, 0.5f, kNoCap).positions);
  // Without patterns nothing moves.
  EXPECT_EQ(diceScene(scene, {})[0].positions, diceMesh(box, 1, kNoCap).positions);
}

TEST_F(DiceMaterial, SeamsAndMotionStayClosed) {
  Mesh mesh = randomMesh(8);
  Primvar<Vec2f> st{"st", Interpolation::FaceVarying, {}, {}};
  for (size_t i = 0; i < mesh.face_vertex_indices.size(); ++i)
    st.values.push_back({float(i * 7 % 11) / 11, float(i * 5 % 13) / 13});
  mesh.texcoords = {st};
  mesh.motion_points = {mesh.points, mesh.points};
  for (Vec3f& p : mesh.motion_points[1]) p = {p.x + p.z, p.y, 2 * p.z};
  Scene scene = sceneOf({mesh}, {displacing(0, 0.2f)});
  scene.textures = {row(32, [](uint32_t i) { return float(i * i % 7) / 7; })};
  DicedMesh diced = dice(scene, 0.1f)[0];
  EXPECT_EQ(openEdges(diced), 0u);
  ASSERT_EQ(diced.motion_positions.size(), 2u);
  EXPECT_EQ(diced.motion_positions[0], diced.positions);
  diced.positions = diced.motion_positions[1];
  EXPECT_EQ(openEdges(diced), 0u);
}

TEST_F(DiceMaterial, GlslReadsPositionsAndNormals) {
  Material material;
  material.path = "/looks/glsl";
  material.displacement_shader =
      GlslShader{"/looks/glsl/displacement",
                 "displace.glsl",
                 "void displacement(DisplacementPoint p, inout vec3 offset, inout float along) {\n"
                 "  offset = 2.0 * normalize(p.position) - p.position;\n"
                 "  along = 0.0;\n"
                 "}\n",
                 {}};
  Mesh mesh = cube();
  mesh.motion_points = {mesh.points, mesh.points};
  for (Vec3f& p : mesh.motion_points[1]) p = p * 3;
  const DicedMesh diced = dice(sceneOf({mesh}, {material}), 0.2f)[0];
  EXPECT_EQ(openEdges(diced), 0u);
  EXPECT_LE(longestGridEdge(diced, false), 0.2f * 1.05f);
  for (size_t v = 0; v < diced.positions.size(); ++v) {
    ASSERT_NEAR(length(diced.positions[v]), 2, 1e-5f);
    ASSERT_NEAR(length(diced.motion_positions[1][v]), 2, 1e-5f);
    ASSERT_GT(dot(diced.normals[v], diced.positions[v]), 2 * 0.999f);
  }
}

TEST_F(DiceMaterial, TheCapHoldsForTheSumWithDisplacedMeshes) {
  Scene scene = sceneOf({cube(), torus(8, 5)}, {Material{}});
  scene.meshes[1].path = "/World/Torus";
  scene.materials[0].displacement.value = 0.1f;
  Settings settings;
  settings.target_edge_length_world = 0.2f;
  Patterns patterns(*device, scene);
  const auto diced = diceScene(scene, settings, &patterns);
  settings.max_micropolygons = diced[0].micropolygons + diced[1].micropolygons;
  EXPECT_NO_THROW(diceScene(scene, settings, &patterns));
  --settings.max_micropolygons;
  try {
    diceScene(scene, settings, &patterns);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Memory);
    EXPECT_EQ(error.where(), "/World/Torus.primvars:encore:targetEdgeLength");
  }
}

}  // namespace
}  // namespace encore
