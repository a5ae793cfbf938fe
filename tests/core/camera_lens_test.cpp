// Cameras with lenses, of both projections, that move and are cut by planes: against the definition in camera.h.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/path/aperture.h"
#include "core/path/path.h"
#include "shapes.h"

namespace encore {
namespace {

constexpr uint32_t kWidth = 640, kHeight = 400;

Settings film(uint32_t samples = 4) {
  Settings settings;
  settings.width = kWidth, settings.height = kHeight, settings.samples = samples, settings.seed = 5;
  return settings;
}

Affine3d skewed(double angle) {
  return test::translation({1, -2, 3}) * test::rotation({0.6, 0, 0.8}, angle) * test::scaling({2, 1, 0.5}) *
         Affine3d{{1, 0, 0}, {0.2, 1, 0}, {0.1, 0.3, 1}, {0, 0, 0}};
}

Camera cameraOf(bool orthographic, bool lens, bool motion, bool planes) {
  Camera camera;
  camera.to_world = skewed(0.9);
  if (orthographic) camera.projection = Camera::Projection::Orthographic;
  camera.half_tangent = {0.7f, 0.4f}, camera.centre_tangent = {0.05f, -0.1f};
  camera.near_clip = 0.3f, camera.far_clip = 60;
  if (lens) camera.lens_radius = 0.2f, camera.focus_distance = 3, camera.aperture_blades = 7;
  if (motion) camera.motion = {skewed(0.7), skewed(0.9), skewed(1.1)};
  if (planes) camera.clipping_planes = {{{0.1f, 0.2f, -1}, -2}, {{1, 0.5f, 0.3f}, 8}, {{-0.2f, -1, 0.1f}, 9}};
  return camera;
}

struct LocalRay {
  Vec3d origin, direction;  // not of unit length
};

// In camera space, in double precision.
LocalRay expectedLocal(const Camera& camera, double film_x, double film_y, Vec3d lens) {
  const double x = double(camera.centre_tangent.x) + (2 * film_x / kWidth - 1) * double(camera.half_tangent.x);
  const double y = double(camera.centre_tangent.y) + (1 - 2 * film_y / kHeight) * double(camera.half_tangent.y);
  const bool orthographic = camera.projection == Camera::Projection::Orthographic;
  const Vec3d start = orthographic ? Vec3d{x, y, 0} : Vec3d{0, 0, 0},
              towards = orthographic ? Vec3d{0, 0, -1} : Vec3d{x, y, -1};
  const Vec3d focus = start + towards * double(camera.focus_distance), origin = start + lens;
  return {origin, focus - origin};
}

Affine3d placeAt(const Camera& camera, double time) {
  if (camera.motion.empty()) return camera.to_world;
  const double along = time * double(camera.motion.size() - 1);
  const size_t key = std::min(size_t(along), camera.motion.size() - 2);
  const Affine3d &a = camera.motion[key], &b = camera.motion[key + 1];
  const double t = along - double(key);
  const auto mix = [&](Vec3d p, Vec3d q) { return p * (1 - t) + q * t; };
  return {mix(a.ex, b.ex), mix(a.ey, b.ey), mix(a.ez, b.ez), mix(a.origin, b.origin)};
}

// The lens point of a sample, from the numbers that it is made of. Unit square to lens: see the tests of Aperture.
Vec3d lensOf(const Camera& camera, const CameraRays::Sample& s, const std::vector<uint32_t>& ranks) {
  const auto corners = apertureCorners(camera.aperture_blades, camera.aperture_rotation_radians);
  const Vec2f u = CameraRandom(5, s.pixel).lens(ranks[s.sample]);
  const Vec2f p = corners.empty() ? concentricDisk(u) : polygonPoint(corners, u);
  return Vec3d{double(p.x), double(p.y), 0} * double(camera.lens_radius);
}

template <class Test>
void forEveryCamera(const Test& run) {
  for (int kind = 0; kind < 16; ++kind)
    run(cameraOf((kind & 1) != 0, (kind & 2) != 0, (kind & 4) != 0, (kind & 8) != 0));
}

CameraRays::Sample randomSample(test::Stream& stream) {
  return {stream.next(0, kWidth), stream.next(0, kHeight), stream.index(kWidth * kHeight), stream.index(16)};
}

TEST(Cameras, AgreeWithTheDefinition) {
  const std::vector<uint32_t> ranks = strataRanks(4);
  forEveryCamera([&](const Camera& camera) {
    const CameraRays rays(camera, film());
    EXPECT_EQ(rays.moves(), !camera.motion.empty());
    test::Stream stream(3);
    for (int i = 0; i < 300; ++i) {
      const CameraRays::Sample s = randomSample(stream);
      const Ray ray = rays.ray(s);
      const Affine3d m = placeAt(camera, double(ray.time));
      const LocalRay local = expectedLocal(camera, double(s.film_x), double(s.film_y), lensOf(camera, s, ranks));
      const Vec3d direction = m.vector(local.direction);
      EXPECT_LT(length(toDouble(ray.direction) - normalize(direction)), 5e-7);
      EXPECT_LT(length(toDouble(ray.origin) - m.point(local.origin)), 2e-6);
      EXPECT_EQ(ray.time, rays.time(s));
      if (!rays.moves()) {
        EXPECT_EQ(ray.time, 0);
      }
      // In between nothing is cut; beyond the ends something is.
      const auto kept = [&](double t) {
        const Vec3d p = local.origin + local.direction * (t / length(direction));
        // World distance from the camera's plane.
        const Vec3d normal = normalize(cross(m.ex, m.ey));
        const double depth = std::abs(dot(m.vector(p), normal));
        bool inside = p.z < 0 && depth >= double(camera.near_clip) && depth <= double(camera.far_clip);
        for (const ClippingPlane& plane : camera.clipping_planes)
          inside = inside && dot(toDouble(plane.normal), p) + double(plane.offset) >= 0;
        return inside;
      };
      if (ray.tnear <= ray.tfar) {
        const double near = double(ray.tnear), far = double(ray.tfar);
        if (far - near < 1e-3) continue;
        EXPECT_TRUE(kept(near + 1e-4) && kept(0.5 * (near + far)) && kept(far - 1e-4 * far));
        EXPECT_FALSE(kept(near - 1e-4) || kept(far + 1e-4 * far));
      } else {
        for (int k = 0; k < 200; ++k) EXPECT_FALSE(kept(0.4 * k));
      }
    }
  });
}

TEST(Cameras, PacketsHoldTheSameRays) {
  forEveryCamera([](const Camera& camera) {
    for (const bool moves : {false, true}) {
      const CameraRays rays(camera, film(), moves);
      test::Stream stream(8);
      for (int round = 0; round < 20; ++round) {
        PacketLanes<float> x, y, depth;
        PacketLanes<uint32_t> pixel, sample;
        for (uint32_t i = 0; i < kPacketWidth; ++i) {
          const CameraRays::Sample s = randomSample(stream);
          x[i] = s.film_x, y[i] = s.film_y, pixel[i] = s.pixel, sample[i] = s.sample;
        }
        RayPacket packet;
        rays.rays(x, y, pixel, sample, packet);
        HitPacket hits{};
        for (uint32_t i = 0; i < kPacketWidth; ++i) hits.t[i] = stream.next(0, 9), hits.instance[i] = i;
        rays.depths(packet, hits, depth);
        for (uint32_t i = 0; i < kPacketWidth; ++i) {
          const Ray ray = rays.ray(CameraRays::Sample{x[i], y[i], pixel[i], sample[i]});
          EXPECT_EQ(ray.direction, (Vec3f{packet.dx[i], packet.dy[i], packet.dz[i]}));
          EXPECT_EQ(ray.tnear, packet.tnear[i]);
          EXPECT_EQ(ray.tfar, packet.tfar[i]);
          if (rays.ownOrigins()) {
            EXPECT_EQ(ray.origin, (Vec3f{packet.ox[i], packet.oy[i], packet.oz[i]}));
          } else {
            EXPECT_EQ(ray.origin, rays.origin());
          }
          if (rays.moves()) {
            EXPECT_EQ(ray.time, packet.time[i]);
          }
          EXPECT_EQ(depth[i], rays.depth(ray.origin + ray.direction * hits.t[i]));
        }
      }
    }
  });
}

TEST(Cameras, DifferentialsAgreeWithFiniteDifferences) {
  const std::vector<uint32_t> ranks = strataRanks(4);
  forEveryCamera([&](const Camera& camera) {
    const CameraRays rays(camera, film());
    test::Stream stream(5);
    for (int i = 0; i < 100; ++i) {
      const CameraRays::Sample s = randomSample(stream);
      const Affine3d m = placeAt(camera, double(rays.time(s)));
      const Vec3d lens = lensOf(camera, s, ranks);
      Vec3f dpdx, dpdy, dddx, dddy;
      rays.differential(s, dpdx, dpdy, dddx, dddy);
      const double h = 1e-3;
      const auto change = [&](double hx, double hy, bool direction) {
        const LocalRay a = expectedLocal(camera, double(s.film_x) + hx, double(s.film_y) + hy, lens),
                       b = expectedLocal(camera, double(s.film_x) - hx, double(s.film_y) - hy, lens);
        if (direction) return (normalize(m.vector(a.direction)) - normalize(m.vector(b.direction))) / (2 * h);
        return m.vector(a.origin - b.origin) / (2 * h);
      };
      EXPECT_LT(length(toDouble(dpdx) - change(h, 0, false)), 1e-8);
      EXPECT_LT(length(toDouble(dpdy) - change(0, h, false)), 1e-8);
      EXPECT_LT(length(toDouble(dddx) - change(h, 0, true)), 1e-8);
      EXPECT_LT(length(toDouble(dddy) - change(0, h, true)), 1e-8);
    }
  });
}

// A point at distance z is seen blurred over a disk of radius R |z - f| / f at its own distance.
TEST(Lens, BlursPointsIntoTheCircleOfConfusion) {
  Camera camera;
  camera.lens_radius = 0.1f, camera.focus_distance = 4;
  const CameraRays rays(camera, film(32));
  for (const double z : {1.0, 3.9, 4.0, 9.0}) {
    const double expected = 0.1 * std::abs(z - 4) / 4;
    double largest = 0, squares = 0;
    for (uint32_t s = 0; s < 1024; ++s) {
      const Ray ray = rays.ray(CameraRays::Sample{500, 100, 77, s});
      const LocalRay middle = expectedLocal(camera, 500, 100, {0, 0, 0});
      const Vec3d p = toDouble(ray.origin) + toDouble(ray.direction) * (z / -double(ray.direction.z));
      const double off = length(p - middle.direction * (z / 4));
      largest = std::max(largest, off), squares += off * off;
    }
    EXPECT_LE(largest, expected + 1e-6);
    EXPECT_GE(largest, expected * 0.98 - 1e-6);
    EXPECT_NEAR(std::sqrt(squares / 1024), expected / std::sqrt(2.0), 5e-3 * expected + 1e-6);  // of a disk
  }
}

TEST(Orthographic, RaysStandInAGrid) {
  Camera camera;
  camera.projection = Camera::Projection::Orthographic;
  camera.half_tangent = {8, 5}, camera.centre_tangent = {1, 2};
  camera.near_clip = 0.5f;
  const CameraRays rays(camera, film());
  EXPECT_TRUE(rays.ownOrigins());
  for (const auto& [x, y] : {std::pair{0.0f, 0.0f}, {320.0f, 200.0f}, {640.0f, 400.0f}, {10.0f, 390.0f}}) {
    const Ray ray = rays.ray(CameraRays::Sample{x, y, 0, 0});
    EXPECT_LT(length(ray.origin - Vec3f{1 + 8 * (x / 320 - 1), 2 + 5 * (1 - y / 200), 0}), 1e-5f);
    EXPECT_EQ(ray.direction, (Vec3f{0, 0, -1}));
    EXPECT_EQ(ray.tnear, 0.5f);
  }
}

// Counts of points per cell against those expected, as chi-squared; beyond 5 sigma something is wrong.
void expectUniform(const std::vector<double>& counts, double expected) {
  double chi2 = 0;
  for (const double c : counts) chi2 += (c - expected) * (c - expected) / expected;
  const double freedom = double(counts.size() - 1);
  EXPECT_LT(chi2, freedom + 5 * std::sqrt(2 * freedom));
}

TEST(Aperture, DisksAreFilledEvenly) {
  test::Stream stream(1);
  std::vector<double> counts(8 * 16);
  for (int i = 0; i < 128'000; ++i) {
    const Vec2f p = concentricDisk({stream.next(), stream.next()});
    const double r2 = double(p.x) * double(p.x) + double(p.y) * double(p.y);
    ASSERT_LE(r2, 1 + 1e-6);
    const double phi = std::atan2(double(p.y), double(p.x)) / (2 * M_PI) + 0.5;
    ++counts[std::min<size_t>(7, size_t(r2 * 8)) * 16 + std::min<size_t>(15, size_t(phi * 16))];
  }
  expectUniform(counts, 1000);
  EXPECT_EQ(concentricDisk({0.5f, 0.5f}), (Vec2f{0, 0}));
}

TEST(Aperture, BladesMakeRegularPolygons) {
  EXPECT_TRUE(apertureCorners(2, 1).empty());
  for (const uint32_t blades : {3u, 5u, 8u}) {
    const float rotation = 0.3f;
    const auto corners = apertureCorners(blades, rotation);
    EXPECT_EQ(corners.front(), corners.back());
    EXPECT_NEAR(std::atan2(corners[0].y, corners[0].x), rotation, 1e-6);
    test::Stream stream(2);
    const double inner = std::cos(M_PI / blades);
    std::vector<double> counts(blades * 4);
    double farthest = 0;
    for (int i = 0; i < 60'000; ++i) {
      const Vec2f p = polygonPoint(corners, {stream.next(), stream.next()});
      const double r = std::hypot(double(p.x), double(p.y));
      farthest = std::max(farthest, r);
      // Height over the middle of the blade's side, in units of that of the side.
      double turn = std::atan2(double(p.y), double(p.x)) - double(rotation);
      while (turn < 0) turn += 2 * M_PI;
      const size_t blade = std::min<size_t>(blades - 1, size_t(turn / (2 * M_PI) * blades));
      const double height = r * std::cos(turn - (double(blade) + 0.5) * 2 * M_PI / blades) / inner;
      ASSERT_LE(height, 1 + 1e-5);
      ++counts[blade * 4 + std::min<size_t>(3, size_t(height * height * 4))];  // equal areas
    }
    EXPECT_GT(farthest, 0.97);
    expectUniform(counts, 60'000.0 / double(counts.size()));
  }
}

TEST(Aperture, SamplesStratifyOnTheLensInTimeAndWithTheFilm) {
  const uint32_t n = 8;
  const std::vector<uint32_t> ranks = strataRanks(n);
  double correlation = 0;
  for (uint32_t pixel = 0; pixel < 50; ++pixel) {
    const CameraRandom random(9, pixel), neighbour(9, pixel + 1);
    std::vector<int> lens(64), rows(64), times(64);
    // By quadrants of quadrants of the film (4 samples each), and by quadrants of the lens or quarters of time.
    std::vector<int> film_lens(16 * 4), film_time(16 * 4);
    for (uint32_t s = 0; s < n * n; ++s) {
      const Vec2f u = random.lens(ranks[s]);
      const float t = random.time(ranks[s]);
      ++lens[size_t(u.x * 8) * 8 + size_t(u.y * 8)], ++rows[size_t(u.y * 64)], ++times[size_t(t * 64)];
      const size_t square = (s / n / 2) * 4 + s % n / 2;
      ++film_lens[square * 4 + size_t(u.x * 2) * 2 + size_t(u.y * 2)], ++film_time[square * 4 + size_t(t * 4)];
      correlation += double((u.x - 0.5f) * (t - 0.5f)) + double((u.x - 0.5f) * (neighbour.lens(ranks[s]).x - 0.5f)) +
                     double((u.y - 0.5f) * (float(s % n) / float(n) - 0.5f));
    }
    for (const auto* counts : {&lens, &rows, &times, &film_lens, &film_time})
      EXPECT_TRUE(std::all_of(counts->begin(), counts->end(), [](int c) { return c == 1; }));
  }
  EXPECT_NEAR(correlation / (50 * 64) * 12, 0, 0.1);
}

TEST(Aperture, RanksAreAPermutationForAnyNumber) {
  for (const uint32_t n : {1u, 3u, 5u, 16u}) {
    std::vector<uint32_t> ranks = strataRanks(n);
    std::sort(ranks.begin(), ranks.end());
    for (uint32_t i = 0; i < n * n; ++i) EXPECT_EQ(ranks[i], i);
  }
}

TEST(Cameras, SamplesOfBlocksAndPixelsHaveTheirOwnNumbers) {
  Camera camera = cameraOf(false, true, true, false);
  const CameraRays rays(camera, film());
  std::vector<float> times;
  for (const uint32_t pixel : {0u, 1u, 0x80000000u, 0x80000001u})
    for (uint32_t s = 0; s < 16; ++s) times.push_back(rays.time({1, 1, pixel, s}));
  std::sort(times.begin(), times.end());
  EXPECT_EQ(std::adjacent_find(times.begin(), times.end()), times.end());
  // A seed's stratify by its own index.
  std::vector<int> counts(16);
  for (uint32_t s = 0; s < 16; ++s) ++counts[size_t(rays.time({1, 1, 0x80000000u, s}) * 16)];
  EXPECT_TRUE(std::all_of(counts.begin(), counts.end(), [](int c) { return c == 1; }));
}

}  // namespace
}  // namespace encore
