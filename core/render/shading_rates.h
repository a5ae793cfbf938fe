// Shading samples per pixel, by primitive and layer: the paper's first open limitation (§5).
#pragma once

#include <array>
#include <vector>

#include "core/path/path.h"

namespace encore {

// What an instance says holds for all of its meshes; else what the mesh says; else what the settings say of the
// layer; else what they say of all layers.
class ShadingRates {
 public:
  ShadingRates(const Scene& scene, const Settings& settings);

  // Rate that the surface was given in a layer. Precondition: hit.valid().
  float of(Layer layer, const Hit& hit) const;
  // That of surfaces that say nothing.
  float frame(Layer layer) const { return frame_[size_t(layer)]; }
  // The highest of any surface of the scene: what seeds have to be traced at.
  float highest(Layer layer) const { return highest_[size_t(layer)]; }
  // Whether any surface differs from frame(layer).
  bool vary(Layer layer) const { return vary_[size_t(layer)]; }

 private:
  const Scene& scene_;
  std::array<float, kMaxLayers> frame_{}, highest_{};
  std::array<bool, kMaxLayers> vary_{};
};

}  // namespace encore
