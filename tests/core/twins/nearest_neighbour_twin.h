// What core/reuse/nearest_neighbour.h must compute: brute force over the samples of the key.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "core/reuse/reuse.h"
#include "tests/core/twins/trees_twin.h"

namespace encore::twin {

class NearestNeighbour {
 public:
  explicit NearestNeighbour(const Samples& samples) : samples_(samples) {
    for (uint32_t id = 0; id < samples.keys.size(); ++id) ids_[pairOf(samples.keys[id])].push_back(id);
  }

  uint32_t find(SurfaceKey key, Vec2f uv) const {
    if (key.instance == kNoInstance) return kShadeNone;
    const auto found = ids_.find(pairOf(key));
    if (found == ids_.end()) return kShadeNotFound;
    const Vec2f q = inUnitSquare(uv);
    float best = 3;
    uint32_t best_id = kShadeNotFound;
    for (const uint32_t id : found->second) {  // ascending: the first of several is the lowest
      const Vec2f p = inUnitSquare(samples_.uv[id]);
      const float du = q.x - p.x, dv = q.y - p.y;
      const float squared = du * du + dv * dv;
      if (squared < best) {
        best = squared;
        best_id = id;
      }
    }
    return best_id;
  }

 private:
  const Samples& samples_;
  std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> ids_;
};

}  // namespace encore::twin
