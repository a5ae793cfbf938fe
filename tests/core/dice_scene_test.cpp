// Edge lengths of a scene's meshes, and dicing all of them.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "core/dice/dice.h"
#include "core/dice/edge_length.h"
#include "core/scene/error.h"
#include "tests/core/dice_meshes.h"

namespace encore {
namespace {

using namespace test;

Affine3d scaling(double x, double y, double z) { return {{x, 0, 0}, {0, y, 0}, {0, 0, z}, {0, 0, 0}}; }

Affine3d rotation(double angle) {
  return {{std::cos(angle), std::sin(angle), 0}, {-std::sin(angle), std::cos(angle), 0}, {0, 0, 1}, {0, 0, 0}};
}

// The scene of one mesh with an instance per transform.
Scene sceneOf(Mesh mesh, const std::vector<Affine3d>& transforms) {
  Scene scene;
  scene.meshes = {std::move(mesh)};
  scene.prototypes = {{"/World/Prototype", {0}}};
  for (const Affine3d& transform : transforms) scene.instances.push_back({"/World/Instance", 0, transform, {}});
  return scene;
}

TEST(LargestScale, IsTheLargestSingularValue) {
  EXPECT_FLOAT_EQ(largestScale(Affine3d{}), 1);
  EXPECT_FLOAT_EQ(largestScale(scaling(2, -7, 0.5)), 7);
  EXPECT_FLOAT_EQ(largestScale(scaling(1e-9, 1e-9, 1e-9)), 1e-9f);
  EXPECT_FLOAT_EQ(largestScale(rotation(0.3) * scaling(3, 1, 1) * rotation(1.1)), 3);
  EXPECT_EQ(largestScale(scaling(0, 0, 0)), 0);
  // The shear x += y: the golden ratio.
  EXPECT_FLOAT_EQ(largestScale({{1, 0, 0}, {1, 1, 0}, {0, 0, 1}, {5, 5, 5}}), (1 + std::sqrt(5.0f)) / 2);
}

TEST(LargestScale, BoundsEveryVectorTightly) {
  std::mt19937 random(8);
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Vec3d{normal(random), normal(random), normal(random)}; };
  for (int i = 0; i < 50; ++i) {
    const Affine3d m{vector(), vector(), vector(), {}};
    const double scale = largestScale(m);
    Vec3d v = vector();
    for (int k = 0; k < 3000; ++k) {  // power iteration with MᵀM
      v = normalize(m.transposedVector(m.vector(v)));
    }
    EXPECT_NEAR(scale, length(m.vector(v)), 1e-5 * scale);
  }
}

TEST(DefaultEdgeLength, FollowsMeshSceneAndThinParts) {
  EXPECT_FLOAT_EQ(defaultEdgeLength(128, 128), 1);
  EXPECT_FLOAT_EQ(defaultEdgeLength(128, 6000), 6000.0f / 4096);  // a small thing in a large scene
  EXPECT_FLOAT_EQ(defaultEdgeLength(128, 1e9f), 2);               // but a huge ground coarsens it only so far
  EXPECT_FLOAT_EQ(defaultEdgeLength(128, 128, 0.4f), 0.1f);       // thin parts
  EXPECT_FLOAT_EQ(defaultEdgeLength(128, 128, 0.001f), 1.0f / 32);
  EXPECT_EQ(defaultEdgeLength(0, 10), 1);
  for (const float scale : {1e-6f, 1e6f})  // no unit is special
    EXPECT_FLOAT_EQ(defaultEdgeLength(3 * scale, 50 * scale, scale), scale * defaultEdgeLength(3, 50, 1));
}

TEST(ResolvedEdgeLengths, PreferTheMeshThenTheFrameThenTheDefault) {
  Scene scene = sceneOf(cube(), {Affine3d{}});
  Settings settings;
  const float diagonal = 2 * std::sqrt(3.0f);
  EXPECT_FLOAT_EQ(resolvedEdgeLengths(scene, settings)[0], diagonal / 128);
  settings.target_edge_length_world = 0.5f;
  EXPECT_FLOAT_EQ(resolvedEdgeLengths(scene, settings)[0], 0.5f);
  settings.edge_length_scale = 0.25f;
  EXPECT_FLOAT_EQ(resolvedEdgeLengths(scene, settings)[0], 0.125f);
  scene.meshes[0].target_edge_length_world = 0.25f;
  EXPECT_FLOAT_EQ(resolvedEdgeLengths(scene, settings)[0], 0.25f);
}

TEST(ResolvedEdgeLengths, DivideByTheLargestScale) {
  Settings settings;
  settings.target_edge_length_world = 1;
  const auto of = [&](const std::vector<Affine3d>& transforms) {
    return resolvedEdgeLengths(sceneOf(cube(), transforms), settings)[0];
  };
  EXPECT_FLOAT_EQ(of({scaling(3, 1, 1)}), 1.0f / 3);
  EXPECT_FLOAT_EQ(of({scaling(3, 3, 3), rotation(1) * scaling(3, 3, 3)}), 1.0f / 3);  // one scale
  EXPECT_FLOAT_EQ(of({scaling(3, 3, 3), scaling(1, 1, 1)}), 1.0f / 4);                // several: next octave
  EXPECT_FLOAT_EQ(of({scaling(4, 4, 4), scaling(1, 1, 1)}), 1.0f / 4);
  EXPECT_FLOAT_EQ(of({scaling(0.3, 0.3, 0.3), scaling(0.1, 0.1, 0.1)}), 2);
  EXPECT_EQ(of({}), 0);
}

TEST(ResolvedEdgeLengths, TurningAMeshDoesNotChangeItsDefault) {
  const float upright = resolvedEdgeLengths(sceneOf(cube(), {Affine3d{}}), {})[0];
  for (const double angle : {0.1, 0.7, 1.3})
    EXPECT_EQ(resolvedEdgeLengths(sceneOf(cube(), {rotation(angle)}), {})[0], upright) << angle;
}

// To the last bit, so that what was diced for one frame is good for the next.
TEST(ResolvedEdgeLengths, MovingAThingALittleDoesNotChangeOthers) {
  const auto of = [](double x) {
    Affine3d moved;
    moved.origin = {x, 0, 0};
    return resolvedEdgeLengths(sceneOf(cube(), {Affine3d{}, moved}), {})[0];
  };
  const float still = of(200);
  EXPECT_GT(still, of(0)) << "the scene's size decides";
  EXPECT_NEAR(still, 200.0f / 4096, 0.1f * still);
  EXPECT_EQ(of(201), still);
  EXPECT_EQ(of(200.000001), still);
}

TEST(DiceScene, KeepsWorldLengthsUnderNonUniformScale) {
  Settings settings;
  settings.target_edge_length_world = 0.3f;
  const Scene scene = sceneOf(cube(), {rotation(0.4) * scaling(5, 1, 2)});
  DicedMesh diced = diceScene(scene, settings)[0];
  for (Vec3f& p : diced.positions) p = toFloat(scene.instances[0].to_world.point(toDouble(p)));
  EXPECT_LE(longestGridEdge(diced, false), 0.3 * 1.00002);
}

TEST(DiceScene, AgreesWithDiceMeshAndSkipsWhatIsNotShown) {
  Scene scene = sceneOf(cube(), {Affine3d{}});
  scene.meshes.push_back(torus(8, 5));
  scene.meshes.push_back(prism(6));
  scene.meshes[2].scheme = SubdivisionScheme::None;
  scene.meshes.push_back(torus(8, 5));
  scene.prototypes[0].meshes = {0, 2, 3};
  Settings settings;
  settings.target_edge_length_world = 0.2f;
  const auto diced = diceScene(scene, settings);
  ASSERT_EQ(diced.size(), 4u);
  EXPECT_EQ(diced[1].positions.size() + diced[1].triangles.size() + diced[1].primitiveCount(), 0u);
  for (const size_t i : {0, 2, 3}) {
    const DicedMesh alone = diceMesh(scene.meshes[i], 0.2f, kNoCap);
    EXPECT_EQ(diced[i].positions, alone.positions);
    EXPECT_EQ(diced[i].triangles, alone.triangles);
  }
  EXPECT_EQ(diced[2].primitiveCount(), 8u);
}

TEST(DiceScene, TheCapHoldsForTheSum) {
  Scene scene = sceneOf(cube(), {Affine3d{}});
  scene.meshes.push_back(torus(8, 5));
  scene.meshes[1].path = "/World/Torus";
  scene.prototypes[0].meshes = {0, 1};
  Settings settings;
  settings.target_edge_length_world = 0.2f;
  const auto diced = diceScene(scene, settings);
  const uint64_t sum = diced[0].micropolygons + diced[1].micropolygons;
  settings.max_micropolygons = sum;
  EXPECT_NO_THROW(diceScene(scene, settings));
  settings.max_micropolygons = sum - 1;  // each mesh alone fits
  std::string first;
  for (int run = 0; run < 5; ++run) {
    try {
      diceScene(scene, settings);
      FAIL() << "no error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::Memory);
      EXPECT_EQ(error.where(), "/World/Torus.primvars:encore:targetEdgeLength");
      EXPECT_NE(std::string(error.what()).find(std::to_string(sum)), std::string::npos);
      if (run == 0) first = error.what();
      EXPECT_EQ(first, error.what());
    }
  }
}

TEST(DiceScene, ReportsTheFirstMeshThatFails) {
  Scene scene = sceneOf(cube(), {Affine3d{}});
  for (int i = 0; i < 20; ++i) {
    scene.meshes.push_back(cube());
    scene.meshes.back().path = "/World/Bad" + std::to_string(i);
    scene.meshes.back().scheme = SubdivisionScheme::Loop;
    scene.prototypes[0].meshes.push_back(uint32_t(i + 1));
  }
  try {
    diceScene(scene, {});
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.where(), "/World/Bad0");
  }
}

}  // namespace
}  // namespace encore
