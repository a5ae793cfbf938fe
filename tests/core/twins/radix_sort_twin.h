// What core/reuse/radix_sort.h must compute.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/reuse/radix_sort.h"

namespace encore::twin {

// The `bits` of a word, as the sort sees it.
inline uint32_t digitOf(uint32_t word, BitRange bits) {
  return bits.count == 0 ? 0 : uint32_t((uint64_t(word) >> bits.first) & ((1ull << bits.count) - 1));
}

// Sorts values by these bits of words[value * stride + offset].
inline void sortBy(std::vector<uint32_t>& values, const std::vector<uint32_t>& words, uint32_t stride, uint32_t offset,
                   BitRange bits) {
  const auto digit = [&](uint32_t value) { return digitOf(words[size_t(value) * stride + offset], bits); };
  std::stable_sort(values.begin(), values.end(), [&](uint32_t a, uint32_t b) { return digit(a) < digit(b); });
}

// Bits in which any two of the words at offset, offset + 2, … differ.
inline uint32_t varyingBits(const std::vector<uint32_t>& words, uint32_t offset) {
  uint32_t ones = 0, zeros = 0;
  for (size_t i = offset; i < words.size(); i += 2) {
    ones |= words[i];
    zeros |= ~words[i];
  }
  return ones & zeros;
}

}  // namespace encore::twin
