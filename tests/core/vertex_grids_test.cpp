// What vertex shading costs: how many vertices are shaded, and for whom.
#include "core/render/vertex_grids.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "vertex_world.h"

namespace encore {
namespace {

using namespace test;

TEST(VertexGrids, CountsFollowTheRate) {
  for (const float rate : {0.25f, 1.0f, 4.0f}) {
    VertexWorld world;
    world.settings.width = world.settings.height = 64;
    world.settings.shading_rate = rate;
    world.stage.scene.camera.half_tangent = {0.25f, 0.25f};
    world.stage.add(wall(-4, 1), kWhite);  // just the film
    world.stage.scene.lights = {sun({0, 0, -1})};
    world.build();
    const Batch batch = film(world, 9);
    const auto shading = world.shading();
    EXPECT_EQ(totalEvaluations(*shading), 0u);
    shadeLayer(*shading, Layer::Direct, batch);
    const double per_pixel = double(shading->evaluations(Layer::Direct)) / (64 * 64);
    EXPECT_GT(per_pixel, 0.9 * double(rate));
    EXPECT_LT(per_pixel, 1.5 * double(rate));  // grids do not share the vertices between them
    EXPECT_EQ(shading->evaluations(Layer::Reflection), 0u);
    // Every vertex once, whoever asks again.
    const uint64_t before = totalEvaluations(*shading), rays = world.rays_traced;
    shadeLayer(*shading, Layer::Direct, batch);
    EXPECT_EQ(totalEvaluations(*shading), before);
    EXPECT_EQ(world.rays_traced, rays);
    EXPECT_GT(shading->memoryBytes(), before * sizeof(Vec3f));
  }
}

// Perspective neither wastes micropolygons in the distance nor where the floor's lines are slanted on the film.
TEST(VertexGrids, CountsToTheHorizon) {
  VertexWorld world;
  world.settings.width = 128, world.settings.height = 64;
  world.stage.scene.camera.half_tangent = {0.5f, 0.25f};
  DicedMesh floor;
  addQuad(floor, {-100, -1, 100}, {100, -1, 100}, {100, -1, -100}, {-100, -1, -100});
  world.stage.add(floor, kWhite);
  world.stage.scene.lights = {sun({0, -1, 0})};
  for (const float rate : {1.0f, 8.0f}) {
    world.settings.shading_rate = rate;
    world.build();
    const Batch batch = film(world, 16);
    const auto covered =
        std::count_if(batch.first.begin(), batch.first.end(), [](const FirstHit& first) { return first.hit.valid(); });
    const auto shading = world.shading();
    shadeLayer(*shading, Layer::Direct, batch);
    const double per_pixel = double(shading->evaluations(Layer::Direct)) / (double(covered) / 16);
    EXPECT_GT(per_pixel, 0.9 * double(rate));
    EXPECT_LT(per_pixel, 2 * double(rate));
  }
}

// What a convex mirror shows is seen through wide beams: coarser grids, and not the camera's.
TEST(VertexGrids, WideBeamsSeeCoarserGrids) {
  const auto evaluations = [](bool convex) {
    VertexWorld world;
    world.settings.width = world.settings.height = 64;
    DicedMesh behind;
    addQuad(behind, {50, -50, 20}, {-50, -50, 20}, {-50, 50, 20}, {50, 50, 20});
    world.stage.add(behind, kWhite);
    world.stage.add(convex ? test::sphere(16) : wall(1, 1), kMirror, test::translation({0, 0, -5}));
    world.build();
    const Batch batch = film(world, 4);
    const auto shading = world.shading();
    shadeLayer(*shading, Layer::Reflection, batch);
    const uint64_t mirrors = shading->vertices(Layer::Reflection);
    EXPECT_GT(mirrors, 500u);
    return double(shading->evaluations(Layer::Reflection)) / double(mirrors);
  };
  // The flat mirror's beams are 1.5 times as wide as the camera's, which is less than a level.
  EXPECT_LT(evaluations(false), 1.5 * 1.5 * 1.3);
  EXPECT_LT(evaluations(true), 0.5);
}

TEST(VertexGrids, ASmallFaceIsOneMicropolygon) {
  VertexWorld world;
  world.stage.add(wall(-4, 0.06f), kWhite);  // less than two pixels
  DicedMesh triangle;
  addTriangle(triangle, {0.5f, 0.5f, -4}, {0.6f, 0.5f, -4}, {0.5f, 0.6f, -4});
  world.stage.add(triangle, kWhite);
  world.settings.shading_rate = 0.2f;
  world.build();
  const Batch batch = film(world, 16);
  const auto shading = world.shading();
  shadeLayer(*shading, Layer::Direct, batch);
  EXPECT_EQ(shading->evaluations(Layer::Direct), 4u + 3u);
}

// A mirror has nothing to shade; what it shows is shaded once for both layers.
TEST(VertexGrids, SecondaryHitsShareTheCache) {
  VertexWorld world;
  world.stage.add(wall(-4, 0.5f), kMirror);
  DicedMesh behind;  // the camera: seen in the mirror only
  addQuad(behind, {3, -3, 1}, {-3, -3, 1}, {-3, 3, 1}, {3, 3, 1});
  world.stage.add(behind, kWhite);
  world.stage.scene.materials[kWhite].emissive_color = {{0.25f, 0.5f, 0.75f}};
  world.build();
  const Batch batch = film(world, 4);
  const auto shading = world.shading();
  shadeLayer(*shading, Layer::Direct, batch);
  EXPECT_EQ(totalEvaluations(*shading), 0u);
  EXPECT_GT(shading->vertices(Layer::Direct), 0u);
  const std::vector<Vec3f> reflected = shadeLayer(*shading, Layer::Reflection, batch);
  EXPECT_GT(shading->vertices(Layer::Reflection), 0u);
  EXPECT_GT(shading->evaluations(Layer::Reflection), 0u);
  EXPECT_EQ(shading->evaluations(Layer::Direct), 0u);
  size_t lit = 0;
  for (size_t i = 0; i < reflected.size(); ++i) {
    if (!batch.first[i].hit.valid()) continue;
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(reflected[i][c], 0.25f * float(c + 1), 1e-6f);
    ++lit;
  }
  EXPECT_GT(lit, 100u);
}

// Rates of primitives: twice the rate, twice the vertices.
TEST(VertexGrids, FacesHaveTheirOwnRate) {
  const auto evaluations = [](float own) {
    VertexWorld world;
    world.settings.width = world.settings.height = 64;
    world.stage.add(wall(-4, 1), kWhite);
    world.stage.scene.instances[0].shading_rate[0] = own;
    world.build();
    const Batch batch = film(world, 4);
    const auto shading = world.shading();
    shadeLayer(*shading, Layer::Direct, batch);
    return double(totalEvaluations(*shading));
  };
  EXPECT_NEAR(evaluations(4) / evaluations(0), 4, 0.8);
}

}  // namespace
}  // namespace encore
