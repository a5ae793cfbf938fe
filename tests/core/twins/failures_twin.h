// What core/reuse/failures.h must compute, as §2.3 tells it: go through the samples one by one, with a table of what
// has been shaded.
#pragma once

#include <cstdint>
#include <map>
#include <tuple>
#include <vector>

#include "core/reuse/reuse.h"

namespace encore::twin {

// Changes shade; returns the slots of the heads. cells: only for Share::InCell.
inline std::vector<uint32_t> serveFailures(const std::vector<SurfaceKey>& keys, const std::vector<uint32_t>& cells,
                                           uint32_t samples_per_pixel, uint32_t first_shade, ReuseKernels::Share share,
                                           std::vector<uint32_t>& shade) {
  using Share = ReuseKernels::Share;
  std::map<std::tuple<uint32_t, uint32_t, uint32_t, uint32_t>, uint32_t> shaded;
  std::vector<uint32_t> heads;
  for (uint32_t slot = 0; slot < shade.size(); ++slot) {
    if (shade[slot] != kShadeNotFound) continue;
    const uint32_t pixel = slot / samples_per_pixel;
    const uint32_t unit = share == Share::Nothing ? slot : share == Share::InPixel ? pixel : pixel / kBlockArea;
    const uint32_t cell = share == Share::InCell ? cells[slot] : 0;
    const auto [entry, is_new] = shaded.try_emplace({keys[slot].instance, keys[slot].primitive_side, unit, cell},
                                                    first_shade + uint32_t(heads.size()));
    if (is_new) heads.push_back(slot);
    shade[slot] = entry->second;
  }
  return heads;
}

}  // namespace encore::twin
