// Random numbers of a path: functions of (seed, pixel, layer, bounce, sample) and of nothing else.
#pragma once

#include <array>
#include <cstdint>

#include "core/path/path.h"
#include "core/scene/random.h"

namespace encore {

// Numbers of one bounce. Those of a pixel's samples stratify: each pair is a point of a scrambled
// Sobol sequence whose index is the sample.
class BounceRandom {
 public:
  BounceRandom(uint32_t seed, uint32_t pixel, uint32_t sample, Layer layer, uint32_t bounce)
      : seed_(seed), pixel_(pixel), sample_(sample), dimension_(bounce * kMaxLayers + uint32_t(layer)) {}

  // Which effect is followed.
  float choice() const { return sobol2(sample_, keys()[0]).x; }
  // Which lobe of the effect, and where to.
  std::array<float, 4> lobe() const {
    const auto k = keys();
    const Vec2f a = sobol2(sample_, k[1]), b = sobol2(sample_, k[2]);
    return {a.x, a.y, b.x, b.y};
  }

 private:
  std::array<uint32_t, 4> keys() const { return pcg4d(pixel_, seed_, uint32_t(RandomUse::Lobe), dimension_); }

  uint32_t seed_, pixel_, sample_, dimension_;
};

}  // namespace encore
