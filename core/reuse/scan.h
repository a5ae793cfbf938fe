// Exclusive prefix sums of uint32 on the device: what sort, compaction and tree layout are made of.
#pragma once

#include <cstdint>

#include "core/vulkan/device.h"

namespace encore {

// Words that one scan can hold: kernels number words with 32 bits and round up to whole workgroups.
inline constexpr uint32_t kMaxScanWords = 0xffff0000u;

class Scan {
 public:
  explicit Scan(Device& device);

  // Makes room for scans of at most `count` words. Must not be called between record() and its run().
  void reserve(uint32_t count);
  // Records: words[i] = sum of words[0 .. i), modulo 2^32, in place. words: device address.
  // Throws Error(Internal) when count exceeds what was reserved.
  void record(Commands& commands, uint64_t words, uint32_t count);

  // Device bytes that reserve(count) takes.
  static uint64_t scratchBytes(uint64_t count);

 private:
  Device& device_;
  Kernel reduce_, apply_;
  Buffer<uint32_t> sums_;
};

}  // namespace encore
