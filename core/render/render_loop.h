// Listing 3: layers × buckets × batches, with progress, cancellation and statistics.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/film/film.h"
#include "core/path/path.h"
#include "core/scene/scene.h"
#include "core/vulkan/device.h"

namespace encore {

// Table 1's columns, for one layer or for all.
struct LayerStatistics {
  uint64_t shading_evaluations = 0;  // reshading included
  uint64_t reshading_evaluations = 0;
  uint64_t failed_samples = 0;        // antialiasing samples that found no neighbour
  uint64_t antialiasing_samples = 0;  // with a surface to shade
  double trace_s = 0, shade_s = 0, reuse_s = 0, film_s = 0;
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

struct Frame {
  std::vector<Layer> layers;
  FilmImages images;
  Statistics statistics;
};

// Called from the rendering thread with the share of the frame that is done, in [0, 1], never falling.
// Returning false cancels: render() throws Error(Cancelled).
using Progress = std::function<bool(double done, const char* stage)>;

// Renders one frame on `device`. The scene is moved to the camera's origin while it renders and put back
// after it (see rebase()). Throws Error.
Frame render(Scene& scene, const Settings& settings, Device& device, const Progress& progress = {});

}  // namespace encore
