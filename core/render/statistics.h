// What a frame took, and how long.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

#include "core/scene/settings.h"
#include "core/vulkan/device.h"

namespace encore {

// Table 1's columns, for one layer or for all.
struct LayerStatistics {
  uint64_t shading_evaluations = 0;  // reshading included
  uint64_t reshading_evaluations = 0;
  uint64_t failed_samples = 0;        // antialiasing samples that found no neighbour
  uint64_t antialiasing_samples = 0;  // with a surface to shade
  double trace_s = 0, shade_s = 0, reuse_s = 0, film_s = 0;
  Search search = Search::Tree;  // how nearest neighbours were found
};

struct Statistics {
  std::string device, driver;
  uint32_t threads = 0;
  uint64_t primitives = 0, micropolygons = 0;
  uint64_t pixels = 0;
  uint64_t antialiasing_samples = 0;  // camera rays
  uint64_t rays_traced = 0;
  uint64_t non_finite_samples = 0;
  uint64_t peak_memory_bytes = 0;  // of the process
  uint64_t device_peak_bytes = 0;  // samples, trees and film
  uint64_t geometry_bytes = 0, texture_bytes = 0;
  std::map<std::string, double> time_s;  // dice, build, trace, shade, reuse, film, total
  std::map<std::string, LayerStatistics> layers;
  std::map<std::string, KernelTiming> kernels;
  // Things that were rendered differently from what the scene says: message → count.
  std::map<std::string, uint64_t> warnings;
};

// Adds the time until stop(), or until the end of its scope.
class StageTimer {
 public:
  explicit StageTimer(double& seconds) : seconds_(seconds) {}
  ~StageTimer() { stop(); }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

  void stop() {
    if (!running_) return;
    running_ = false;
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  double& seconds_;
  bool running_ = true;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace encore
