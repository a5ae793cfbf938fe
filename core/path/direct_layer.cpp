#include "core/path/direct_layer.h"

#include "core/shade/lights.h"

namespace encore {

namespace {

// Nothing but what is below the interface: the view does not matter.
bool hasNoInterface(const Lobes& lobes) { return lobes.eta == 1 && lobes.schlick == 0 && lobes.clearcoat == 0; }

}  // namespace

std::vector<Light> cameraLights(const Scene& scene, const Settings& settings) {
  std::vector<Light> lights;
  for (const Light& light : scene.lights)
    if (light.kind == Light::Kind::Dome ? settings.dome_light_visible : settings.lights_visible)
      lights.push_back(light);
  return lights;
}

DirectWeights::DirectWeights(const ShadeContext& context) {
  const bool delta = anyDelta(context.scene.lights);
  for (size_t i = 0; i < context.scene.materials.size(); ++i)
    materials_.push_back(makeEntry(context, int32_t(i), delta));
}

DirectWeights::Entry DirectWeights::makeEntry(const ShadeContext& context, int32_t material, bool zero_extent_lights) {
  Entry entry;
  const Material& source = context.scene.materials[size_t(material)];
  const float limit = context.settings.roughness_limit;
  if (viewWeightInShading(source, limit, zero_extent_lights)) return entry;
  if (context.patterns.pathVaries(material)) {
    entry.kind = Kind::Varying;
    return entry;
  }
  for (const bool back : {false, true})
    entry.lobes[back] = makeLobes(source, context.patterns.constantPath(material), back, limit);
  if (hasNoInterface(entry.lobes[0]) && hasNoInterface(entry.lobes[1]))
    entry.constant = effectWeights(entry.lobes[0], 1, false).absorption;
  else
    entry.kind = Kind::ByCosine;
  return entry;
}

}  // namespace encore
