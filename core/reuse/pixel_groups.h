// Exact nearest neighbours of antialiasing samples among the shading samples of their primitive (§2.2), by groups:
// samples of one pixel on one primitive share the few candidates that can be nearest to any of them.
//
// Fastest where the samples of a pixel lie close together on their primitives; elsewhere samples search one by
// one. Either way exactly what ReuseKernels::findNearest() says.
#pragma once

#include <array>
#include <cstdint>

#include "core/reuse/reuse.h"
#include "core/reuse/sample_grid.h"
#include "core/vulkan/device.h"

namespace encore {

class PixelGroups {
 public:
  // What grids are best built and refined with for this search.
  static constexpr float kSamplesPerCell = 2;
  static constexpr uint32_t kMaxCell = 32;

  explicit PixelGroups(Device& device);
  // Records: writes aa.shade, as ReuseKernels::findNearest() says.
  void record(Commands& commands, const SampleGrid& grid, AaSamples& aa);

  // Device bytes of the refined grid of n samples, and of the scratch memory kept for building and refining it, at
  // most: without the sort's and the scan's.
  static uint64_t bytes(uint64_t samples);

 private:
  static constexpr uint32_t kMaxRoundBits = 4;
  const Kernel& groupedKernel(uint32_t samples_per_pixel, uint32_t& rounds);

  Device& device_;
  std::array<Kernel, kMaxRoundBits + 1> grouped_;  // [i]: 2^i samples per lane; made when first needed
};

}  // namespace encore
