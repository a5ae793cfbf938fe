// Times cell lists beside walks of the trees, on made-up screens, coherent and in random order; a table, or with --json
// one line.
// A screen of 512 x 512 pixels (a reuse tile) is tiled by square primitives with skewed parameters; 2 shading samples
// and 4 antialiasing samples per pixel, in order of blocks and pixels, or shuffled as blur and reflection do.
// Times are processor time over kThreads (what other programs take does not count), the least of kRepeats.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "core/reuse/cell_lists.h"
#include "core/reuse/nearest_neighbour.h"
#include "core/scene/error.h"

namespace encore {
namespace {

constexpr uint32_t kSide = 512, kRepeats = 3, kShadingPerPixel = 2, kAaPerPixel = 4;
constexpr double kThreads = 2;

struct ScreenPoint {
  SurfaceKey key;
  Vec2f uv;
};

// What the screen shows: squares, or a plane seen to the horizon, whose density varies by a million.
struct Screen {
  const char* name;
  double side;  // pixels that a primitive is wide; 0: the plane
};

ScreenPoint pointInPixel(uint32_t x, uint32_t y, const Screen& screen, std::mt19937& random) {
  const auto uniform = [&] { return double(random()) * 0x1p-32; };
  const double px = x + uniform(), py = y + uniform();
  if (screen.side == 0) {
    const double distance = kSide / (py + 0.5);  // from 1 to 1000 heights
    return {{0, 0}, {float(0.5 + (px / kSide - 0.5) * distance / 1100), float(distance / 1100)}};
  }
  const double sx = px / screen.side, sy = py / screen.side;
  const double u = sx - std::floor(sx), v = sy - std::floor(sy);
  const uint32_t across = uint32_t(std::ceil(kSide / screen.side));
  const uint32_t primitive = uint32_t(sy) * across + uint32_t(sx);
  return {{0, primitive << 1}, {float(u * u), float(v * std::sqrt(v))}};
}

// Keys and coordinates of per_pixel points in every pixel, in order of blocks or shuffled, for either kind of sample.
template <class Samples>
void scatter(Samples& samples, Device& device, const Screen& screen, uint32_t per_pixel, uint32_t seed, bool shuffled) {
  samples.count = kSide * kSide * per_pixel;
  samples.key = {device, samples.count, "key"};
  samples.uv = {device, samples.count, "uv"};
  std::mt19937 random(seed);
  std::vector<uint32_t> slots(samples.count);
  std::iota(slots.begin(), slots.end(), 0);
  if (shuffled) {
    for (uint32_t i = samples.count; i-- > 1;) std::swap(slots[i], slots[random() % (i + 1)]);
  }
  uint32_t next = 0;
  for (uint32_t block = 0; block < kSide * kSide / kBlockArea; ++block) {
    const uint32_t across = kSide / kBlockPixels;
    for (uint32_t i = 0; i < kBlockArea * per_pixel; ++i) {
      const uint32_t pixel = i / per_pixel;
      const ScreenPoint point = pointInPixel(block % across * kBlockPixels + pixel % kBlockPixels,
                                             block / across * kBlockPixels + pixel / kBlockPixels, screen, random);
      samples.key.host()[slots[next]] = point.key;
      samples.uv.host()[slots[next++]] = point.uv;
    }
  }
  samples.key.toDevice();
  samples.uv.toDevice();
}

double secondsOf(const std::function<void()>& f) {
  const std::clock_t start = std::clock();
  f();
  return double(std::clock() - start) / CLOCKS_PER_SEC / kThreads;
}

struct Task {
  const char* name;
  double items;
  std::function<void()> run;
  double seconds = 1e30;
};

class Bench {
 public:
  explicit Bench(Device& device) : device_(device) {}

  void run(const Screen& screen, bool json, bool details) {
    ShadingSamples samples;
    scatter(samples, device_, screen, kShadingPerPixel, 1, false);
    AaSamples aa[2];
    for (uint32_t shuffled = 0; shuffled < 2; ++shuffled) {
      scatter(aa[shuffled], device_, screen, kAaPerPixel, 2, shuffled == 1);
      aa[shuffled].samples_per_pixel = kAaPerPixel;
      aa[shuffled].shade = {device_, aa[shuffled].count, "shade"};
    }
    Trees trees;
    CellLists lists;
    SampleGrid grid;
    std::vector<Task> tasks;
    const double n = samples.count, queries = aa[0].count;
    tasks.push_back({"build trees", n, [&] { trees_.build(samples, trees); }});
    tasks.push_back({"build grid (4 per cell)", n, [&] { grids_.build(samples, grid, 4); }});
    tasks.push_back({"build cell lists", n, [&] { builder_.build(samples, lists); }});
    for (uint32_t i = 0; i < 2; ++i) {
      const auto find = [this, &aa, i](auto& search, const auto& index) {
        Commands commands(device_);
        search.record(commands, index, aa[i]);
        commands.run();
      };
      const bool shuffled = i == 1;
      tasks.push_back({shuffled ? "grouped walks, shuffled" : "grouped walks", queries,
                       [=, &trees, this] { find(grouped_, trees); }});
      tasks.push_back(
          {shuffled ? "single walks, shuffled" : "single walks", queries, [=, &trees, this] { find(single_, trees); }});
      tasks.push_back(
          {shuffled ? "cell lists, shuffled" : "cell lists", queries, [=, &lists, this] { find(search_, lists); }});
    }
    for (Task& task : tasks) task.run();  // compiles the kernels
    device_.resetTimings();
    for (uint32_t i = 0; i < kRepeats; ++i) {
      for (Task& task : tasks) task.seconds = std::min(task.seconds, secondsOf(task.run));
    }
    print(screen, tasks, lists, json);
    std::fflush(stdout);
    if (!details) return;
    for (const auto& [kernel, timing] : device_.timings()) {
      std::fprintf(stderr, "  %-26s %4.1f dispatches %8.4f s\n", kernel.c_str(), double(timing.dispatches) / kRepeats,
                   timing.seconds / kRepeats);
    }
  }

 private:
  void print(const Screen& screen, const std::vector<Task>& tasks, const CellLists& lists, bool json) {
    if (json) std::printf("{\"scene\": \"%s\", \"M_per_s\": {", screen.name);
    if (!json) {
      std::printf("%s: %u shading samples, %u nodes, %.2f entries per node, %u leaves by tree\n", screen.name,
                  lists.sample_count, lists.node_count, double(lists.entry_count) / lists.node_count,
                  lists.leaves_by_tree);
    }
    for (const Task& task : tasks) {
      const double rate = task.items / task.seconds * 1e-6;
      if (json) std::printf("%s\"%s\": %.2f", &task == tasks.data() ? "" : ", ", task.name, rate);
      if (!json) std::printf("  %-26s %8.4f s %8.1f M/s\n", task.name, task.seconds, rate);
    }
    if (json) std::printf("}}\n");
  }

  Device& device_;
  Scan scan_{device_};
  RadixSort sort_{device_, scan_};
  KeyTable table_{device_};
  TreeBuilder trees_{device_, scan_, sort_, table_};
  SampleGridBuilder grids_{device_, scan_, sort_, table_};
  CellListBuilder builder_{device_, scan_, table_, grids_, trees_};
  CellListSearch search_{device_};
  NearestNeighbour grouped_{device_, NearestNeighbour::Walk::kGrouped};
  NearestNeighbour single_{device_, NearestNeighbour::Walk::kSingle};
};

int run(const std::string& only, bool json, bool details) {
  const auto device = Device::create();
  Bench bench(*device);
  const Screen screens[] = {{"primitives_200k", 1.15}, {"primitives_5k", 7.3}, {"primitives_1", 512}, {"horizon", 0}};
  for (const Screen& screen : screens) {
    if (only.empty() || only == screen.name) bench.run(screen, json, details);
  }
  return 0;
}

}  // namespace
}  // namespace encore

// A scene's name: only that one; --json: one line for each scene; --details: time per kernel on standard error.
int main(int count, char** arguments) {
  bool json = false, details = false;
  std::string only;
  for (int i = 1; i < count; ++i) {
    const std::string argument = arguments[i];
    if (argument == "--json") json = true;
    if (argument == "--details") details = true;
    if (argument[0] != '-') only = argument;
  }
  try {
    return encore::run(only, json, details);
  } catch (const encore::Error& error) {
    std::fprintf(stderr, "cell_lists_bench: %s\n", error.what());
    return 1;
  }
}
