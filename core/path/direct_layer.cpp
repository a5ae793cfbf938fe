#include "core/path/direct_layer.h"

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
  const std::vector<uint8_t> view_weights = viewWeightsInShading(context.scene, context.settings);
  for (size_t i = 0; i < context.scene.materials.size(); ++i)
    materials_.push_back(makeEntry(context, int32_t(i), view_weights[i] != 0));
}

DirectWeights::Entry DirectWeights::makeEntry(const ShadeContext& context, int32_t material,
                                              bool view_weight_in_shading) {
  Entry entry;
  const Material& source = context.scene.materials[size_t(material)];
  if (view_weight_in_shading) return entry;
  if (context.patterns.varies(PatternPart::Path, material)) {
    entry.kind = Kind::Varying;
    return entry;
  }
  for (const bool thin : {false, true})
    for (const bool back : {false, true})
      entry.lobes[thin][back] =
          makeLobes(source, context.patterns.constantPath(material), {back, thin}, context.settings);
  if (hasNoInterface(entry.lobes[0][0]) && hasNoInterface(entry.lobes[0][1]))
    entry.constant = effectWeights(entry.lobes[0][0], 1, false).absorption;
  else
    entry.kind = context.patterns.normalTexcoord(material).empty() ? Kind::ByCosine : Kind::Varying;
  return entry;
}

}  // namespace encore
