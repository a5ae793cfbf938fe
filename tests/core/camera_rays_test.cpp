#include <gtest/gtest.h>

#include "core/path/path.h"
#include "shapes.h"

namespace encore {
namespace {

Settings film(uint32_t width, uint32_t height) {
  Settings settings;
  settings.width = width, settings.height = height;
  return settings;
}

CameraRays::Sample at(float x, float y) { return {x, y, 0, 0}; }

// The definition in camera.h, in double precision.
Vec3d expectedDirection(const Camera& camera, const Settings& settings, double x, double y) {
  const double ndc_x = 2 * x / settings.width - 1, ndc_y = 1 - 2 * y / settings.height;
  return normalize(
      camera.to_world.vector(Vec3d{double(camera.centre_tangent.x) + ndc_x * double(camera.half_tangent.x),
                                   double(camera.centre_tangent.y) + ndc_y * double(camera.half_tangent.y), -1}));
}

Camera skewed() {
  Camera camera;
  camera.to_world = test::translation({1, -2, 3}) * test::rotation({0.6, 0, 0.8}, 0.9) * test::scaling({2, 1, 0.5}) *
                    Affine3d{{1, 0, 0}, {0.2, 1, 0}, {0.1, 0.3, 1}, {0, 0, 0}};
  camera.half_tangent = {0.7f, 0.4f};
  camera.centre_tangent = {0.05f, -0.1f};
  return camera;
}

TEST(CameraRays, LookAlongMinusZWithYDown) {
  const Camera camera;
  const CameraRays rays(camera, film(200, 100));
  const Ray middle = rays.ray(at(100, 50));
  EXPECT_EQ(middle.direction, (Vec3f{0, 0, -1}));
  EXPECT_GT(rays.ray(at(200, 50)).direction.x, 0.4f);
  EXPECT_GT(rays.ray(at(100, 0)).direction.y, 0.4f);
  EXPECT_LT(rays.ray(at(100, 100)).direction.y, -0.4f);
  EXPECT_EQ(rays.depth({5, 6, -7}), 7);
}

TEST(CameraRays, AgreeWithTheDefinitionForAnyTransform) {
  for (const Camera& camera : {Camera{}, skewed()}) {
    const Settings settings = film(4096, 1717);
    const CameraRays rays(camera, settings);
    test::Stream stream(3);
    for (int i = 0; i < 1000; ++i) {
      const float x = stream.next(0, 4096), y = stream.next(0, 1717);
      const Ray ray = rays.ray(at(x, y));
      EXPECT_LT(length(toDouble(ray.direction) - expectedDirection(camera, settings, double(x), double(y))), 3e-7);
      EXPECT_EQ(ray.origin, toFloat(camera.to_world.origin));
    }
  }
}

TEST(CameraRays, ClippingPlanesArePlanes) {
  for (Camera camera : {Camera{}, skewed()}) {
    camera.near_clip = 2, camera.far_clip = 50;
    const CameraRays rays(camera, film(64, 48));
    test::Stream stream(4);
    for (int i = 0; i < 200; ++i) {
      const Ray ray = rays.ray(at(stream.next(0, 64), stream.next(0, 48)));
      EXPECT_NEAR(rays.depth(ray.origin + ray.direction * ray.tnear), 2, 1e-5);
      EXPECT_NEAR(rays.depth(ray.origin + ray.direction * ray.tfar), 50, 1e-4);
    }
  }
}

TEST(CameraRays, PacketsHoldTheSameRays) {
  for (Camera camera : {Camera{}, skewed()}) {
    camera.near_clip = 0.5f, camera.far_clip = 80;
    const CameraRays rays(camera, film(4000, 3000));
    EXPECT_EQ(rays.origin(), rays.ray(at(1, 2)).origin);
    test::Stream stream(6);
    for (int round = 0; round < 50; ++round) {
      PacketLanes<float> x, y, depth;
      for (uint32_t i = 0; i < kPacketWidth; ++i) x[i] = stream.next(0, 4000), y[i] = stream.next(0, 3000);
      RayPacket packet;
      rays.rays(x, y, nullptr, nullptr, packet);
      HitPacket hits{};
      for (uint32_t i = 0; i < kPacketWidth; ++i) {
        const Ray ray = rays.ray(at(x[i], y[i]));
        EXPECT_EQ(ray.direction, (Vec3f{packet.dx[i], packet.dy[i], packet.dz[i]}));
        EXPECT_EQ(ray.tnear, packet.tnear[i]);
        EXPECT_EQ(ray.tfar, packet.tfar[i]);
        hits.t[i] = stream.next(0, 9), hits.instance[i] = i % 4 ? i : kNoInstance;
      }
      rays.depths(packet, hits, depth);
      for (uint32_t i = 0; i < kPacketWidth; ++i) {
        const Ray ray = rays.ray(at(x[i], y[i]));
        EXPECT_EQ(depth[i],
                  i % 4 ? rays.depth(ray.origin + ray.direction * hits.t[i]) : std::numeric_limits<float>::infinity());
      }
    }
  }
}

TEST(CameraRays, DifferentialsAgreeWithFiniteDifferences) {
  for (const Camera& camera : {Camera{}, skewed()}) {
    const Settings settings = film(64, 48);
    const CameraRays rays(camera, settings);
    test::Stream stream(5);
    for (int i = 0; i < 200; ++i) {
      const float x = stream.next(0, 64), y = stream.next(0, 48);
      Vec3f dpdx, dpdy, dddx, dddy;
      rays.differential(at(x, y), dpdx, dpdy, dddx, dddy);
      EXPECT_EQ(dpdx, Vec3f{});
      EXPECT_EQ(dpdy, Vec3f{});
      const double h = 1e-3, px = double(x), py = double(y);
      const Vec3d fx =
          (expectedDirection(camera, settings, px + h, py) - expectedDirection(camera, settings, px - h, py)) / (2 * h);
      const Vec3d fy =
          (expectedDirection(camera, settings, px, py + h) - expectedDirection(camera, settings, px, py - h)) / (2 * h);
      EXPECT_LT(length(toDouble(dddx) - fx), 1e-5 * length(fx));
      EXPECT_LT(length(toDouble(dddy) - fy), 1e-5 * length(fy));
    }
  }
}

}  // namespace
}  // namespace encore
