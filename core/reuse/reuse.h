// Host side of the reuse kernels (§2.2, §2.3, §3.2, §3.3): what render_loop.cpp calls.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/scene/settings.h"
#include "core/vulkan/device.h"
#include "shaders/records.h"

namespace encore {

// Shading samples of one layer of one reuse tile, as a structure of arrays; a sample's id is its index.
// All buffers hold at least `count` elements. Keys must be valid (instance != kNoInstance).
struct ShadingSamples {
  uint32_t count = 0;
  Buffer<SurfaceKey> key;
  Buffer<Vec2f> uv;
  Buffer<float> footprint;  // r of §2.4, only where the metric is in force
  Buffer<Vec4f> aspect;     // further coordinates (§5: time and direction), only where they are part of the distance
};

// Antialiasing samples of one layer of one batch. Slots are ordered by (block, pixel in block, sample):
// slot = pixel_slot * samples_per_pixel + sample. Unused slots have kNoInstance and throughput 0.
struct AaSamples {
  uint32_t count = 0;
  uint32_t samples_per_pixel = 1;
  Buffer<SurfaceKey> key;
  Buffer<Vec2f> uv;
  Buffer<float> footprint;  // r of §2.4, only where the metric or a distance limit is in force
  Buffer<Vec4f> aspect;     // as ShadingSamples'
  Buffer<Vec3f> throughput;
  Buffer<uint32_t> cell;   // what failures are grouped by besides their key, only where it is not the pixel
  Buffer<uint32_t> shade;  // written by findNearest() and serveFailures()
};

// What one layer of one reuse tile is searched by: trees, grids or lists of candidates, and the samples in their
// order. Made by ReuseKernels::buildIndex().
struct SearchIndex;
using SearchIndexPointer = std::unique_ptr<SearchIndex, void (*)(SearchIndex*)>;

class ReuseKernels {
 public:
  explicit ReuseKernels(Device& device);
  ~ReuseKernels();

  // search: not Auto. footprint_weight: c of the metric of §2.4, up to 1e6; above 0 only with Search::Tree, and
  // then samples.footprint is read. With Search::Tree, samples.aspect is part of the distance if it is not empty, and
  // has to stay as it is until the last search. samples.count may be 0. Throws Error(Internal) when that does not
  // hold.
  SearchIndexPointer buildIndex(const ShadingSamples& samples, Search search, float footprint_weight = 0);

  // Writes aa.shade: the id of the nearest shading sample in (u, v), or in the metric, with the same key, the
  // lowest id of several equally near; kShadeNotFound where the key has no sample; kShadeNone where it has
  // kNoInstance. Coordinates outside [0, 1]² count as the nearest point of it, and what is not a number as 0.
  // With aspects, squared distances are those of (u, v), plus those of the aspects, the metric's part between them.
  // Footprints are clamped to [2^-60, 2^60], and what is not a number counts as the lower end.
  // The result does not depend on how the index searches.
  void findNearest(const SearchIndex& index, AaSamples& aa);

  // Distance limit: aa.shade becomes kShadeNotFound where |aa.uv - samples.uv[shade]| > limit * aa.footprint.
  // limit: in footprints, above 0. samples: what the index was built from. Coordinates and footprints count as in
  // findNearest(): a sample whose footprint is 0, negative or not a number keeps only a neighbour that lies where
  // it does (to within limit * 2^-60). Shades that are not indices into samples stay.
  void limitDistance(const ShadingSamples& samples, AaSamples& aa, float limit);

  // Failures (§2.3, §3.3). Groups slots with kShadeNotFound; the lowest slot of a group is its head. Returns the
  // heads' slots in ascending order, and gives every failed slot the index `first_shade` + position of its head.
  // Groups do not depend on how blocks are cut into batches.
  enum class Share {
    Nothing,  // every failed sample is its own head
    InPixel,  // those of equal key in one pixel share
    InCell,   // those of equal key and aa.cell in one block share
  };
  std::vector<uint32_t> serveFailures(AaSamples& aa, uint32_t first_shade, Share share = Share::InPixel);

  // Device bytes that the index of n samples and the scratch memory to build it, and serving n failures, take at
  // most: for planning. search: Auto: whichever is chosen.
  static uint64_t indexBytes(uint64_t samples, Search search);
  static uint64_t failureBytes(uint64_t slots);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
