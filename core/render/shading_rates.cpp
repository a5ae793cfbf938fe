#include "core/render/shading_rates.h"

#include <algorithm>

namespace encore {
namespace {

float chosen(float instance, float mesh, float frame) { return instance > 0 ? instance : mesh > 0 ? mesh : frame; }

}  // namespace

ShadingRates::ShadingRates(const Scene& scene, const Settings& settings) : scene_(scene) {
  const auto layerRate = [&](float own) { return own > 0 ? own : settings.shading_rate; };
  frame_ = {settings.shading_rate, layerRate(settings.shading_rate_reflection),
            layerRate(settings.shading_rate_refraction)};
  for (const Instance& instance : scene.instances)
    for (const uint32_t mesh : scene.prototypes[instance.prototype].meshes)
      for (size_t layer = 0; layer < kMaxLayers; ++layer) {
        const float rate = chosen(instance.shading_rate[layer], scene.meshes[mesh].shading_rate[layer], frame_[layer]);
        highest_[layer] = std::max(highest_[layer], rate);
        vary_[layer] = vary_[layer] || rate != frame_[layer];
      }
}

float ShadingRates::of(Layer layer, const Hit& hit) const {
  const size_t l = size_t(layer);
  if (!vary_[l]) return frame_[l];
  const Instance& instance = scene_.instances[hit.instance];
  const Mesh& mesh = scene_.meshes[scene_.prototypes[instance.prototype].meshes[hit.mesh]];
  return chosen(instance.shading_rate[l], mesh.shading_rate[l], frame_[l]);
}

}  // namespace encore
