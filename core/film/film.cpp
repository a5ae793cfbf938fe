// Splats batches on the device, adds the blocks' partial images into the frame, resolves.
#include "core/film/film.h"

#include <bit>
#include <limits>
#include <string>

#include "core/scene/error.h"
#include "kernels/film/splat_layer.h"
#include "kernels/film/splat_shared.h"
#include "kernels/film/sum_taps.h"

namespace encore {
namespace {

constexpr uint32_t kLayerChannels = 3;
constexpr uint32_t kSharedChannels = 5;  // normal, coverage, filter weight
constexpr uint32_t kCoverage = 3, kWeight = 4;
constexpr uint32_t kLocalSize = 64;
constexpr float kMaxRadius = 8;

// Blocks that are splatted at once: enough to fill a device, few enough for the taps to stay small.
constexpr uint64_t kMaxChunkBlocks = 128;
constexpr uint64_t kMaxTapBytes = 64ull << 20;

uint64_t tapsPerSide(uint32_t pad) { return 2 * uint64_t(pad) + 1; }
uint64_t paddedPixels(uint32_t pad) { return kBlockPixels + 2 * uint64_t(pad); }
uint64_t tapValues(uint32_t pad, uint32_t channels) {
  return tapsPerSide(pad) * tapsPerSide(pad) * channels * kBlockArea;
}
uint64_t partialValues(uint32_t pad, uint32_t channels) { return paddedPixels(pad) * paddedPixels(pad) * channels; }

uint64_t chunkBlocks(uint32_t pad) {
  const uint64_t fitting = kMaxTapBytes / (tapValues(pad, kSharedChannels) * sizeof(float));
  return std::clamp<uint64_t>(fitting, 1, kMaxChunkBlocks);
}

// Rows of taps per invocation: all of them while their sums fit into registers and first-level cache.
uint32_t tapRows(uint32_t pad) { return pad <= 2 ? 2 * pad + 1 : 1; }

float checkedRadius(float radius) {
  if (radius > 0 && radius <= kMaxRadius) return radius;
  throw Error(ErrorKind::Setting, "A filter radius of " + std::to_string(radius) + " pixels is not possible",
              "filter_radius_pixels", "Choose one above 0 and up to 8");
}

// SplatArguments of shaders/film/splat.glsl.
struct SplatArguments {
  uint64_t origins, positions, taps, counters;
  uint32_t blocks, width, height, samples_per_pixel;
};

// Counters of shaders/film/splat.glsl.
struct Counters {
  uint32_t non_finite = 0, bad_shade = 0;
};

// Channels of the whole frame: planes of width * height sums.
using Planes = std::vector<std::vector<float>>;

}  // namespace

struct Film::Impl {
  Impl(Device& owner, uint32_t w, uint32_t h, FilterKind filter, float radius, uint32_t layer_count, uint32_t samples);

  // Runs one batch, chunk by chunk. splat(commands, common, first_slot) records the first kernel.
  template <class Splat>
  void add(Planes& planes, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const Kernel& sum,
           Splat&& splat);
  void addPartials(Planes& planes, std::span<const BlockOrigin> blocks) const;
  uint64_t splatGroups(uint64_t blocks) const {
    return groupsFor(blocks * kBlockArea * (tapsPerSide(pad) / tapRows(pad)), kLocalSize);
  }
  uint64_t slots(uint64_t blocks) const { return blocks * kBlockArea * samples_per_pixel; }
  void requireSlots(uint64_t have, size_t blocks, const char* what) const;

  Device& device;
  uint32_t width, height, pad, samples_per_pixel;
  Kernel splat_shared, splat_layer, sum_shared, sum_layer;
  Buffer<float> taps, partials;
  Buffer<BlockOrigin> origins;
  Buffer<Counters> counters;
  Planes shared_sums;
  std::vector<Planes> layer_sums;
  std::vector<float> depth;
  uint64_t non_finite = 0;
};

Film::Impl::Impl(Device& owner, uint32_t w, uint32_t h, FilterKind filter, float radius, uint32_t layer_count,
                 uint32_t samples)
    : device(owner), width(w), height(h), pad(filterPad(checkedRadius(radius))), samples_per_pixel(samples) {
  const uint32_t splat_constants[] = {uint32_t(filter), std::bit_cast<uint32_t>(radius),
                                      std::bit_cast<uint32_t>(1.0f / radius), pad, tapRows(pad)};
  splat_shared = Kernel(device, "splat_shared", kSplatSharedSpirv, splat_constants);
  splat_layer = Kernel(device, "splat_layer", kSplatLayerSpirv, splat_constants);
  sum_shared = Kernel(device, "sum_taps", kSumTapsSpirv, {{pad, kSharedChannels}});
  sum_layer = Kernel(device, "sum_taps", kSumTapsSpirv, {{pad, kLayerChannels}});
  const size_t pixels = size_t(width) * height;
  shared_sums.assign(kSharedChannels, std::vector<float>(pixels, 0.0f));
  layer_sums.assign(layer_count, Planes(kLayerChannels, std::vector<float>(pixels, 0.0f)));
  depth.assign(pixels, std::numeric_limits<float>::infinity());
  counters = Buffer<Counters>(device, 1, "film counters");
}

void Film::Impl::requireSlots(uint64_t have, size_t blocks, const char* what) const {
  if (have >= slots(blocks)) return;
  throw Error(ErrorKind::Internal, std::string("Film: ") + what + " has " + std::to_string(have) + " slots for " +
                                       std::to_string(blocks) + " blocks that need " + std::to_string(slots(blocks)));
}

template <class Splat>
void Film::Impl::add(Planes& planes, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const Kernel& sum,
                     Splat&& splat) {
  requireSlots(shared.position.size(), blocks.size(), "position");
  const uint32_t channels = uint32_t(planes.size());
  const uint64_t chunk = std::min<uint64_t>(chunkBlocks(pad), blocks.size());
  taps.reserve(device, chunk * tapValues(pad, kSharedChannels), "film taps");
  partials.reserve(device, chunk * partialValues(pad, kSharedChannels), "film partials");
  origins.reserve(device, chunk, "film blocks");
  Commands commands(device);
  for (uint64_t first = 0; first < blocks.size(); first += chunk) {
    const auto part = blocks.subspan(first, std::min<uint64_t>(chunk, blocks.size() - first));
    const uint32_t count = uint32_t(part.size());
    std::copy(part.begin(), part.end(), origins.host().begin());
    origins.toDevice(0, count);
    commands.fill(counters.raw(), 0);
    splat(commands,
          SplatArguments{origins.address(), shared.position.address(slots(first)), taps.address(), counters.address(),
                         count, width, height, samples_per_pixel},
          slots(first));
    struct SumArguments {
      uint64_t taps, partials;
      uint32_t blocks;
    };
    commands.dispatch(sum, groupsFor(count * partialValues(pad, channels), kLocalSize),
                      SumArguments{taps.address(), partials.address(), count});
    commands.run();
    counters.toHost();
    non_finite += counters.host()[0].non_finite;
    if (const uint32_t bad = counters.host()[0].bad_shade) {
      throw Error(ErrorKind::Internal, "Film: " + std::to_string(bad) + " samples name no shading sample");
    }
    partials.toHost(0, count * partialValues(pad, channels));
    addPartials(planes, part);
  }
}

// One block after the other, so that a pixel's sum depends on the order of blocks and on nothing else.
void Film::Impl::addPartials(Planes& planes, std::span<const BlockOrigin> blocks) const {
  const int64_t padded = int64_t(paddedPixels(pad));
  const float* partial = partials.host().data();
  for (const BlockOrigin& block : blocks) {
    const int64_t left = int64_t(block.x) - pad, top = int64_t(block.y) - pad;
    const int64_t begin_x = std::max<int64_t>(left, 0), end_x = std::min<int64_t>(left + padded, width);
    const int64_t begin_y = std::max<int64_t>(top, 0), end_y = std::min<int64_t>(top + padded, height);
    for (std::vector<float>& plane : planes) {
      for (int64_t y = begin_y; y < end_y; ++y) {
        const float* from = partial + (y - top) * padded - left;
        float* to = plane.data() + y * width;
        for (int64_t x = begin_x; x < end_x; ++x) to[x] += from[x];
      }
      partial += padded * padded;
    }
  }
}

Film::Film(Device& device, uint32_t width, uint32_t height, FilterKind filter, float radius, uint32_t layers,
           uint32_t samples_per_pixel)
    : impl_(std::make_unique<Impl>(device, width, height, filter, radius, layers, samples_per_pixel)) {}
Film::~Film() = default;

void Film::addShared(std::span<const BlockOrigin> blocks, const FilmSamples& shared) {
  impl_->requireSlots(shared.normal.size(), blocks.size(), "normal");
  impl_->requireSlots(shared.coverage.size(), blocks.size(), "coverage");
  struct Arguments {
    SplatArguments common;
    uint64_t normal, coverage;
  };
  impl_->add(impl_->shared_sums, blocks, shared, impl_->sum_shared,
             [&](Commands& commands, const SplatArguments& common, uint64_t slot) {
               commands.dispatch(impl_->splat_shared, impl_->splatGroups(common.blocks),
                                 Arguments{common, shared.normal.address(slot), shared.coverage.address(slot)});
             });
}

void Film::addLayer(uint32_t layer, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                    const Buffer<Vec3f>& radiance) {
  impl_->requireSlots(aa.throughput.size(), blocks.size(), "throughput");
  impl_->requireSlots(aa.shade.size(), blocks.size(), "shade");
  if (layer >= impl_->layer_sums.size()) {
    throw Error(ErrorKind::Internal, "Film: there is no layer " + std::to_string(layer));
  }
  if (aa.samples_per_pixel != impl_->samples_per_pixel) {
    throw Error(ErrorKind::Internal, "Film: a layer with " + std::to_string(aa.samples_per_pixel) +
                                         " samples per pixel on a film of " + std::to_string(impl_->samples_per_pixel));
  }
  struct Arguments {
    SplatArguments common;
    uint64_t throughput, shade, radiance;
    uint32_t radiance_count;
  };
  impl_->add(impl_->layer_sums[layer], blocks, shared, impl_->sum_layer,
             [&](Commands& commands, const SplatArguments& common, uint64_t slot) {
               commands.dispatch(impl_->splat_layer, impl_->splatGroups(common.blocks),
                                 Arguments{common, aa.throughput.address(slot), aa.shade.address(slot),
                                           radiance.address(), uint32_t(radiance.size())});
             });
}

void Film::addDepth(uint32_t x, uint32_t y, float depth) {
  if (x >= impl_->width || y >= impl_->height) return;
  float& nearest = impl_->depth[size_t(y) * impl_->width + x];
  if (depth < nearest) nearest = depth;
}

FilmImages Film::resolve() const {
  const size_t pixels = impl_->depth.size();
  const std::vector<float>& weight = impl_->shared_sums[kWeight];
  // Where no sample reaches there is nothing.
  const auto divide = [&](const std::vector<float>& sum, size_t i) { return weight[i] != 0 ? sum[i] / weight[i] : 0; };
  const auto divide3 = [&](const Planes& sums, size_t i) {
    return Vec3f{divide(sums[0], i), divide(sums[1], i), divide(sums[2], i)};
  };
  FilmImages images;
  images.alpha.resize(pixels);
  images.normal.resize(pixels);
  images.composite.resize(pixels);
  images.depth = impl_->depth;
  images.layers.assign(impl_->layer_sums.size(), std::vector<Vec3f>(pixels));
  for (size_t i = 0; i < pixels; ++i) {
    images.alpha[i] = divide(impl_->shared_sums[kCoverage], i);
    images.normal[i] = divide3(impl_->shared_sums, i);
    for (size_t layer = 0; layer < images.layers.size(); ++layer) {
      images.layers[layer][i] = divide3(impl_->layer_sums[layer], i);
      images.composite[i] += images.layers[layer][i];
    }
  }
  return images;
}

uint64_t Film::nonFiniteSamples() const { return impl_->non_finite; }

uint64_t Film::partialBytes(uint64_t blocks, float radius) {
  const uint32_t pad = filterPad(checkedRadius(radius));
  const uint64_t values = tapValues(pad, kSharedChannels) + partialValues(pad, kSharedChannels);
  return std::min(blocks, chunkBlocks(pad)) * (values * sizeof(float) + sizeof(BlockOrigin)) + sizeof(Counters);
}

uint64_t Film::frameBytes(uint64_t pixels, uint32_t layers) {
  return pixels * sizeof(float) * (kSharedChannels + 1 + uint64_t(layers) * kLayerChannels);
}

}  // namespace encore
