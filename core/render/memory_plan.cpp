#include "core/render/memory_plan.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

#include "core/film/film.h"
#include "core/path/path.h"
#include "core/reuse/reuse.h"
#include "core/scene/error.h"

namespace encore {
namespace {

// Larger batches gain nothing: a dispatch over a million samples already hides its launch.
constexpr uint64_t kMaxSlotsPerBatch = 1u << 20;

// What core/path and core/shade keep beside a path's vertex while it is on its way: how its ray spreads, and
// the pattern points and inputs of a hit, each of them twice while blocks are joined.
constexpr uint64_t kPathStateBytes = 2 * (sizeof(PatternPoint) + sizeof(PathInputs)) + 32;
constexpr uint64_t kAaSampleBytes = sizeof(SurfaceKey) + sizeof(Vec2f) + sizeof(Vec3f) + sizeof(uint32_t);
constexpr uint64_t kFilmSampleBytes = sizeof(uint32_t) + sizeof(float) + sizeof(Vec3f);
constexpr uint64_t kShadingSampleBytes = sizeof(SurfaceKey) + sizeof(Vec2f) + sizeof(Vec3f);

std::string mebibytes(uint64_t bytes) { return std::to_string((bytes + (1u << 20) - 1) >> 20) + " MiB"; }

}  // namespace

MemoryPlan planMemory(const Settings& settings, uint32_t layers, uint64_t budget_bytes) {
  const uint64_t tile = settings.reuse_tile_pixels;
  const uint64_t tile_pixels = std::min<uint64_t>(tile, settings.width) * std::min<uint64_t>(tile, settings.height);
  const double rate = settings.method == Method::Reuse ? double(settings.shading_rate) : 0.0;
  const uint64_t seeds = uint64_t(std::ceil(double(tile_pixels) * rate)) + kBlockArea;
  const uint64_t per_seed = sizeof(FirstHit) + sizeof(PathVertex) + kPathStateBytes;

  MemoryPlan plan;
  plan.fixed_bytes = seeds * per_seed + layers * (seeds * kShadingSampleBytes + ReuseKernels::treeBytes(seeds)) +
                     Film::frameBytes(uint64_t(settings.width) * settings.height, layers);
  const uint64_t slots = uint64_t(kBlockArea) * settings.samples * settings.samples;
  const uint64_t per_slot = sizeof(FirstHit) + 2 * sizeof(PathVertex) + kPathStateBytes + kAaSampleBytes +
                            kFilmSampleBytes + layers * sizeof(Vec3f);
  plan.bytes_per_block =
      slots * per_slot + ReuseKernels::failureBytes(slots) + Film::partialBytes(1, settings.filter_radius_pixels);

  const uint64_t least = plan.fixed_bytes + plan.bytes_per_block;
  if (budget_bytes < least)
    throw Error(ErrorKind::Memory, "a budget of " + mebibytes(budget_bytes) + " cannot hold this frame", "--memory",
                "Give at least " + mebibytes(least) + ", or lower --samples, --shadingRate or the image size");
  const uint64_t by_budget = (budget_bytes - plan.fixed_bytes) / plan.bytes_per_block;
  const uint64_t useful = std::max<uint64_t>(1, kMaxSlotsPerBatch / slots);
  plan.blocks_per_batch = uint32_t(std::min(by_budget, useful));
  return plan;
}

uint64_t defaultMemoryBudget(bool cpu_device, uint64_t device_bytes) {
  if (!cpu_device) return device_bytes / 2;
  std::ifstream meminfo("/proc/meminfo");
  std::string name, unit;
  uint64_t kibibytes = 0;
  while (meminfo >> name >> kibibytes) {
    std::getline(meminfo, unit);
    if (name == "MemAvailable:") return kibibytes * 1024 / 2;
  }
  return device_bytes / 2;
}

}  // namespace encore
