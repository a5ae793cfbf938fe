// Groups antialiasing samples that found no neighbour by key and pixel, and serves them (§2.3, §3.3).
#pragma once

#include <cstdint>
#include <vector>

#include "core/reuse/compaction.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/reuse.h"
#include "core/reuse/scan.h"
#include "core/vulkan/device.h"

namespace encore {

class Failures {
 public:
  Failures(Device& device, Scan& scan, RadixSort& sort, Compaction& compaction);
  // As ReuseKernels::serveFailures() says.
  std::vector<uint32_t> serve(AaSamples& aa, uint32_t first_shade, bool share);

  // Device bytes of the scratch memory for n failures at most, without the sort's and the scan's.
  static uint64_t scratchBytes(uint64_t failures);

 private:
  // Lists the slots with kShadeNotFound and their keys; returns how many.
  uint32_t list(const AaSamples& aa);
  void reserve(uint32_t failures);
  void recordSort(Commands& commands, uint32_t failures);
  void recordGroups(Commands& commands, uint32_t failures, uint32_t samples_per_pixel);

  Device& device_;
  Scan& scan_;
  RadixSort& sort_;
  Compaction& compaction_;
  Kernel keys_kernel_, heads_kernel_, groups_kernel_, serve_kernel_;
  Buffer<uint32_t> failed_, groups_, ranks_, group_ranks_, head_slots_;
  Buffer<SurfaceKey> keys_;
};

}  // namespace encore
