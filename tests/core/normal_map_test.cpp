// Paths on surfaces whose normals come from a map.
#include <gtest/gtest.h>

#include <cmath>

#include "core/shade/bsdf.h"
#include "path_world.h"

namespace encore {
namespace {

using namespace test;

constexpr float kTilt = 0.2f;  // radians, towards +s

// A wall at z = -5 with st along x and y, of a material whose normal map leans everywhere.
void furnish(World& world, Material material) {
  Texture texture;
  texture.path = "normals";
  texture.width = texture.height = 1;
  texture.rgba = {std::sin(kTilt), 0, std::cos(kTilt), 1};
  world.stage.scene.textures.push_back(texture);
  PatternNode node;
  node.texture = 0;
  material.nodes.push_back(node);
  material.normal = {{0, 0, 1}, 0, 0};
  world.stage.scene.materials.push_back(material);
  DicedMesh mesh = wall(-5, 50);
  mesh.texcoords.push_back({{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  world.stage.add(mesh, 3);
  Primvar<Vec2f> st;
  st.name = "st";
  world.stage.scene.meshes[0].texcoords.push_back(st);
  world.build();
}

TEST(NormalMap, TurnsReflections) {
  World world;
  DicedMesh back;
  test::addQuad(back, {900, -900, 5}, {-900, -900, 5}, {-900, 900, 5}, {900, 900, 5});
  world.stage.scene.lights = {dome({1, 1, 1})};
  furnish(world, mirror());
  ASSERT_EQ(world.patterns->normalTexcoord(3), "st");
  world.stage.add(back, kMatte);
  world.build();
  Batch batch = film(world, 2);
  follow(world, Layer::Reflection, batch);
  const Vec3f n{std::sin(kTilt), 0, std::cos(kTilt)};
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const Vec3f d = direction(world, batch.first[i]);
    ASSERT_TRUE(batch.vertices[i].hit.valid());
    EXPECT_LT(length(batch.vertices[i].direction - (d - n * (2 * dot(d, n)))), 2e-3f);  // half floats
  }
}

TEST(NormalMap, WeighsTheDirectLayer) {
  World world;
  world.settings.samples = 2;
  Material plastic;
  plastic.roughness = {0.0f};
  furnish(world, plastic);
  Batch batch = film(world, 2);
  follow(world, Layer::Direct, batch);
  const Vec3f n{std::sin(kTilt), 0, std::cos(kTilt)};
  for (size_t i = 0; i < batch.vertices.size(); ++i) {
    const Vec3f d = direction(world, batch.first[i]);
    EXPECT_NEAR(batch.vertices[i].throughput.x, 1 - fresnelDielectric(-dot(d, n), 1.5f), 1e-3f);
  }
  // And so do antialiasing samples.
  const std::vector<BlockOrigin> blocks{{0, 0}};
  std::vector<FirstHit> first(kBlockArea * 4);
  std::vector<Vec3f> throughput(first.size());
  SampleOutputs direct;
  direct.throughput = throughput;
  EXPECT_EQ(traceAntialiasing(world.context(), world.camera(), blocks, first, {}, direct), first.size());
  for (size_t i = 0; i < first.size(); ++i)
    EXPECT_NEAR(throughput[i].x, 1 - fresnelDielectric(-dot(direction(world, first[i]), n), 1.5f), 1e-3f);
}

}  // namespace
}  // namespace encore
