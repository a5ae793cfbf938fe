// How fast antialiasing samples are made, traced and resolved, beside Embree alone: a measurement, not a test.
// Arguments: threads (0: all), samples per pixel's side, repetitions, a part of the scenes' names. Prints the best of
// the repetitions.
#include <tbb/task_arena.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>

#include "path_world.h"

namespace encore {
namespace {

using namespace test;

// Processor time of all threads, so that what else the machine does counts as little as possible.
double now() { return double(std::clock()) / CLOCKS_PER_SEC / double(tbb::this_task_arena::max_concurrency()); }

// A wavy sheet of n × n patches, each of m × m quads that are one primitive, with or without normals.
DicedMesh sheet(uint32_t n, uint32_t m, bool smooth) {
  DicedMesh mesh;
  const auto point = [](float s, float t) {
    return Vec3f{3.2f * (s - 0.5f), 1.8f * (t - 0.5f), -3 + 0.15f * std::sin(9 * s) * std::cos(7 * t)};
  };
  for (uint32_t j = 0; j < n; ++j)
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t first = uint32_t(mesh.positions.size()), primitive = j * n + i;
      for (uint32_t b = 0; b <= m; ++b)
        for (uint32_t a = 0; a <= m; ++a) {
          const float u = float(a) / float(m), v = float(b) / float(m);
          const float s = (float(i) + u) / float(n), t = (float(j) + v) / float(n), h = 1e-3f;
          mesh.positions.push_back(point(s, t));
          mesh.uv.push_back({u, v});
          if (smooth)
            mesh.normals.push_back(
                normalize(cross(point(s + h, t) - point(s - h, t), point(s, t + h) - point(s, t - h))));
        }
      for (uint32_t b = 0; b < m; ++b)
        for (uint32_t a = 0; a < m; ++a) {
          const uint32_t c = first + b * (m + 1) + a;
          mesh.triangles.insert(mesh.triangles.end(), {c, c + 1, c + m + 2, c, c + m + 2, c + m + 1});
          mesh.triangle_primitive.insert(mesh.triangle_primitive.end(), {primitive, primitive});
        }
      mesh.primitive_face.push_back(primitive);
    }
  return mesh;
}

// Memory of one batch.
struct Values {
  std::vector<SurfaceKey> key;
  std::vector<Vec2f> uv;
  std::vector<Vec3f> throughput, normal;
  std::vector<float> footprint, coverage, depth;
  std::vector<uint32_t> position;
  std::vector<FirstHit> first;

  explicit Values(size_t slots)
      : key(slots),
        uv(slots),
        throughput(slots),
        normal(slots),
        footprint(slots),
        coverage(slots),
        depth(slots),
        position(slots),
        first(slots) {}
  SharedOutputs shared(size_t slots, size_t pixels) {
    return {std::span(position).first(slots), std::span(coverage).first(slots), std::span(normal).first(slots),
            std::span(depth).first(pixels)};
  }
  SampleOutputs direct(size_t slots, bool footprints) {
    return {std::span(key).first(slots),
            std::span(uv).first(slots),
            std::span(throughput).first(slots),
            std::span(footprint).first(footprints ? slots : 0),
            {}};
  }
};

constexpr uint32_t kWidth = 320, kHeight = 180;

struct Run {
  bool first = false, footprints = false, outputs = true;
};

double wholeImage(World& world, Values& values, size_t blocks_per_batch, Run run) {
  const Settings& settings = world.settings;
  const size_t per_pixel = size_t{settings.samples} * settings.samples;
  std::vector<BlockOrigin> blocks;
  for (uint32_t y = 0; y < settings.height; y += kBlockPixels)
    for (uint32_t x = 0; x < settings.width; x += kBlockPixels) blocks.push_back({int32_t(x), int32_t(y)});
  const CameraRays camera = world.camera();
  double seconds = 0;
  for (size_t b = 0; b < blocks.size(); b += blocks_per_batch) {
    const auto batch = std::span(blocks).subspan(b, std::min(blocks_per_batch, blocks.size() - b));
    const size_t pixels = batch.size() * kBlockArea, slots = pixels * per_pixel;
    const double start = now();
    traceAntialiasing(world.context(), camera, batch, std::span(values.first).first(run.first ? slots : 0),
                      run.outputs ? values.shared(slots, pixels) : SharedOutputs{},
                      run.outputs ? values.direct(slots, run.footprints) : SampleOutputs{});
    seconds += now() - start;
  }
  return seconds;
}

void measure(const char* name, DicedMesh mesh, int32_t material, uint32_t samples, int repetitions) {
  World world;
  world.settings.width = kWidth, world.settings.height = kHeight, world.settings.samples = samples;
  world.stage.scene.camera.half_tangent = {0.5f, 0.5f * kHeight / kWidth};
  world.stage.scene.materials.push_back(Material{});
  world.stage.scene.materials[3].roughness = {0.0f};
  world.stage.add(std::move(mesh), material);
  world.build();
  const size_t per_block = size_t{kBlockArea} * samples * samples, blocks = std::max<size_t>(1, (1u << 20) / per_block);
  Values values(blocks * per_block);
  const double rays = double(kWidth) * kHeight * samples * samples;
  const auto rate = [&](auto&& once) {
    double best = 1e30;
    for (int i = 0; i < repetitions; ++i) best = std::min(best, once());
    return rays / best / 1e6;
  };
  double raw = 0;
  for (int i = 0; i < repetitions; ++i) {
    const RawTrace r = timeRawPrimaryRays(*world.trace, world.camera(), world.settings);
    raw = std::max(raw, double(r.rays) / r.seconds / 1e6);
  }
  const auto all = [&](Run run) { return rate([&] { return wholeImage(world, values, blocks, run); }); };
  const double traced = all({false, false, false}), lean = all({}), first = all({true}),
               footprints = all({false, true});
  std::printf(
      "%-28s raw %6.1f M/s | hits only %5.2fx  samples %5.2fx  with first hits %5.2fx  with footprints %5.2fx\n", name,
      raw, raw / traced, raw / lean, raw / first, raw / footprints);
}

}  // namespace
}  // namespace encore

int main(int argc, char** argv) {
  using namespace encore;
  const int threads = argc > 1 ? std::atoi(argv[1]) : 0, repetitions = argc > 3 ? std::atoi(argv[3]) : 3;
  const uint32_t samples = argc > 2 ? uint32_t(std::atoi(argv[2])) : 11;
  const std::string only = argc > 4 ? argv[4] : "";
  const auto measure = [&](const char* name, DicedMesh mesh, int32_t material) {
    if (std::string(name).find(only) != std::string::npos)
      encore::measure(name, std::move(mesh), material, samples, repetitions);
  };
  tbb::task_arena arena(threads > 0 ? threads : tbb::task_arena::automatic);
  arena.execute([&] {
    measure("patches, faceted", sheet(8, 24, false), test::kMatte);
    measure("patches, smooth", sheet(8, 24, true), test::kMatte);
    measure("300 K quads", sheet(548, 1, false), test::kMatte);
    measure("patches, plastic", sheet(8, 24, true), 3);
    DicedMesh far = sheet(1, 1, false);
    for (Vec3f& p : far.positions) p.z += 100;
    measure("nothing hit", far, test::kMatte);
  });
}
