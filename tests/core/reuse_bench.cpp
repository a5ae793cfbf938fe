// Times tree building, nearest neighbours and failures on made-up screens; prints one line of JSON.
// A screen of 1024 x 512 pixels is tiled by square primitives with skewed parameters; 2 shading samples and
// 16 antialiasing samples per pixel, in order of blocks and pixels.
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

constexpr uint32_t kWidth = 1024, kHeight = 512, kRepeats = 3;

struct ScreenPoint {
  SurfaceKey key;
  Vec2f uv;
};

// A random point of a pixel; `side` pixels are a primitive's width.
ScreenPoint pointInPixel(uint32_t x, uint32_t y, double side, std::mt19937& random) {
  const auto uniform = [&] { return double(random()) * 0x1p-32; };
  const double px = (x + uniform()) / side, py = (y + uniform()) / side;
  const double u = px - std::floor(px), v = py - std::floor(py);
  const uint32_t across = uint32_t(std::ceil(kWidth / side));
  const uint32_t primitive = uint32_t(py) * across + uint32_t(px);
  return {{0, primitive << 1}, {float(u * u), float(v * std::sqrt(v))}};
}

// Calls f(x, y, number of the pixel) for all pixels in order of blocks.
void forPixels(const std::function<void(uint32_t, uint32_t, uint32_t)>& f) {
  uint32_t pixel = 0;
  for (uint32_t by = 0; by < kHeight; by += kBlockPixels) {
    for (uint32_t bx = 0; bx < kWidth; bx += kBlockPixels) {
      for (uint32_t i = 0; i < kBlockArea; ++i) f(bx + i % kBlockPixels, by + i / kBlockPixels, pixel++);
    }
  }
}

// Keys and coordinates of per_pixel points in every pixel, for either kind of sample.
template <class Samples>
void scatter(Samples& samples, Device& device, double side, uint32_t per_pixel, uint32_t seed) {
  samples.count = kWidth * kHeight * per_pixel;
  samples.key = {device, samples.count, "key"};
  samples.uv = {device, samples.count, "uv"};
  std::mt19937 random(seed);
  forPixels([&](uint32_t x, uint32_t y, uint32_t pixel) {
    for (uint32_t s = 0; s < per_pixel; ++s) {
      const ScreenPoint point = pointInPixel(x, y, side, random);
      samples.key.host()[pixel * per_pixel + s] = point.key;
      samples.uv.host()[pixel * per_pixel + s] = point.uv;
    }
  });
  samples.key.toDevice();
  samples.uv.toDevice();
}

ShadingSamples makeShadingSamples(Device& device, double side, uint32_t per_pixel) {
  ShadingSamples samples;
  scatter(samples, device, side, per_pixel, 1);
  return samples;
}

AaSamples makeAaSamples(Device& device, double side, uint32_t per_pixel) {
  AaSamples aa;
  scatter(aa, device, side, per_pixel, 2);
  aa.samples_per_pixel = per_pixel;
  aa.shade = {device, aa.count, "shade"};
  return aa;
}

double medianSeconds(const std::function<void()>& f) {
  std::vector<double> seconds;
  for (uint32_t i = 0; i < kRepeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    f();
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  std::nth_element(seconds.begin(), seconds.begin() + kRepeats / 2, seconds.end());
  return seconds[kRepeats / 2];
}

void benchPrimitives(Device& device, const char* name, double side, bool details) {
  const ShadingSamples samples = makeShadingSamples(device, side, 2);
  AaSamples aa = makeAaSamples(device, side, 16);
  ReuseKernels kernels(device);
  auto trees = kernels.buildTrees(samples);  // warm: compiles the kernels
  device.resetTimings();
  const double build = medianSeconds([&] { trees = kernels.buildTrees(samples); });
  kernels.findNearest(*trees, aa);
  const double find = medianSeconds([&] { kernels.findNearest(*trees, aa); });
  const auto fail = [&] {
    std::fill(aa.shade.host().begin(), aa.shade.host().end(), kShadeNotFound);
    aa.shade.toDevice();
    kernels.serveFailures(aa, samples.count);
  };
  fail();
  const double serve = medianSeconds(fail);
  std::printf(
      "\"%s\": {\"build_m_samples_per_s\": %.1f, \"nearest_m_samples_per_s\": %.1f, "
      "\"failures_m_samples_per_s\": %.1f}",
      name, samples.count / build * 1e-6, aa.count / find * 1e-6, aa.count / serve * 1e-6);
  if (!details) return;
  std::fprintf(stderr, "%s, seconds on the device:\n", name);
  for (const auto& [kernel, timing] : device.timings()) {
    std::fprintf(stderr, "  %-24s %6llu dispatches %9.4f\n", kernel.c_str(),
                 static_cast<unsigned long long>(timing.dispatches), timing.seconds);
  }
}

int run(bool details) {
  const auto device = Device::create();
  std::printf("{\"device\": \"%s\", ", device->info().name.c_str());
  benchPrimitives(*device, "primitives_200k", 1.6, details);
  std::printf(", ");
  benchPrimitives(*device, "primitives_5k", 10.2, details);
  std::printf(", ");
  benchPrimitives(*device, "primitives_1", 1024, details);
  std::printf("}\n");
  return 0;
}

}  // namespace
}  // namespace encore

// --details: time per kernel on standard error.
int main(int count, char** arguments) {
  try {
    return encore::run(count > 1 && std::string(arguments[1]) == "--details");
  } catch (const encore::Error& error) {
    std::fprintf(stderr, "reuse_bench: %s\n", error.what());
    return 1;
  }
}
