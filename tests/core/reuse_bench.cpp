// Times the reuse kernels on made-up screens; prints one line of JSON per measurement: device, kernel, what it ran on,
// and M samples/s, the median of several runs.
// A screen of 1024 x 512 pixels is tiled by square primitives with skewed parameters; 2 shading samples and
// 16 antialiasing samples per pixel, in order of blocks and pixels. Coherent samples lie in their pixel, incoherent
// ones within 20 pixels of it, as with a lens.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "core/reuse/reuse.h"
#include "core/scene/error.h"

namespace encore {
namespace {

constexpr uint32_t kWidth = 1024, kHeight = 512, kAaPerPixel = 16, kShadingPerPixel = 2;
constexpr double kBlurPixels = 20;

struct Options {
  uint32_t runs = 5;
  bool details = false;
};

struct ScreenPoint {
  SurfaceKey key;
  Vec2f uv;
};

class Screen {
 public:
  // side: pixels that a primitive is wide.
  Screen(Device& device, std::string name, double side) : device_(device), name_(std::move(name)), side_(side) {}

  const std::string& name() const { return name_; }
  double side() const { return side_; }

  // blur: largest distance from the pixel, in pixels.
  ShadingSamples shadingSamples(double blur) const {
    ShadingSamples samples;
    scatter(samples, kShadingPerPixel, blur, 1);
    return samples;
  }
  AaSamples aaSamples(double blur) const {
    AaSamples aa;
    scatter(aa, kAaPerPixel, blur, 2);
    aa.samples_per_pixel = kAaPerPixel;
    aa.shade = {device_, aa.count, "shade"};
    aa.cell = {device_, aa.count, "cell"};
    for (uint32_t i = 0; i < aa.count; ++i) aa.cell.host()[i] = i / kAaPerPixel / 4 + i % 3;
    aa.cell.toDevice();
    return aa;
  }

 private:
  ScreenPoint point(double x, double y) const {
    const double px = std::clamp(x, 0.0, kWidth - 1e-3) / side_, py = std::clamp(y, 0.0, kHeight - 1e-3) / side_;
    const double u = px - std::floor(px), v = py - std::floor(py);
    const uint32_t across = uint32_t(std::ceil(kWidth / side_));
    const uint32_t primitive = uint32_t(py) * across + uint32_t(px);
    return {{0, primitive << 1}, {float(u * u), float(v * std::sqrt(v))}};
  }

  // Keys and coordinates of per_pixel points for every pixel, for either kind of sample.
  template <class Samples>
  void scatter(Samples& samples, uint32_t per_pixel, double blur, uint32_t seed) const {
    samples.count = kWidth * kHeight * per_pixel;
    samples.key = {device_, samples.count, "key"};
    samples.uv = {device_, samples.count, "uv"};
    std::mt19937 random(seed);
    const auto uniform = [&] { return double(random()) * 0x1p-32; };
    for (uint32_t slot = 0; slot < samples.count; ++slot) {
      const uint32_t pixel = slot / per_pixel, block = pixel / kBlockArea, in_block = pixel % kBlockArea;
      const uint32_t across = kWidth / kBlockPixels;
      const double x = block % across * kBlockPixels + in_block % kBlockPixels + uniform();
      const double y = block / across * kBlockPixels + in_block / kBlockPixels + uniform();
      const double radius = blur * std::sqrt(uniform()), angle = 6.2831853 * uniform();
      const ScreenPoint at = point(x + radius * std::cos(angle), y + radius * std::sin(angle));
      samples.key.host()[slot] = at.key;
      samples.uv.host()[slot] = at.uv;
    }
    samples.key.toDevice();
    samples.uv.toDevice();
  }

  Device& device_;
  std::string name_;
  double side_;
};

class Bench {
 public:
  Bench(Device& device, const Options& options) : device_(device), kernels_(device), options_(options) {}

  void run(const Screen& screen) {
    for (const double blur : {0.0, kBlurPixels}) {
      const ShadingSamples samples = screen.shadingSamples(0);
      AaSamples aa = screen.aaSamples(blur);
      const std::string on = blur > 0 ? "incoherent" : "coherent";
      for (const auto& [search, name] : kSearches) {
        if (blur == 0)
          measure("build_" + name, screen, on, samples.count,
                  [&, which = search] { kernels_.buildIndex(samples, which); });
        const auto index = kernels_.buildIndex(samples, search);
        measure("find_" + name, screen, on, aa.count, [&] { kernels_.findNearest(*index, aa); });
      }
      if (blur == 0) runFailures(screen, aa);
    }
    runMetric(screen);
  }

 private:
  inline static const std::vector<std::pair<Search, std::string>> kSearches{
      {Search::Tree, "tree"}, {Search::Groups, "groups"}, {Search::Cells, "cells"}};

  // prepare is not timed. One more run than counted: the first compiles kernels.
  void measure(
      const std::string& kernel, const Screen& screen, const std::string& on, uint32_t samples,
      const std::function<void()>& f, const std::function<void()>& prepare = [] {}) {
    std::vector<double> seconds;
    for (uint32_t i = 0; i <= options_.runs; ++i) {
      prepare();
      if (i == 1) device_.resetTimings();
      const auto start = std::chrono::steady_clock::now();
      f();
      seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    seconds.erase(seconds.begin());
    std::sort(seconds.begin(), seconds.end());
    std::printf(
        "{\"bench\": \"reuse\", \"device\": \"%s\", \"kernel\": \"%s\", \"screen\": \"%s\", \"samples\": \"%s\", "
        "\"m_samples_per_s\": %.1f, \"best_m_samples_per_s\": %.1f, \"runs\": %u}\n",
        device_.info().name.c_str(), kernel.c_str(), screen.name().c_str(), on.c_str(),
        samples / seconds[seconds.size() / 2] * 1e-6, samples / seconds.front() * 1e-6, options_.runs);
    std::fflush(stdout);
    if (options_.details) printTimings();
  }

  void printTimings() const {
    for (const auto& [kernel, timing] : device_.timings()) {
      std::fprintf(stderr, "  %-28s %6.1f dispatches %9.2f ms per run\n", kernel.c_str(),
                   double(timing.dispatches) / options_.runs, timing.seconds * 1e3 / options_.runs);
    }
  }

  void runFailures(const Screen& screen, AaSamples& aa) {
    using Share = ReuseKernels::Share;
    struct Case {
      const char* kernel;
      const char* on;
      Share share;
      uint32_t every;  // which slots fail
    };
    for (const Case& c : {Case{"failures_in_pixel", "2 % fail", Share::InPixel, 50},
                          Case{"failures_in_pixel", "all fail", Share::InPixel, 1},
                          Case{"failures_in_cell", "all fail", Share::InCell, 1},
                          Case{"failures_nothing_shared", "all fail", Share::Nothing, 1}}) {
      const auto prepare = [&] {
        for (uint32_t i = 0; i < aa.count; ++i) aa.shade.host()[i] = i % c.every == 0 ? kShadeNotFound : 0;
        aa.shade.toDevice();
      };
      measure(c.kernel, screen, c.on, aa.count, [&] { kernels_.serveFailures(aa, 0, c.share); }, prepare);
    }
  }

  // Footprints about as large as a pixel; "mixed": every other one, "rare": one of a hundred 64 times larger.
  template <class Samples>
  void giveFootprints(Samples& samples, const Screen& screen, uint32_t every, uint32_t seed) {
    samples.footprint = {device_, samples.count, "footprint"};
    std::mt19937 random(seed);
    for (float& r : samples.footprint.host()) {
      r = float((1 + 0.1 * double(random()) * 0x1p-32) / screen.side());
      if (every > 0 && random() % every == 0) r *= 64;
    }
    samples.footprint.toDevice();
  }

  void runMetric(const Screen& screen) {
    struct Case {
      const char* footprints;
      uint32_t every;
    };
    for (const double blur : {0.0, kBlurPixels}) {
      ShadingSamples samples = screen.shadingSamples(0);
      AaSamples aa = screen.aaSamples(blur);
      for (const Case& c : {Case{"uniform", 0}, Case{"mixed", 2}, Case{"rare", 100}}) {
        giveFootprints(samples, screen, c.every, 3);
        giveFootprints(aa, screen, c.every, 4);
        const std::string on = std::string(blur > 0 ? "incoherent" : "coherent") + ", footprints " + c.footprints;
        if (blur == 0)
          measure("build_metric", screen, on, samples.count, [&] { kernels_.buildIndex(samples, Search::Tree, 1); });
        const auto index = kernels_.buildIndex(samples, Search::Tree, 1);
        measure("find_metric", screen, on, aa.count, [&] { kernels_.findNearest(*index, aa); });
        if (c.every == 0) {
          measure(
              "limit_distance", screen, on, aa.count, [&] { kernels_.limitDistance(samples, aa, 3); },
              [&] { kernels_.findNearest(*index, aa); });
        }
      }
    }
  }

  Device& device_;
  ReuseKernels kernels_;
  const Options& options_;
};

int run(const Options& options, const std::string& only) {
  const auto device = Device::create();
  Bench bench(*device, options);
  for (const Screen& screen : {Screen(*device, "primitives_200k", 1.6), Screen(*device, "primitives_5k", 10.2),
                               Screen(*device, "primitives_1", 1024)}) {
    if (only.empty() || only == screen.name()) bench.run(screen);
  }
  return 0;
}

}  // namespace
}  // namespace encore

// --quick: two runs instead of five. --details: time per kernel on standard error. A name: only that screen.
int main(int count, char** arguments) {
  encore::Options options;
  std::string only;
  for (int i = 1; i < count; ++i) {
    const std::string argument = arguments[i];
    if (argument == "--quick")
      options.runs = 2;
    else if (argument == "--details")
      options.details = true;
    else
      only = argument;
  }
  try {
    return encore::run(options, only);
  } catch (const encore::Error& error) {
    std::fprintf(stderr, "reuse_bench: %s\n", error.what());
    return 1;
  }
}
