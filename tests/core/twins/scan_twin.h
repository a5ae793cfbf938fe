// What core/reuse/scan.h must compute.
#pragma once

#include <cstdint>
#include <numeric>
#include <vector>

namespace encore::twin {

inline std::vector<uint32_t> exclusiveScan(const std::vector<uint32_t>& words) {
  std::vector<uint32_t> sums(words.size());
  std::exclusive_scan(words.begin(), words.end(), sums.begin(), 0u);
  return sums;
}

}  // namespace encore::twin
