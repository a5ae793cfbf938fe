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
      : sample_(sample), keys_(pcg4d(pixel, seed, uint32_t(RandomUse::Lobe), bounce * kMaxLayers + uint32_t(layer))) {}

  // Which effect is followed.
  float choice() const { return sobol2(sample_, keys_[0]).x; }
  // Which lobe of the effect, and where to.
  std::array<float, 4> lobe() const {
    const Vec2f a = sobol2(sample_, keys_[1]), b = sobol2(sample_, keys_[2]);
    return {a.x, a.y, b.x, b.y};
  }

 private:
  uint32_t sample_;
  std::array<uint32_t, 4> keys_;
};

}  // namespace encore
