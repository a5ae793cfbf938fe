// What a part of a material's network really depends on, after everything that cannot vary became a constant.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/scene/scene.h"
#include "shaders/records.h"

namespace encore {

// The inputs of the two parts, in the order of ShadingInputs and PathInputs. Nodes without a texture are
// replaced by their fallback, and inputs that the part has no use for by their value.
struct ShadingNetwork {
  Input<Vec3f> diffuse_color, emissive_color;
};
struct PathNetwork {
  Input<Vec3f> base_color, specular_color;
  Input<float> metallic, roughness, clearcoat, clearcoat_roughness, opacity, ior;
};
ShadingNetwork shadingNetwork(const Material& material);
PathNetwork pathNetwork(const Material& material);

// Calls f with every input, in order.
template <class F>
void forEachInput(const ShadingNetwork& n, F&& f) {
  f(n.diffuse_color), f(n.emissive_color);
}
template <class F>
void forEachInput(const PathNetwork& n, F&& f) {
  f(n.base_color), f(n.specular_color), f(n.metallic), f(n.roughness);
  f(n.clearcoat), f(n.clearcoat_roughness), f(n.opacity), f(n.ior);
}

// The nodes that the inputs read, each once, in the order in which they are met.
template <class Network>
std::vector<int32_t> reachableNodes(const Network& network) {
  std::vector<int32_t> nodes;
  forEachInput(network, [&](const auto& input) {
    if (!input.constant() && std::find(nodes.begin(), nodes.end(), input.node) == nodes.end())
      nodes.push_back(input.node);
  });
  return nodes;
}

// The values of inputs; what they are where the input varies has no meaning.
ShadingInputs constants(const ShadingNetwork& network);
PathInputs constants(const PathNetwork& network);

// Where each texture's pyramid starts in the table of levels. Textures that nothing reads have none.
struct TextureLayout {
  static constexpr uint32_t kUnused = 0xffffffffu;
  std::vector<uint32_t> first_level;  // per texture of the scene, or kUnused
  uint32_t level_count = 0;           // of all textures together
};
TextureLayout layoutTextures(const Scene& scene);

}  // namespace encore
