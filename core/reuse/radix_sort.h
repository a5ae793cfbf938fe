// Stable radix sort on the device: orders 32-bit values by one or more words of their keys.
#pragma once

#include <array>
#include <cstdint>

#include "core/reuse/scan.h"
#include "core/vulkan/device.h"

namespace encore {

inline constexpr uint32_t kMaxSortValues = 0x7fff0000u;

// Which bits of a word to sort by: bits below and above must be equal in all keys, or not matter.
struct BitRange {
  uint32_t first = 0, count = 0;
};
// The range from the lowest to the highest bit that is set.
BitRange bitRangeOf(uint32_t mask);

// Value v is sorted by the word at address + 4 * (v * stride + offset).
struct SortWord {
  uint64_t address = 0;
  uint32_t stride = 1, offset = 0;
};

// Least significant digit first: sort by the least significant word, then by the next. All passes are
// stable. Each invocation moves a run of consecutive values, which is the fastest way on a CPU device;
// no subgroup operations, no atomics.
class RadixSort {
 public:
  RadixSort(Device& device, Scan& scan);

  // Makes room for `count` values. Not between record*() and run().
  void reserve(uint32_t count);

  // Records: values become order[0 .. count) (a device address), or 0, 1, 2, … when order is 0.
  void recordStart(Commands& commands, uint32_t count, uint64_t order = 0);
  // Records: sorts the values by these bits of a word; equal ones stay in order.
  void recordBy(Commands& commands, uint32_t count, SortWord word, BitRange bits);
  // Records: copies the values to a device address.
  void recordCopy(Commands& commands, uint32_t count, uint64_t target);
  // Device address of the values as they stand after what was recorded so far.
  uint64_t values() const { return values_[current_].address(); }

  // Records: finds the bits in which any two of `count` two-word keys differ. result: 0 or 1.
  void recordVaryingBits(Commands& commands, uint64_t keys, uint32_t count, uint32_t result = 0);
  // What recordVaryingBits() found, after run(), for words 0 and 1 of the keys.
  std::array<uint32_t, 2> varyingBits(uint32_t result = 0);

  // Device bytes that reserve(count) takes, without the scan's; never less for a larger count.
  static uint64_t scratchBytes(uint64_t count);
  // Words of the longest scan that sorting takes.
  static uint64_t scanWords(uint64_t count);

 private:
  Device& device_;
  Scan& scan_;
  Kernel start_, gather_, bits_, count_, scatter_;
  Buffer<uint32_t> keys_[2], values_[2], counters_, varying_bits_;
  uint32_t current_ = 0;
};

}  // namespace encore
