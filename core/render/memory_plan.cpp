#include "core/render/memory_plan.h"

#include <algorithm>
#include <fstream>
#include <string>

#include "core/film/film.h"
#include "core/path/footprint.h"
#include "core/path/path.h"
#include "core/render/samples.h"
#include "core/reuse/reuse.h"
#include "core/scene/error.h"

namespace encore {
namespace {

// Larger batches gain nothing: a dispatch over a million samples already hides its launch.
constexpr uint64_t kMaxSlotsPerBatch = 1u << 20;
// Each of them takes tens of rays to shade.
constexpr uint64_t kMaxSeedsPerBatch = 1u << 17;

// What core/path and core/shade keep beside a path's vertex while it is on its way: how its ray spreads, and
// the pattern points and inputs of a hit, each of them twice while blocks are joined.
constexpr uint64_t kPatternFloats = 16;  // that most networks read at a point
constexpr uint64_t kPathStateBytes =
    2 * (sizeof(PatternPoint) + kPatternFloats * sizeof(float) + sizeof(PathInputs)) + 32;
constexpr uint64_t kAaSampleBytes =
    sizeof(SurfaceKey) + sizeof(Vec2f) + sizeof(Vec3f) + sizeof(float) + 2 * sizeof(uint32_t);
constexpr uint64_t kFilmSampleBytes = sizeof(uint32_t) + sizeof(float) + sizeof(Vec3f);
constexpr uint64_t kShadingSampleBytes = sizeof(SurfaceKey) + sizeof(Vec2f) + sizeof(Vec3f) + sizeof(float);

// Of the further coordinates of the reuse distance, where they are part of it.
uint64_t aspectBytes(const Settings& settings) { return needsAspect(settings) ? sizeof(Vec4f) : 0; }

// Of the largest aov's sample: one after the other is brought to the film.
uint64_t aovBytes(const Settings& settings) {
  uint64_t most = 0;
  for (const Aov& aov : settings.aovs)
    most = std::max<uint64_t>(most, aov.kind == Aov::Kind::Primvar ? aov.components * sizeof(float) : 0);
  return most;
}

// The longest side of tiles between borders.
int32_t largestPart(const std::vector<int32_t>& borders, uint32_t tile) {
  int32_t largest = 0;
  for (size_t i = 1; i < borders.size(); ++i)
    largest = std::max(largest, std::min(borders[i] - borders[i - 1], int32_t(tile)));
  return largest;
}

std::string mebibytes(uint64_t bytes) { return std::to_string((bytes + (1u << 20) - 1) >> 20) + " MiB"; }

}  // namespace

MemoryPlan planMemory(const Settings& settings, const PlanInput& input, uint64_t budget_bytes) {
  const FilmArea area = filmArea(settings);
  const PixelRect rect{0, 0, largestPart(area.columns, settings.reuse_tile_pixels),
                       largestPart(area.rows, settings.reuse_tile_pixels)};
  const uint64_t blocks =
      ((rect.width() + kBlockPixels - 1) / kBlockPixels) * uint64_t((rect.height() + kBlockPixels - 1) / kBlockPixels);
  const uint64_t slots = uint64_t(kBlockArea) * settings.samples * settings.samples;

  MemoryPlan plan;
  plan.fixed_bytes = Film::areaBytes(area, rect, settings.filter_radius_pixels, uint32_t(input.layers.size()),
                                     settings.debug_aovs, settings.aovs);
  uint64_t block_seeds = 0;
  if (settings.method == Method::Reuse)
    for (const PlanInput::LayerInput& layer : input.layers) {
      const uint64_t seeds = mostShadingRays(layer.rate);
      block_seeds = std::max(block_seeds, seeds);
      plan.fixed_bytes += blocks * seeds * (kShadingSampleBytes + aspectBytes(settings)) +
                          ReuseKernels::indexBytes(blocks * seeds, layer.search);
    }
  plan.bytes_per_seed_block =
      block_seeds * (sizeof(FirstHit) + sizeof(PathVertex) + sizeof(Vec3f) + kPathStateBytes + input.path_state_bytes);
  const uint64_t per_slot = input.path_state_bytes + sizeof(FirstHit) + 2 * sizeof(PathVertex) + kPathStateBytes +
                            kAaSampleBytes + aspectBytes(settings) + kFilmSampleBytes + aovBytes(settings) +
                            input.layers.size() * sizeof(Vec3f);
  plan.bytes_per_block =
      slots * per_slot + ReuseKernels::failureBytes(slots) + Film::partialBytes(1, settings.filter_radius_pixels);

  // Seeds and antialiasing samples are in flight one after the other.
  const uint64_t least = plan.fixed_bytes + std::max(plan.bytes_per_block, plan.bytes_per_seed_block);
  if (budget_bytes < least)
    throw Error(ErrorKind::Memory, "a budget of " + mebibytes(budget_bytes) + " cannot hold this frame", "--memory",
                "Give at least " + mebibytes(least) + ", or lower --samples, --shadingRate or --reuseTile");
  const uint64_t flight = budget_bytes - plan.fixed_bytes;
  const auto fitting = [&](uint64_t bytes, uint64_t samples, uint64_t most) {
    const uint64_t useful = std::max<uint64_t>(1, most / std::max<uint64_t>(1, samples));
    return uint32_t(std::min({flight / std::max<uint64_t>(1, bytes), useful, blocks}));
  };
  plan.blocks_per_batch = fitting(plan.bytes_per_block, slots, kMaxSlotsPerBatch);
  plan.blocks_per_seed_batch = fitting(plan.bytes_per_seed_block, block_seeds, kMaxSeedsPerBatch);
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
