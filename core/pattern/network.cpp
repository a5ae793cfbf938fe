#include "core/pattern/network.h"

#include "core/pattern/texture_pyramid.h"

namespace encore {
namespace {

// The input, or the fallback of a node that has no texture to read.
template <class T>
Input<T> fold(const Material& material, Input<T> input) {
  if (input.constant()) return input;
  const PatternNode& node = material.nodes[size_t(input.node)];
  if (node.kind != PatternNode::Kind::Texture || node.texture >= 0) return input;
  const float* channels = &node.fallback[size_t(input.channel)];
  if constexpr (std::is_same_v<T, float>)
    return {channels[0]};
  else
    return {{channels[0], channels[1], channels[2]}};
}

}  // namespace

ShadingNetwork shadingNetwork(const Material& material) {
  return {fold(material, material.diffuse_color), fold(material, material.emissive_color)};
}

PathNetwork pathNetwork(const Material& material) {
  PathNetwork network{fold(material, material.diffuse_color), fold(material, material.specular_color),
                      fold(material, material.metallic),      fold(material, material.roughness),
                      fold(material, material.clearcoat),     fold(material, material.clearcoat_roughness),
                      fold(material, material.opacity),       fold(material, material.ior)};
  // The two workflows of UsdPreviewSurface ignore each other's inputs, and only metals reflect the base colour.
  if (material.use_specular_workflow)
    network.metallic = {material.metallic.value};
  else
    network.specular_color = {material.specular_color.value};
  const bool metal = !network.metallic.constant() || network.metallic.value != 0;
  if (material.use_specular_workflow || !metal) network.base_color = {material.diffuse_color.value};
  return network;
}

ShadingInputs constants(const ShadingNetwork& n) { return {n.diffuse_color.value, n.emissive_color.value}; }

PathInputs constants(const PathNetwork& n) {
  return {n.base_color.value, n.specular_color.value,      n.metallic.value, n.roughness.value,
          n.clearcoat.value,  n.clearcoat_roughness.value, n.opacity.value,  n.ior.value};
}

TextureLayout layoutTextures(const Scene& scene) {
  TextureLayout layout;
  layout.first_level.assign(scene.textures.size(), TextureLayout::kUnused);
  std::vector<char> used(scene.textures.size());
  for (const Material& material : scene.materials) {
    const auto mark = [&](const std::vector<int32_t>& nodes) {
      for (int32_t n : nodes)
        if (const PatternNode& node = material.nodes[size_t(n)]; node.kind == PatternNode::Kind::Texture)
          used[size_t(node.texture)] = 1;
    };
    mark(reachableNodes(shadingNetwork(material)));
    mark(reachableNodes(pathNetwork(material)));
  }
  for (size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    layout.first_level[i] = layout.level_count;
    layout.level_count += uint32_t(pyramidLevels(scene.textures[i].width, scene.textures[i].height).size());
  }
  return layout;
}

}  // namespace encore
