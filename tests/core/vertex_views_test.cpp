// Directions to film positions and back.
#include "core/render/vertex_views.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "vertex_world.h"

namespace encore {
namespace {

using namespace test;

TEST(VertexViews, EveryDirectionIsAFilmPositionOfOneOfThem) {
  Stream stream(3);
  for (const Affine3d& to_world : {Affine3d{}, test::rotation({0.6, 0.8, 0}, 1.1) * test::scaling({1, 2, -1.5})}) {
    Camera camera;
    camera.to_world = to_world;
    camera.half_tangent = {0.4f, 0.3f}, camera.centre_tangent = {0.1f, -0.2f};
    Settings settings;
    const VertexViews views(camera, settings);
    uint32_t own = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec3f direction = stream.onSphere();
      const ViewPosition p = views.position(direction * stream.next(0.1f, 10));
      const Vec3f back = views.rays(p.view).ray(CameraRays::Sample{p.film_x, p.film_y, 0, 0}).direction;
      EXPECT_LT(length(back - direction), 2e-5f);
      own += p.view == 0;
    }
    EXPECT_GT(own, 300u);
    EXPECT_LT(own, 1500u);
  }
}

TEST(VertexViews, PixelsPerRadianIsTheDensityOfCameraRays) {
  Camera camera;
  camera.half_tangent = {0.8f, 0.6f};
  Settings settings;
  settings.width = 800, settings.height = 600;
  const CameraRays rays(camera, settings);
  const VertexViews views(camera, settings);
  for (const Vec2f film : {Vec2f{400, 300}, Vec2f{10, 590}}) {
    const auto direction = [&](float x, float y) { return rays.ray(CameraRays::Sample{x, y, 0, 0}).direction; };
    const Vec3f d = direction(film.x, film.y), dx = direction(film.x + 1, film.y) - d,
                dy = direction(film.x, film.y + 1) - d;
    EXPECT_NEAR(views.pixelsPerRadian(d) * std::sqrt(length(cross(dx, dy))), 1, 5e-3);
  }
  EXPECT_NEAR(views.pixelsPerRadian({0, 0, 1}), 500, 1e-2);  // behind: as in the middle
  EXPECT_TRUE(std::isfinite(views.pixelsPerRadian({0, 0, 0})));
}

}  // namespace
}  // namespace encore
