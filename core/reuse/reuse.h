// Host side of the reuse kernels (§2.2, §2.3, §3.2, §3.3): what render_loop.cpp calls.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/vulkan/device.h"
#include "shaders/records.h"

namespace encore {

// Shading samples of one layer of one reuse tile, as a structure of arrays; a sample's id is its index.
// All buffers hold at least `count` elements. Keys must be valid (instance != kNoInstance).
struct ShadingSamples {
  uint32_t count = 0;
  Buffer<SurfaceKey> key;
  Buffer<Vec2f> uv;
};

// Antialiasing samples of one layer of one batch. Slots are ordered by (block, pixel in block, sample):
// slot = pixel_slot * samples_per_pixel + sample. Unused slots have kNoInstance and throughput 0.
struct AaSamples {
  uint32_t count = 0;
  uint32_t samples_per_pixel = 1;
  Buffer<SurfaceKey> key;
  Buffer<Vec2f> uv;
  Buffer<Vec3f> throughput;
  Buffer<uint32_t> shade;  // written by findNearest() and serveFailures()
};

// The trees of one layer: device buffers, made by ReuseKernels::buildTrees(). Layout in trees.h.
struct Trees;

class ReuseKernels {
 public:
  explicit ReuseKernels(Device& device);
  ~ReuseKernels();

  // One balanced 2D kd-tree per key, all built at once (§3.2). count may be 0.
  std::unique_ptr<Trees, void (*)(Trees*)> buildTrees(const ShadingSamples& samples);

  // Writes aa.shade: the id of the nearest shading sample in (u, v) with the same key, the lowest id of
  // several equally near; kShadeNotFound where the key has no sample; kShadeNone where it has kNoInstance.
  // Coordinates outside [0, 1]² count as the nearest point of it, and what is not a number as 0.
  void findNearest(const Trees& trees, AaSamples& aa);

  // Failures (§2.3, §3.3). Sorts slots with kShadeNotFound by (key, pixel, sample); returns the heads'
  // slots in ascending order, and gives every failed slot the index `first_shade` + position of its head.
  // share: false makes every failed sample its own head.
  std::vector<uint32_t> serveFailures(AaSamples& aa, uint32_t first_shade, bool share = true);

  // Device bytes that the trees of n samples, and the sort of n failures, take at most: for planning.
  static uint64_t treeBytes(uint64_t samples);
  static uint64_t failureBytes(uint64_t slots);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
