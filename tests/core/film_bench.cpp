// Times the film's kernels on made-up samples; prints lines of JSON: million samples per second, and nanoseconds of
// processor time per sample, which on a software device say more when other programs run.
// A tile of 512 x 256 pixels, or a quarter of it where there are many samples; four of five samples name one of
// two shading samples per pixel.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "core/film/film.h"
#include "core/scene/error.h"
#include "core/scene/random.h"

namespace encore {
namespace {

constexpr uint32_t kWidth = 512, kHeight = 256, kRepeats = 7;

struct Samples {
  std::vector<BlockOrigin> blocks;
  FilmSamples shared;
  AaSamples aa;
  Buffer<Vec3f> radiance;
};

Samples makeSamples(Device& device, uint32_t samples_per_pixel) {
  Samples s;
  const uint32_t height = samples_per_pixel > 16 ? kHeight / 4 : kHeight;
  for (uint32_t y = 0; y < height; y += kBlockPixels) {
    for (uint32_t x = 0; x < kWidth; x += kBlockPixels) s.blocks.push_back({int32_t(x), int32_t(y)});
  }
  const uint32_t pixels = kWidth * height, slots = pixels * samples_per_pixel;
  s.shared.position = {device, slots, "position"};
  s.shared.coverage = {device, slots, "coverage"};
  s.shared.normal = {device, slots, "normal"};
  s.aa.count = slots;
  s.aa.samples_per_pixel = samples_per_pixel;
  s.aa.throughput = {device, slots, "throughput"};
  s.aa.shade = {device, slots, "shade"};
  s.radiance = {device, 2 * pixels, "radiance"};
  for (uint32_t i = 0; i < slots; ++i) {
    const auto random = pcg4d(i, 1, 2, 3);
    s.shared.position.host()[i] = random[0];
    s.shared.coverage.host()[i] = 1;
    s.shared.normal.host()[i] = {0, 1, 0};
    s.aa.throughput.host()[i] = {1, 1, toUnit(random[1])};
    const uint32_t near = std::min(i / samples_per_pixel * 2 + random[3] % 64, 2 * pixels - 1);
    s.aa.shade.host()[i] = random[2] % 5 == 0 ? kShadeNone : near;
  }
  std::fill(s.radiance.host().begin(), s.radiance.host().end(), Vec3f{1, 2, 3});
  s.shared.position.toDevice();
  s.shared.coverage.toDevice();
  s.shared.normal.toDevice();
  s.aa.throughput.toDevice();
  s.aa.shade.toDevice();
  s.radiance.toDevice();
  return s;
}

struct Times {
  double seconds = 0, processor_seconds = 0;
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + ptrdiff_t(values.size() / 2), values.end());
  return values[values.size() / 2];
}

// Medians, after one run that compiles the kernels.
Times medianTimes(const std::function<void()>& f) {
  std::vector<double> seconds, processor;
  f();
  for (uint32_t i = 0; i < kRepeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t clock = std::clock();  // of all threads
    f();
    processor.push_back(double(std::clock() - clock) / CLOCKS_PER_SEC);
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return {median(seconds), median(processor)};
}

void printTimings(const Device& device, const char* what, double seconds) {
  std::fprintf(stderr, "%s, median of whole calls %.4f s; on the device, mean:\n", what, seconds);
  for (const auto& [kernel, timing] : device.timings()) {
    std::fprintf(stderr, "  %-24s %9.4f s\n", kernel.c_str(), timing.seconds / (kRepeats + 1));
  }
}

void bench(Device& device, const Samples& s, const char* name, FilterKind filter, float radius, bool details) {
  Film film(device, kWidth, kHeight, filter, radius, 2, s.aa.samples_per_pixel);
  film.beginTile({0, 0, kWidth, kHeight});
  device.resetTimings();
  const Times first = medianTimes([&] { film.addFirstLayer(s.blocks, s.shared, s.aa, s.radiance); });
  if (details) printTimings(device, "first layer", first.seconds);
  device.resetTimings();
  const Times further = medianTimes([&] { film.addLayer(1, s.blocks, s.shared, s.aa, s.radiance); });
  if (details) printTimings(device, "further layers", further.seconds);
  const auto start = std::chrono::steady_clock::now();
  film.finishTile();
  const double finish = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::printf(
      "{\"device\": \"%s\", \"filter\": \"%s\", \"radius_pixels\": %.1f, \"samples_per_pixel\": %u, "
      "\"first_layer_m_samples_per_s\": %.1f, \"further_layer_m_samples_per_s\": %.1f, "
      "\"first_layer_processor_ns\": %.2f, \"further_layer_processor_ns\": %.2f, "
      "\"finish_m_pixels_per_s\": %.1f}\n",
      device.info().name.c_str(), name, double(radius), s.aa.samples_per_pixel, s.aa.count / first.seconds * 1e-6,
      s.aa.count / further.seconds * 1e-6, first.processor_seconds * 1e9 / s.aa.count,
      further.processor_seconds * 1e9 / s.aa.count, kWidth * kHeight / finish * 1e-6);
  std::fflush(stdout);
}

int run(bool details) {
  const auto device = Device::create();
  for (const uint32_t samples_per_pixel : {16u, 64u, 121u}) {
    const Samples samples = makeSamples(*device, samples_per_pixel);
    bench(*device, samples, "blackman-harris", FilterKind::BlackmanHarris, 1.5f, details);
    bench(*device, samples, "blackman-harris", FilterKind::BlackmanHarris, 2.0f, details);
    bench(*device, samples, "box", FilterKind::Box, 0.5f, details);
  }
  return 0;
}

}  // namespace
}  // namespace encore

// --details: time per kernel on standard error.
int main(int count, char** arguments) {
  try {
    return encore::run(count > 1 && std::string(arguments[1]) == "--details");
  } catch (const encore::Error& error) {
    std::fprintf(stderr, "film_bench: %s\n", error.what());
    return 1;
  }
}
