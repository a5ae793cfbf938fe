// Splats batches on the device, adds the blocks' partial images into the tile, resolves finished pixels.
#include "core/film/film.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <string>

#include "core/film/tile_planes.h"
#include "core/scene/error.h"
#include "kernels/film/search_debug.h"
#include "kernels/film/splat_first.h"
#include "kernels/film/splat_layer.h"
#include "kernels/film/splat_values.h"
#include "kernels/film/sum_taps.h"

namespace encore {
namespace {

constexpr uint32_t kLayerChannels = 3;
constexpr uint32_t kFirstChannels = 8;  // layer 0, normal, coverage, filter weight
constexpr uint32_t kLocalSize = 64;
constexpr float kMaxRadius = 8;

// Planes of the tile. Those of the first kernel's channels come first, in its order.
enum Plane : uint32_t { kColor = 0, kNormal = 3, kCoverage = 6, kWeight = 7, kDepth = 8, kFurtherLayers = 9 };
uint32_t layerPlane(uint32_t layer) { return layer == 0 ? kColor : kFurtherLayers + (layer - 1) * kLayerChannels; }
// Per layer, behind those of all layers.
enum DebugPlane : uint32_t { kEvaluations, kReshaded, kDistance, kId, kDebugPlanes = kId + 3 };
uint32_t debugPlane(uint32_t layers, uint32_t layer) { return layerPlane(std::max(layers, 1u)) + layer * kDebugPlanes; }
uint32_t planeCount(uint32_t layers, bool debug) { return debugPlane(layers, debug ? layers : 0); }
// Behind those, of the aovs.
bool isFiltered(const Aov& aov) { return aov.kind == Aov::Kind::Primvar; }
bool isId(const Aov& aov) { return aov.kind >= Aov::Kind::PrimId; }
uint32_t componentsOf(const Aov& aov) { return isFiltered(aov) ? aov.components : isId(aov) ? 1 : 3; }
// EyeNormal follows from the normals.
uint32_t aovPlanes(const Aov& aov) { return aov.kind == Aov::Kind::EyeNormal ? 0 : componentsOf(aov); }
uint32_t aovPlanes(std::span<const Aov> aovs) {
  uint32_t planes = 0;
  for (const Aov& aov : aovs) planes += aovPlanes(aov);
  return planes;
}
// Planes keep the bits of ids: they are copied and never added.
float idBits(int32_t id) { return std::bit_cast<float>(id); }

// Blocks that are splatted at once: enough to fill a device, few enough for the taps to stay small.
constexpr uint64_t kMaxChunkBlocks = 256;
constexpr uint64_t kMaxTapBytes = 64ull << 20;

uint64_t tapsPerSide(uint32_t pad) { return 2 * uint64_t(pad) + 1; }
uint64_t paddedPixels(uint32_t pad) { return kBlockPixels + 2 * uint64_t(pad); }
uint64_t tapValues(uint32_t pad, uint32_t channels) {
  return tapsPerSide(pad) * channels * paddedPixels(pad) * kBlockPixels;
}
uint64_t partialValues(uint32_t pad, uint32_t channels) { return paddedPixels(pad) * paddedPixels(pad) * channels; }

uint64_t chunkBlocks(uint32_t pad) {
  const uint64_t fitting = kMaxTapBytes / (tapValues(pad, kFirstChannels) * sizeof(float));
  return std::clamp<uint64_t>(fitting, 1, kMaxChunkBlocks);
}

// Columns of taps per invocation: all of them while their sums fit into registers and first-level cache.
uint32_t tapColumns(uint32_t pad) { return pad <= 2 ? 2 * pad + 1 : 1; }

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
// RadianceArguments of shaders/film/radiance.glsl.
struct RadianceArguments {
  uint64_t throughput, shade, radiance;
  uint32_t radiance_count;
};

// Counters of shaders/film/splat.glsl.
struct Counters {
  uint32_t non_finite = 0, bad_shade = 0;
};

// Sums of one pixel over its slots, of shaders/film/search_debug.comp.
struct SearchSums {
  float surface, failed, distance;
  Vec3f id;
};
static_assert(sizeof(SearchSums) * kBlockArea <= kFirstChannels * kBlockArea * sizeof(float));  // they fit into taps

void requirePixels(size_t have, size_t blocks, const char* what) {
  if (have >= blocks * kBlockArea) return;
  throw Error(ErrorKind::Internal,
              "Film: " + std::to_string(have) + " " + what + " for " + std::to_string(blocks) + " blocks");
}

// Of no size where they do not meet.
PixelRect intersection(PixelRect a, PixelRect b) {
  const PixelRect both{std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1), std::min(a.y1, b.y1)};
  return both.x0 < both.x1 && both.y0 < both.y1 ? both : PixelRect{};
}

}  // namespace

struct Film::Impl {
  Impl(Device& owner, FilmArea film_area, FilterKind filter, float radius, uint32_t layer_count, uint32_t samples,
       bool keep_debug, std::span<const Aov> kept_aovs);

  TilePlanes partOf(size_t column, size_t row) const;
  void beginTile(PixelRect tile);
  void requireLayer(uint32_t layer) const;
  void requireAov(size_t aov, bool filtered, bool id) const;
  void requireBlocks(std::span<const BlockOrigin> blocks) const;
  void requireSlots(uint64_t have, size_t blocks, const char* what) const;
  void requireSamples(std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa) const;

  // Runs one batch, chunk by chunk. record(commands, blocks, first_slot) records the kernels, and
  // take(blocks) reads what they wrote.
  template <class Record, class Take>
  void run(std::span<const BlockOrigin> blocks, Record&& record, Take&& take);
  // The same for splats into `channels` planes from plane `first`; splat(commands, common, first_slot).
  template <class Splat>
  void add(uint32_t first, uint32_t channels, const Kernel& sum, std::span<const BlockOrigin> blocks,
           const FilmSamples& shared, Splat&& splat);
  void addPartials(uint32_t first, uint32_t channels, std::span<const BlockOrigin> blocks);
  void addPartialRows(uint32_t plane, const float* partial, uint64_t stride, std::span<const BlockOrigin> blocks,
                      int32_t y0, int32_t y1);
  void takeSearch(uint32_t layer, std::span<const BlockOrigin> blocks);
  void setAov(size_t aov, std::span<const BlockOrigin> blocks, uint32_t components, const float* values);
  void resolveRow(FilmImages& images, int32_t y);
  void resolveAov(AovImage& image, size_t aov, int32_t from_x, int32_t y, size_t to, size_t count);

  uint64_t splatGroups(uint64_t blocks) const {
    return groupsFor(blocks * kBlockPixels * (tapsPerSide(pad) / tapColumns(pad)), kLocalSize);
  }
  uint64_t slots(uint64_t blocks) const { return blocks * kBlockArea * samples_per_pixel; }
  TilePlanes& planes() { return columns[column]; }
  const TilePlanes& planes() const { return columns[column]; }
  const PixelRect& region() const { return planes().area(); }  // between the borders around the tile
  bool beyond(int32_t x, int32_t y) const { return x >= region().x1 || y >= region().y1; }
  uint32_t aovPlane(size_t aov) const { return planeCount(layers, debug) + aovPlanes(std::span(aovs).first(aov)); }

  Device& device;
  FilmArea area;
  uint32_t pad, layers, samples_per_pixel;
  bool debug;
  std::vector<Aov> aovs;
  Kernel splat_first, splat_layer, sum_first, sum_layer, search;
  std::array<Kernel, 5> splat_values, sum_values;  // by components, those that are needed
  Buffer<float> taps, partials;
  Buffer<BlockOrigin> origins;
  Buffer<Counters> counters;
  std::vector<TilePlanes> columns;  // of the row of tiles in work, between two borders each
  std::vector<size_t> rows_begun;   // of each column
  size_t column = 0;                // of the tile in work
  uint64_t non_finite = 0;
};

namespace {

std::vector<float> initialPlanes(uint32_t layers, bool debug, std::span<const Aov> aovs) {
  std::vector<float> initial(planeCount(layers, debug), 0.0f);
  initial[kDepth] = std::numeric_limits<float>::infinity();
  for (const Aov& aov : aovs) initial.insert(initial.end(), aovPlanes(aov), isId(aov) ? idBits(-1) : 0.0f);
  return initial;
}

}  // namespace

Film::Impl::Impl(Device& owner, FilmArea film_area, FilterKind filter, float radius, uint32_t layer_count,
                 uint32_t samples, bool keep_debug, std::span<const Aov> kept_aovs)
    : device(owner),
      area(std::move(film_area)),
      pad(filterPad(checkedRadius(radius))),
      layers(layer_count),
      samples_per_pixel(samples),
      debug(keep_debug),
      aovs(kept_aovs.begin(), kept_aovs.end()),
      rows_begun(area.columns.size() - 1) {
  for (size_t c = 0; c + 1 < area.columns.size(); ++c) columns.push_back(partOf(c, 0));
  uint32_t splat_constants[] = {uint32_t(filter),
                                std::bit_cast<uint32_t>(radius),
                                std::bit_cast<uint32_t>(1.0f / radius),
                                pad,
                                tapColumns(pad),
                                0};
  splat_first = Kernel(device, "splat_first", kSplatFirstSpirv, splat_constants);
  splat_layer = Kernel(device, "splat_layer", kSplatLayerSpirv, splat_constants);
  sum_first = Kernel(device, "sum_taps", kSumTapsSpirv, {{pad, kFirstChannels}});
  sum_layer = Kernel(device, "sum_taps", kSumTapsSpirv, {{pad, kLayerChannels}});
  if (debug) search = Kernel(device, "search_debug", kSearchDebugSpirv);
  for (const Aov& aov : aovs) {
    const uint32_t components = isFiltered(aov) ? componentsOf(aov) : 0;
    if (components == 0 || sum_values[components].impl()) continue;
    splat_constants[5] = components;
    splat_values[components] = Kernel(device, "splat_values", kSplatValuesSpirv, splat_constants);
    sum_values[components] = Kernel(device, "sum_taps", kSumTapsSpirv, {{pad, components}});
  }
  counters = Buffer<Counters>(device, 1, "film counters");
}

TilePlanes Film::Impl::partOf(size_t c, size_t row) const {
  return {{area.columns[c], area.rows[row], area.columns[c + 1], area.rows[row + 1]},
          pad,
          initialPlanes(layers, debug, aovs)};
}

// What lies between two borders begins with the tile in its upper left corner.
void Film::Impl::beginTile(PixelRect tile) {
  if (planes().active()) throw Error(ErrorKind::Internal, "Film: the tile before is not finished");
  while (column > 0 && tile.x0 < area.columns[column]) --column;
  while (column + 1 < columns.size() && tile.x0 >= area.columns[column + 1]) ++column;
  size_t& rows = rows_begun[column];
  if (rows > 0 && rows + 1 < area.rows.size() && tile.y0 == area.rows[rows] && tile.x0 == area.columns[column])
    columns[column] = partOf(column, rows);
  columns[column].begin(tile);
  if (tile.y0 == area.rows[rows]) ++rows;
}

void Film::Impl::requireAov(size_t aov, bool filtered, bool id) const {
  if (aov < aovs.size() && aovPlanes(aovs[aov]) && isFiltered(aovs[aov]) == filtered && isId(aovs[aov]) == id) return;
  throw Error(ErrorKind::Internal, "Film: aov " + std::to_string(aov) + " is not there, or of another kind");
}

void Film::Impl::requireLayer(uint32_t layer) const {
  if (layer >= layers) throw Error(ErrorKind::Internal, "Film: there is no layer " + std::to_string(layer));
}

void Film::Impl::requireBlocks(std::span<const BlockOrigin> blocks) const {
  if (!planes().active()) throw Error(ErrorKind::Internal, "Film: no tile was begun");
  const PixelRect& tile = planes().tile();
  const auto within = [](int32_t at, int32_t begin, int32_t end, int32_t border) {
    return at >= begin && at < end && (end == border || at + int32_t(kBlockPixels) <= end);
  };
  for (const BlockOrigin& block : blocks) {
    if (within(block.x, tile.x0, tile.x1, region().x1) && within(block.y, tile.y0, tile.y1, region().y1)) continue;
    throw Error(ErrorKind::Internal, "Film: the block at (" + std::to_string(block.x) + ", " + std::to_string(block.y) +
                                         ") is not within the current tile");
  }
}

void Film::Impl::requireSlots(uint64_t have, size_t blocks, const char* what) const {
  if (have >= slots(blocks)) return;
  throw Error(ErrorKind::Internal, std::string("Film: ") + what + " has " + std::to_string(have) + " slots for " +
                                       std::to_string(blocks) + " blocks that need " + std::to_string(slots(blocks)));
}

void Film::Impl::requireSamples(std::span<const BlockOrigin> blocks, const FilmSamples& shared,
                                const AaSamples& aa) const {
  requireBlocks(blocks);
  requireSlots(shared.position.size(), blocks.size(), "position");
  requireSlots(aa.throughput.size(), blocks.size(), "throughput");
  requireSlots(aa.shade.size(), blocks.size(), "shade");
  if (aa.samples_per_pixel != samples_per_pixel) {
    throw Error(ErrorKind::Internal, "Film: a layer with " + std::to_string(aa.samples_per_pixel) +
                                         " samples per pixel on a film of " + std::to_string(samples_per_pixel));
  }
}

template <class Record, class Take>
void Film::Impl::run(std::span<const BlockOrigin> blocks, Record&& record, Take&& take) {
  const uint64_t chunk = std::min<uint64_t>(chunkBlocks(pad), blocks.size());
  taps.reserve(device, chunk * tapValues(pad, kFirstChannels), "film taps");
  partials.reserve(device, chunk * partialValues(pad, kFirstChannels), "film partials");
  origins.reserve(device, chunk, "film blocks");
  Commands commands(device);
  for (uint64_t first = 0; first < blocks.size(); first += chunk) {
    const auto part = blocks.subspan(first, std::min<uint64_t>(chunk, blocks.size() - first));
    std::transform(part.begin(), part.end(), origins.host().begin(),
                   [&](BlockOrigin block) { return BlockOrigin{block.x - region().x0, block.y - region().y0}; });
    origins.toDevice(0, part.size());
    commands.fill(counters.raw(), 0);
    record(commands, part, slots(first));
    commands.run();
    counters.toHost();
    non_finite += counters.host()[0].non_finite;
    if (const uint32_t bad = counters.host()[0].bad_shade) {
      throw Error(ErrorKind::Internal, "Film: " + std::to_string(bad) + " samples name no shading sample");
    }
    take(part);
  }
}

template <class Splat>
void Film::Impl::add(uint32_t first, uint32_t channels, const Kernel& sum, std::span<const BlockOrigin> blocks,
                     const FilmSamples& shared, Splat&& splat) {
  struct SumArguments {
    uint64_t taps, partials;
    uint32_t blocks;
  };
  const auto record = [&](Commands& commands, std::span<const BlockOrigin> part, uint64_t slot) {
    const uint32_t count = uint32_t(part.size());
    splat(commands,
          SplatArguments{origins.address(), shared.position.address(slot), taps.address(), counters.address(), count,
                         region().width(), region().height(), samples_per_pixel},
          slot);
    commands.dispatch(sum, groupsFor(count * partialValues(pad, channels), kLocalSize),
                      SumArguments{taps.address(), partials.address(), count});
  };
  run(blocks, record, [&](std::span<const BlockOrigin> part) {
    partials.toHost(0, part.size() * partialValues(pad, channels));
    addPartials(first, channels, part);
  });
}

// One block after the other, so that a pixel's sum depends on the order of blocks and on nothing else.
void Film::Impl::addPartials(uint32_t first, uint32_t channels, std::span<const BlockOrigin> blocks) {
  const int32_t band_rows = 4 * kBlockPixels;
  const PixelRect& reach = planes().reach();
  const uint32_t bands = (reach.height() + uint32_t(band_rows) - 1) / uint32_t(band_rows);
  tbb::parallel_for(0u, channels * bands, [&](uint32_t task) {
    const uint32_t channel = task % channels;
    const int32_t y0 = reach.y0 + int32_t(task / channels) * band_rows;
    addPartialRows(first + channel, partials.host().data() + channel * partialValues(pad, 1),
                   partialValues(pad, channels), blocks, y0, std::min(y0 + band_rows, reach.y1));
  });
}

// Rows [y0, y1) of one plane. partial: its values of the first block; stride: from block to block.
void Film::Impl::addPartialRows(uint32_t plane, const float* partial, uint64_t stride,
                                std::span<const BlockOrigin> blocks, int32_t y0, int32_t y1) {
  const int32_t padded = int32_t(paddedPixels(pad)), reaches = int32_t(pad);
  const PixelRect& reach = planes().reach();
  for (const BlockOrigin& block : blocks) {
    const int32_t left = block.x - reaches, top = block.y - reaches;
    const int32_t begin_x = std::max(left, reach.x0), end_x = std::min(left + padded, reach.x1);
    const int32_t end_y = std::min(top + padded, y1);
    for (int32_t y = std::max(top, y0); y < end_y; ++y) {
      const float* from = partial + (y - top) * padded + (begin_x - left);
      float* to = &planes().at(plane, begin_x, y);
      for (int32_t i = 0; i < end_x - begin_x; ++i) to[i] += from[i];
    }
    partial += stride;
  }
}

void Film::Impl::takeSearch(uint32_t layer, std::span<const BlockOrigin> blocks) {
  taps.toHost(0, blocks.size() * kBlockArea * (sizeof(SearchSums) / sizeof(float)));
  const SearchSums* sums = reinterpret_cast<const SearchSums*>(taps.host().data());
  const uint32_t plane = debugPlane(layers, layer);
  for (const BlockOrigin& block : blocks) {
    for (uint32_t pixel = 0; pixel < kBlockArea; ++pixel, ++sums) {
      const int32_t x = block.x + int32_t(pixel % kBlockPixels), y = block.y + int32_t(pixel / kBlockPixels);
      if (beyond(x, y)) continue;
      const float found = sums->surface - sums->failed;
      planes().at(plane + kReshaded, x, y) = sums->surface > 0 ? sums->failed / sums->surface : 0;
      planes().at(plane + kDistance, x, y) = found > 0 ? sums->distance / found : 0;
      for (uint32_t c = 0; c < 3; ++c) {
        planes().at(plane + kId + c, x, y) = sums->id[int(c)] / float(samples_per_pixel);
      }
    }
  }
}

Film::Film(Device& device, FilmArea area, FilterKind filter, float radius, uint32_t layers, uint32_t samples_per_pixel,
           bool debug, std::span<const Aov> aovs)
    : impl_(std::make_unique<Impl>(device, std::move(area), filter, radius, layers, samples_per_pixel, debug, aovs)) {}
Film::~Film() = default;

void Film::beginTile(PixelRect tile) { impl_->beginTile(tile); }

void Film::addFirstLayer(std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                         const Buffer<Vec3f>& radiance) {
  impl_->requireLayer(0);
  impl_->requireSamples(blocks, shared, aa);
  impl_->requireSlots(shared.normal.size(), blocks.size(), "normal");
  impl_->requireSlots(shared.coverage.size(), blocks.size(), "coverage");
  struct Arguments {
    SplatArguments common;
    RadianceArguments radiance;
    uint64_t normal, coverage;
  };
  impl_->add(kColor, kFirstChannels, impl_->sum_first, blocks, shared,
             [&](Commands& commands, const SplatArguments& common, uint64_t slot) {
               commands.dispatch(impl_->splat_first, impl_->splatGroups(common.blocks),
                                 Arguments{common,
                                           {aa.throughput.address(slot), aa.shade.address(slot), radiance.address(),
                                            uint32_t(radiance.size())},
                                           shared.normal.address(slot),
                                           shared.coverage.address(slot)});
             });
}

void Film::addLayer(uint32_t layer, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                    const Buffer<Vec3f>& radiance) {
  impl_->requireLayer(layer);
  impl_->requireSamples(blocks, shared, aa);
  struct Arguments {
    SplatArguments common;
    RadianceArguments radiance;
  };
  impl_->add(layerPlane(layer), kLayerChannels, impl_->sum_layer, blocks, shared,
             [&](Commands& commands, const SplatArguments& common, uint64_t slot) {
               commands.dispatch(impl_->splat_layer, impl_->splatGroups(common.blocks),
                                 Arguments{common,
                                           {aa.throughput.address(slot), aa.shade.address(slot), radiance.address(),
                                            uint32_t(radiance.size())}});
             });
}

void Film::addDepth(std::span<const BlockOrigin> blocks, std::span<const float> depth) {
  impl_->requireBlocks(blocks);
  requirePixels(depth.size(), blocks.size(), "depths");
  for (const BlockOrigin& block : blocks) {
    for (uint32_t pixel = 0; pixel < kBlockArea; ++pixel) {
      const int32_t x = block.x + int32_t(pixel % kBlockPixels), y = block.y + int32_t(pixel / kBlockPixels);
      if (impl_->beyond(x, y)) continue;
      float& nearest = impl_->planes().at(kDepth, x, y);
      if (depth[pixel] < nearest) nearest = depth[pixel];
    }
    depth = depth.subspan(kBlockArea);
  }
}

void Film::addSearch(uint32_t layer, std::span<const BlockOrigin> blocks, const AaSamples& aa,
                     const Buffer<Vec2f>& uv) {
  if (!impl_->debug) return;
  impl_->requireLayer(layer);
  impl_->requireBlocks(blocks);
  impl_->requireSlots(aa.shade.size(), blocks.size(), "shade");
  impl_->requireSlots(aa.uv.size(), blocks.size(), "uv");
  struct Arguments {
    uint64_t origins, shade, aa_uv, uv, sums, counters;
    uint32_t blocks, width, height, samples_per_pixel, uv_count;
  };
  const auto record = [&](Commands& commands, std::span<const BlockOrigin> part, uint64_t slot) {
    const uint32_t count = uint32_t(part.size());
    commands.dispatch(impl_->search, groupsFor(count * kBlockArea, kLocalSize),
                      Arguments{impl_->origins.address(), aa.shade.address(slot), aa.uv.address(slot), uv.address(),
                                impl_->taps.address(), impl_->counters.address(), count, impl_->region().width(),
                                impl_->region().height(), impl_->samples_per_pixel, uint32_t(uv.size())});
  };
  impl_->run(blocks, record, [&](std::span<const BlockOrigin> part) { impl_->takeSearch(layer, part); });
}

void Film::addAov(size_t aov, std::span<const BlockOrigin> blocks, const FilmSamples& shared,
                  const Buffer<float>& values) {
  impl_->requireAov(aov, true, false);
  impl_->requireBlocks(blocks);
  const uint32_t components = componentsOf(impl_->aovs[aov]);
  impl_->requireSlots(shared.position.size(), blocks.size(), "position");
  impl_->requireSlots(values.size() / components, blocks.size(), "an aov");
  struct Arguments {
    SplatArguments common;
    uint64_t values;
  };
  impl_->add(impl_->aovPlane(aov), components, impl_->sum_values[components], blocks, shared,
             [&](Commands& commands, const SplatArguments& common, uint64_t slot) {
               commands.dispatch(impl_->splat_values[components], impl_->splatGroups(common.blocks),
                                 Arguments{common, values.address(slot * components)});
             });
}

void Film::Impl::setAov(size_t aov, std::span<const BlockOrigin> blocks, uint32_t components, const float* values) {
  const uint32_t plane = aovPlane(aov);
  for (const BlockOrigin& block : blocks)
    for (uint32_t pixel = 0; pixel < kBlockArea; ++pixel, values += components) {
      const int32_t x = block.x + int32_t(pixel % kBlockPixels), y = block.y + int32_t(pixel / kBlockPixels);
      if (beyond(x, y)) continue;
      for (uint32_t c = 0; c < components; ++c) planes().at(plane + c, x, y) = values[c];
    }
}

void Film::setAov(size_t aov, std::span<const BlockOrigin> blocks, std::span<const float> values) {
  impl_->requireAov(aov, false, false);
  impl_->requireBlocks(blocks);
  const uint32_t components = componentsOf(impl_->aovs[aov]);
  requirePixels(values.size() / components, blocks.size(), "values");
  std::vector<float> finite(values.begin(), values.end());
  for (size_t i = 0; i < finite.size(); i += components) {
    const std::span<float> value = std::span(finite).subspan(i, components);
    if (std::all_of(value.begin(), value.end(), [](float v) { return std::isfinite(v); })) continue;
    std::fill(value.begin(), value.end(), 0.0f);
    ++impl_->non_finite;
  }
  impl_->setAov(aov, blocks, components, finite.data());
}

void Film::setAov(size_t aov, std::span<const BlockOrigin> blocks, std::span<const int32_t> ids) {
  impl_->requireAov(aov, false, true);
  impl_->requireBlocks(blocks);
  requirePixels(ids.size(), blocks.size(), "ids");
  std::vector<float> bits(ids.size());
  std::transform(ids.begin(), ids.end(), bits.begin(), idBits);
  impl_->setAov(aov, blocks, 1, bits.data());
}

void Film::addEvaluation(uint32_t layer, int32_t x, int32_t y) {
  if (!impl_->debug || impl_->beyond(x, y)) return;
  impl_->requireLayer(layer);
  const PixelRect& tile = impl_->planes().tile();
  if (!impl_->planes().active() || x < tile.x0 || x >= tile.x1 || y < tile.y0 || y >= tile.y1) {
    throw Error(ErrorKind::Internal, "Film: an evaluation in pixel (" + std::to_string(x) + ", " + std::to_string(y) +
                                         "), which is not within the current tile");
  }
  impl_->planes().at(debugPlane(impl_->layers, layer) + kEvaluations, x, y) += 1;
}

// Pixels [from_x, ...) of row y, to pixel `to` of the image and those that follow.
void Film::Impl::resolveAov(AovImage& image, size_t aov, int32_t from_x, int32_t y, size_t to, size_t count) {
  const uint32_t plane = aovPlane(aov), components = aovPlanes(aovs[aov]);
  const size_t from = size_t(from_x - planes().reach().x0);
  const std::span<const float> weight = planes().row(kWeight, y).subspan(from, count);
  for (uint32_t c = 0; c < components; ++c) {
    const std::span<const float> row = planes().row(plane + c, y).subspan(from, count);
    for (size_t i = 0; i < count; ++i) {
      if (isId(aovs[aov]))
        image.ids[to + i] = std::bit_cast<int32_t>(row[i]);
      else if (!isFiltered(aovs[aov]))
        image.values[(to + i) * components + c] = row[i];
      else
        image.values[(to + i) * components + c] = weight[i] != 0 ? row[i] / weight[i] : 0;
    }
  }
}

void Film::Impl::resolveRow(FilmImages& images, int32_t y) {
  const PixelRect& rect = images.rect;
  const std::span<const float> weight = planes().row(kWeight, y);
  const auto value = [&](uint32_t plane, size_t i) { return planes().row(plane, y)[i]; };
  // Where no sample reaches there is nothing.
  const auto divide = [&](uint32_t plane, size_t i) { return weight[i] != 0 ? value(plane, i) / weight[i] : 0; };
  const auto divide3 = [&](uint32_t plane, size_t i) {
    return Vec3f{divide(plane, i), divide(plane + 1, i), divide(plane + 2, i)};
  };
  const size_t row_begin = size_t(y - rect.y0) * rect.width();
  for (size_t aov = 0; aov < aovs.size(); ++aov) resolveAov(images.aovs[aov], aov, rect.x0, y, row_begin, rect.width());
  for (int32_t x = rect.x0; x < rect.x1; ++x) {
    const size_t from = size_t(x - planes().reach().x0), to = row_begin + size_t(x - rect.x0);
    images.alpha[to] = divide(kCoverage, from);
    images.normal[to] = divide3(kNormal, from);
    images.depth[to] = value(kDepth, from);
    for (uint32_t layer = 0; layer < layers; ++layer) {
      images.layers[layer][to] = divide3(layerPlane(layer), from);
      images.composite[to] += images.layers[layer][to];
    }
    for (uint32_t layer = 0; layer < images.debug.size(); ++layer) {
      const uint32_t plane = debugPlane(layers, layer);
      DebugImages& shown = images.debug[layer];
      shown.evaluations[to] = value(plane + kEvaluations, from);
      shown.reshaded[to] = value(plane + kReshaded, from);
      shown.distance[to] = value(plane + kDistance, from);
      shown.id[to] = {value(plane + kId, from), value(plane + kId + 1, from), value(plane + kId + 2, from)};
    }
  }
}

FilmImages Film::finishTile() {
  FilmImages images;
  images.rect = intersection(impl_->planes().finish(), impl_->area.window);
  const size_t pixels = images.rect.area();
  images.alpha.resize(pixels);
  images.normal.resize(pixels);
  images.depth.resize(pixels);
  images.composite.resize(pixels);
  images.layers.resize(impl_->layers);
  for (std::vector<Vec3f>& layer : images.layers) layer.resize(pixels);
  images.debug.resize(impl_->debug ? impl_->layers : 0);
  for (DebugImages& debug : images.debug) {
    debug.evaluations.resize(pixels);
    debug.reshaded.resize(pixels);
    debug.distance.resize(pixels);
    debug.id.resize(pixels);
  }
  for (const Aov& aov : impl_->aovs) {
    AovImage& image = images.aovs.emplace_back();
    image.components = componentsOf(aov);
    (isId(aov) ? image.ids.resize(pixels) : image.values.resize(pixels * aovPlanes(aov)));
  }
  tbb::parallel_for(images.rect.y0, images.rect.y1, [&](uint32_t y) { impl_->resolveRow(images, y); });
  return images;
}

uint64_t Film::nonFiniteSamples() const { return impl_->non_finite; }

uint64_t Film::partialBytes(uint64_t blocks, float radius) {
  const uint32_t pad = filterPad(checkedRadius(radius));
  const uint64_t values = tapValues(pad, kFirstChannels) + partialValues(pad, kFirstChannels);
  return std::min(blocks, chunkBlocks(pad)) * (values * sizeof(float) + sizeof(BlockOrigin)) + sizeof(Counters);
}

uint64_t Film::tileBytes(PixelRect tile, uint32_t image_width, float radius, uint32_t layers, bool debug) {
  const FilmArea area{{0, int32_t(image_width)}, {0, tile.y1}, {0, 0, int32_t(image_width), tile.y1}};
  return areaBytes(area, tile, radius, layers, debug, {});
}

uint64_t Film::areaBytes(const FilmArea& area, PixelRect tile, float radius, uint32_t layers, bool debug,
                         std::span<const Aov> aovs) {
  const uint32_t pad = filterPad(checkedRadius(radius));
  uint64_t planes_bytes = 0, image_bytes = 0;
  const uint64_t debug_bytes = debug ? layers * (3 * sizeof(float) + sizeof(Vec3f)) : 0;
  uint64_t pixel_bytes = (layers + 2) * sizeof(Vec3f) + 2 * sizeof(float) + debug_bytes;
  for (const Aov& aov : aovs) pixel_bytes += componentsOf(aov) * sizeof(float);
  for (size_t c = 0; c + 1 < area.columns.size(); ++c) {
    const uint32_t width = uint32_t(area.columns[c + 1] - area.columns[c]);
    planes_bytes += TilePlanes::bytes(tile, width, pad, planeCount(layers, debug) + aovPlanes(aovs));
    // Finished pixels reach into the tiles before, and never beyond the tile.
    const uint64_t columns = std::min<uint64_t>(tile.width() + uint64_t(pad), width);
    image_bytes = std::max(image_bytes, columns * (tile.height() + uint64_t(pad)) * pixel_bytes);
  }
  return planes_bytes + image_bytes;
}

}  // namespace encore
