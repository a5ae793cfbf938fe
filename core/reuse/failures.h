// Groups antialiasing samples that found no neighbour by key and pixel, or by key and cell, and serves them
// (§2.3, §3.3).
//
// Where the paper sorts, this enters the samples into a hash table that keeps the first of each group: a group
// lies within one pixel or block, and nothing but its head is asked for. It is the same answer, at a fraction of
// the cost where all samples fail.
#pragma once

#include <cstdint>
#include <vector>

#include "core/reuse/compaction.h"
#include "core/reuse/reuse.h"
#include "core/reuse/scan.h"
#include "core/vulkan/device.h"

namespace encore {

class Failures {
 public:
  Failures(Device& device, Scan& scan, Compaction& compaction);
  // As ReuseKernels::serveFailures() says.
  std::vector<uint32_t> serve(AaSamples& aa, uint32_t first_shade, ReuseKernels::Share share);

  // Device bytes of the scratch memory for n slots at most, without the scan's and the compaction's.
  static uint64_t scratchBytes(uint64_t slots);
  // Words of the longest scan.
  static uint64_t scanWords(uint64_t slots) { return slots + 1; }

 private:
  struct Grouping;
  std::vector<uint32_t> serveEach(AaSamples& aa, uint32_t first_shade);
  std::vector<uint32_t> serveGroups(AaSamples& aa, uint32_t first_shade, const Grouping& by);
  // Cuts the failed samples into runs of one group; returns how many.
  uint32_t cutIntoRuns(const AaSamples& aa, const Grouping& by);
  // Looks up the groups of the runs, and finds their shades.
  void recordGroups(Commands& commands, const Grouping& by, uint32_t runs, uint32_t first_shade);

  Device& device_;
  Scan& scan_;
  Compaction& compaction_;
  Kernel count_kernel_, runs_kernel_, insert_kernel_, heads_kernel_, groups_kernel_, serve_kernel_, number_kernel_;
  Buffer<uint32_t> starts_;                                   // per stretch of slots
  Buffer<uint32_t> run_slots_, places_, ranks_, head_slots_;  // per run
  Buffer<uint32_t> table_;
};

}  // namespace encore
