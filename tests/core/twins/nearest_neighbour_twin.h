// What core/reuse/nearest_neighbour.h must compute: brute force over the samples of the key.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "core/reuse/reuse.h"
#include "tests/core/twins/footprint_twin.h"
#include "tests/core/twins/trees_twin.h"

namespace encore::twin {

class NearestNeighbour {
 public:
  // footprint_weight: c of the metric of §2.4; 0: distances in (u, v).
  explicit NearestNeighbour(const Samples& samples, float footprint_weight = 0)
      : samples_(samples), weight_(footprint_weight) {
    for (uint32_t id = 0; id < samples.keys.size(); ++id) ids_[pairOf(samples.keys[id])].push_back(id);
  }

  static float clean(float a) { return std::isnan(a) ? 0.0f : std::clamp(a, -0x1p40f, 0x1p40f); }
  static float aspectPart(Vec4f a, Vec4f b) {
    const float x = clean(a.x) - clean(b.x), y = clean(a.y) - clean(b.y), z = clean(a.z) - clean(b.z),
                w = clean(a.w) - clean(b.w);
    return (x * x + y * y) + (z * z + w * w);
  }

  uint32_t find(SurfaceKey key, Vec2f uv, float footprint = 1, Vec4f aspect = {}) const {
    if (key.instance == kNoInstance) return kShadeNone;
    const auto found = ids_.find(pairOf(key));
    if (found == ids_.end()) return kShadeNotFound;
    const Vec2f q = inUnitSquare(uv);
    float best = 0x1p101f;
    uint32_t best_id = kShadeNotFound;
    for (const uint32_t id : found->second) {  // ascending: the first of several is the lowest
      const Vec2f p = inUnitSquare(samples_.uv[id]);
      const float du = q.x - p.x, dv = q.y - p.y;
      float squared = du * du + dv * dv;
      if (weight_ > 0) squared += footprintPart(footprint, samples_.footprints[id], weight_);
      if (!samples_.aspects.empty()) squared += aspectPart(aspect, samples_.aspects[id]);
      if (squared < best) {
        best = squared;
        best_id = id;
      }
    }
    return best_id;
  }

 private:
  const Samples& samples_;
  float weight_;
  std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> ids_;
};

}  // namespace encore::twin
