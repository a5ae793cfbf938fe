// How many rays each light gets from one vertex.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/shade/light_set.h"

namespace encore {

// What one light gets at one vertex.
struct LightRays {
  uint32_t count = 0;   // rays to trace
  uint32_t first = 0;   // of the light's sequence of points, within the vertex's part of it
  uint32_t stride = 0;  // length of a vertex's part
  float expected = 0;   // of count: what contributions are divided by
};

// Where lights are few, each takes all of its rays. Where the area lights would take more than
// Settings::most_light_samples together, they share that many: by an upper estimate of what each could contribute
// without shadows (a tenth evenly among those that can contribute at all), dealt out at even distances along the
// running sum of the shares, so that every light's number of rays is its expectation rounded up or down. Lights with a
// number of samples of their own keep it, as do domes and lights of zero extent.
class LightChoice {
 public:
  LightChoice(const LightSet& lights, const Settings& settings) : lights_(lights), settings_(settings) {}

  // n: unit; nothing arrives from below it. u: in [0, 1), what the deal begins with.
  // The result is valid until the next call; in the order of the lights. Lights that do not light the group get none.
  std::span<const LightRays> choose(Vec3f p, Vec3f n, uint32_t link_group, float u);

 private:
  const LightSet& lights_;
  const Settings& settings_;
  std::vector<LightRays> rays_;
  std::vector<float> importance_;
};

// Upper estimate of the irradiance at p on a surface with normal n, but for a factor that all lights share; 0 only
// where nothing of the light can arrive. Of lights that may be chosen.
float lightImportance(const PreparedLight& light, Vec3f p, Vec3f n);

}  // namespace encore
