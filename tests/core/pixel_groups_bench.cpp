// Times pixel groups beside the walk of trees on made-up screens. A screen is tiled by square primitives with skewed
// parameters; 2 shading samples per pixel; antialiasing samples are jittered within each pixel, and pixels stand in
// order of blocks.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "core/reuse/nearest_neighbour.h"
#include "core/reuse/pixel_groups.h"
#include "core/reuse/sample_grid_refiner.h"
#include "core/reuse/trees.h"
#include "core/scene/error.h"

namespace encore {
namespace {

struct Screen {
  uint32_t width = 512, height = 256;
  double side = 10;      // pixels across a primitive
  uint32_t across = 1;   // antialiasing samples are across x across per pixel
  bool horizon = false;  // one ground plane up to the horizon instead of tiles
};

struct ScreenPoint {
  SurfaceKey key;
  Vec2f uv;
};

ScreenPoint pointOf(const Screen& screen, double x, double y) {
  if (screen.horizon) {
    const double depth = 1 / (1e-3 + y / screen.height);  // 1 to 1000
    const double u = 0.5 + (x / screen.width - 0.5) * depth / 1000;
    return {{0, 0}, {float(u), float(depth / 1000)}};
  }
  const double px = x / screen.side, py = y / screen.side;
  const double u = px - std::floor(px), v = py - std::floor(py);
  const uint32_t columns = uint32_t(std::ceil(screen.width / screen.side));
  const uint32_t primitive = uint32_t(py) * columns + uint32_t(px);
  return {{0, primitive << 1}, {float(u * (0.3 + 0.7 * u)), float(v * std::sqrt(v))}};
}

// across x across jittered points in every pixel (rows: per pixel), in order of blocks.
template <class Samples>
void scatter(Samples& samples, Device& device, const Screen& screen, uint32_t across, uint32_t down, uint32_t seed) {
  const uint32_t per_pixel = across * down;
  samples.count = screen.width * screen.height * per_pixel;
  samples.key = {device, samples.count, "key"};
  samples.uv = {device, samples.count, "uv"};
  std::mt19937 random(seed);
  const auto uniform = [&] { return double(random()) * 0x1p-32; };
  uint32_t slot = 0;
  for (uint32_t by = 0; by < screen.height; by += kBlockPixels) {
    for (uint32_t bx = 0; bx < screen.width; bx += kBlockPixels) {
      for (uint32_t i = 0; i < kBlockArea; ++i) {
        for (uint32_t s = 0; s < per_pixel; ++s, ++slot) {
          const double x = bx + i % kBlockPixels + (s % across + uniform()) / across;
          const double y = by + i / kBlockPixels + (s / across + uniform()) / down;
          const ScreenPoint point = pointOf(screen, x, y);
          samples.key.host()[slot] = point.key;
          samples.uv.host()[slot] = point.uv;
        }
      }
    }
  }
  samples.key.toDevice();
  samples.uv.toDevice();
}

// Of all threads of this process, so that what else runs on the machine matters little.
double processorSeconds() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return double(time.tv_sec) + double(time.tv_nsec) * 1e-9;
}

// Processor time over the number of processors: what it takes on an idle machine where all processors are busy.
double leastSeconds(const std::function<void()>& f, int repeats = 5) {
  double least = 1e30;
  for (int i = 0; i < repeats; ++i) {
    const double start = processorSeconds();
    f();
    least = std::min(least, (processorSeconds() - start) / std::thread::hardware_concurrency());
  }
  return least;
}

void bench(Device& device, const char* name, const Screen& screen, bool details) {
  ShadingSamples samples;
  scatter(samples, device, screen, 1, 2, 1);
  AaSamples aa;
  scatter(aa, device, screen, screen.across, screen.across, 2);
  aa.samples_per_pixel = screen.across * screen.across;
  aa.shade = {device, aa.count, "shade"};
  Scan scan(device);
  RadixSort sort(device, scan);
  KeyTable table(device);
  TreeBuilder tree_builder(device, scan, sort, table);
  SampleGridBuilder grid_builder(device, scan, sort, table);
  SampleGridRefiner refiner(device, scan, sort);
  Trees trees;
  SampleGrid grid;
  NearestNeighbour walk(device);
  PixelGroups groups(device);
  const auto shades = [&] {
    aa.shade.toHost();
    return std::vector<uint32_t>(aa.shade.host().begin(), aa.shade.host().end());
  };
  const double tree_build = leastSeconds([&] { tree_builder.build(samples, trees); });
  const double grid_build = leastSeconds([&] {
    grid_builder.build(samples, grid, PixelGroups::kSamplesPerCell);
    refiner.refine(grid, PixelGroups::kSamplesPerCell, PixelGroups::kMaxCell);
  });
  const double tree_find = leastSeconds(
      [&] {
        Commands commands(device);
        walk.record(commands, trees, aa);
        commands.run();
      },
      2);
  const std::vector<uint32_t> expected = shades();
  device.resetTimings();
  const double group_find = leastSeconds([&] {
    Commands commands(device);
    groups.record(commands, grid, aa);
    commands.run();
  });
  std::printf("%-14s %2ux%-2u build: tree %5.1f grid %5.1f   find: tree %6.1f groups %6.1f M samples/s%s\n", name,
              screen.across, screen.across, samples.count / tree_build * 1e-6, samples.count / grid_build * 1e-6,
              aa.count / tree_find * 1e-6, aa.count / group_find * 1e-6, shades() == expected ? "" : "   DIFFER");
  std::fflush(stdout);
  if (!details) return;
  for (const auto& [kernel, timing] : device.timings()) {
    std::printf("  %-24s %6llu dispatches %9.4f\n", kernel.c_str(), static_cast<unsigned long long>(timing.dispatches),
                timing.seconds);
  }
}

struct Case {
  const char* name;
  double side;
  bool horizon = false;
};

int run(const std::string& wanted, bool details) {
  const auto device = Device::create();
  const Case cases[] = {
      {"big patches", 73}, {"5K primitives", 9.3}, {"300K", 2.17}, {"below a pixel", 0.9}, {"horizon", 1, true}};
  for (const uint32_t across : {11u, 8u, 4u}) {
    const uint32_t height = across == 4 ? 256 : 64;
    for (const Case& c : cases) {
      const std::string name = std::string(c.name) + " " + std::to_string(across);
      if (name.find(wanted) != std::string::npos)
        bench(*device, c.name, {256, height, c.side, across, c.horizon}, details);
    }
  }
  return 0;
}

}  // namespace
}  // namespace encore

// First argument: only cases whose name and number contain it. --details, second: time per kernel.
int main(int count, char** arguments) {
  try {
    return encore::run(count > 1 ? arguments[1] : "", count > 2 && std::string(arguments[2]) == "--details");
  } catch (const encore::Error& error) {
    std::fprintf(stderr, "pixel_groups_bench: %s\n", error.what());
    return 1;
  }
}
