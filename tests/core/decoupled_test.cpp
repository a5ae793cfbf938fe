#include "core/render/decoupled.h"

#include <gtest/gtest.h>

#include <limits>

#include "core/path/path.h"

namespace encore {
namespace {

TEST(DecoupledCell, IsThePixelAtRateOne) {
  EXPECT_EQ(decoupledCell({3.25f, 7.99f}, 1), decoupledCell({3.75f, 7.0f}, 1));
  EXPECT_NE(decoupledCell({3.25f, 7.99f}, 1), decoupledCell({4.25f, 7.99f}, 1));
  EXPECT_NE(decoupledCell({3.25f, 7.99f}, 1), decoupledCell({3.25f, 8.0f}, 1));
}

TEST(DecoupledCell, IsSmallerAtHigherRates) {
  EXPECT_NE(decoupledCell({3.25f, 7}, 4), decoupledCell({3.75f, 7}, 4));
  EXPECT_EQ(decoupledCell({2.25f, 7}, 0.25f), decoupledCell({3.75f, 6.5f}, 0.25f));
}

TEST(DecoupledCell, HoldsFarAndNegativePositions) {
  EXPECT_NE(decoupledCell({-0.5f, 0}, 1), decoupledCell({0.5f, 0}, 1));
  EXPECT_EQ(decoupledCell({1e30f, 0}, 1), decoupledCell({2e30f, 0}, 1));
}

// What CameraRays sends out, Projection brings back.
TEST(Projection, IsTheInverseOfCameraRays) {
  Camera camera;
  camera.to_world = {{0, 0, -1}, {0.6, 0.8, 0}, {0.8, -0.6, 0}, {3, -4, 5}};
  camera.half_tangent = {0.7f, 0.4f};
  camera.centre_tangent = {0.1f, -0.2f};
  Settings settings;
  settings.width = 640;
  settings.height = 360;
  const CameraRays rays(camera, settings);
  const Projection projection(camera, settings);
  for (const Vec2f film : {Vec2f{0, 0}, {320, 180}, {639.5f, 12.25f}, {77, 359}}) {
    const Ray ray = rays.ray(CameraRays::Sample{film.x, film.y, 0, 0});
    const Vec2f back = projection.film(ray.origin + ray.direction * 12.5f);
    EXPECT_NEAR(back.x, film.x, 1e-3f);
    EXPECT_NEAR(back.y, film.y, 1e-3f);
  }
}

TEST(Projection, IsFiniteEverywhere) {
  const Projection projection(Camera{}, Settings{});
  for (const Vec3f p : {Vec3f{0, 0, 0}, {1, 2, 0}, {1, 2, 5}, {1e30f, 0, -1e-30f}}) {
    const Vec2f film = projection.film(p);
    EXPECT_TRUE(std::isfinite(film.x) && std::isfinite(film.y));
  }
}

}  // namespace
}  // namespace encore
