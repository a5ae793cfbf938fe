// What core/reuse/compaction.h must compute.
#pragma once

#include <cstdint>
#include <vector>

namespace encore::twin {

inline std::vector<uint32_t> placesOf(const std::vector<uint32_t>& words, uint32_t wanted) {
  std::vector<uint32_t> places;
  for (uint32_t i = 0; i < words.size(); ++i) {
    if (words[i] == wanted) places.push_back(i);
  }
  return places;
}

}  // namespace encore::twin
