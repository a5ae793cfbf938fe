// Finds where a word occurs in an array on the device, in ascending order.
#pragma once

#include <cstdint>

#include "core/reuse/scan.h"
#include "core/vulkan/device.h"

namespace encore {

class Compaction {
 public:
  Compaction(Device& device, Scan& scan);

  // Makes room for arrays of `count` words. Not between record*() and run().
  void reserve(uint32_t count);
  // Records the first half: counts the occurrences of `wanted` in words[0 .. count) (a device address).
  void recordCount(Commands& commands, uint64_t words, uint32_t count, uint32_t wanted);
  // How many there are, after run().
  uint32_t matches(uint32_t count);
  // Records the second half for the same words: places[0 .. matches) = indices of the occurrences.
  void recordWrite(Commands& commands, uint64_t words, uint32_t count, uint32_t wanted, uint64_t places);

  // Device bytes that reserve(count) takes, without the scan's.
  static uint64_t scratchBytes(uint64_t count);
  static uint64_t scanWords(uint64_t count);

 private:
  Device& device_;
  Scan& scan_;
  Kernel count_, write_;
  Buffer<uint32_t> starts_;
};

}  // namespace encore
