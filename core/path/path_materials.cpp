#include "core/path/path_materials.h"

#include "core/trace/pattern_points.h"

namespace encore {

PathMaterials::PathMaterials(const ShadeContext& context, Layer layer) : context_(context) {
  const std::vector<uint8_t> view_weights = viewWeightsInShading(context.scene, context.settings);
  const float limit = context.settings.roughness_limit;
  for (size_t i = 0; i < context.scene.materials.size(); ++i) {
    const Material& material = context.scene.materials[i];
    const int32_t index = int32_t(i);
    PathMaterial& m = materials_.emplace_back();
    m.feeds_layer = layer == Layer::Direct ||
                    (layer == Layer::Reflection ? feedsReflection(material, limit) : feedsRefraction(material));
    m.varies = context.patterns.varies(PatternPart::Path, index);
    m.mapped = !context.patterns.normalTexcoord(index).empty();
    m.view_weight_in_shading = view_weights[i] != 0;
    any_varies_ = any_varies_ || m.varies;
    if (m.varies) continue;
    for (const bool thin : {false, true})
      for (const bool back : {false, true}) {
        Lobes& lobes = m.lobes[thin][back];
        lobes = makeLobes(material, context.patterns.constantPath(index), {back, thin}, context.settings);
        m.absorbs_all[thin][back] = absorbsAll(lobes, m.view_weight_in_shading);
      }
  }
}

Lobes PathMaterials::lobesOf(const SurfacePoint& point, const PathInputs* inputs, float other_ior) const {
  const PathMaterial& m = materials_[size_t(point.material)];
  const bool back = point.side != 0;
  if (!inputs && other_ior == 1) return m.lobes[point.thin][back];
  return makeLobes(context_.scene.materials[size_t(point.material)], inputsOf(point.material, inputs),
                   {back, point.thin, other_ior}, context_.settings);
}

void PathMaterials::mapNormal(const Hit& hit, const PathInputs* inputs, SurfacePoint& point) const {
  if (!materials_[size_t(point.material)].mapped) return;
  point.ns = mappedNormal(context_.trace, hit, point, context_.patterns.normalTexcoord(point.material),
                          inputsOf(point.material, inputs).normal);
}

}  // namespace encore
