#include "core/pattern/texture_nodes.h"

#include <algorithm>

#include "core/pattern/texture_pyramid.h"

namespace encore {

TextureLayout layoutTextures(const Scene& scene) {
  TextureLayout layout;
  layout.tiles.resize(scene.textures.size());
  std::vector<char> used(scene.textures.size());
  const auto mark = [&](int32_t texture) {
    if (texture >= 0) used[size_t(texture)] = 1;
  };
  for (const Material& material : scene.materials)
    for (uint32_t part = 0; part < kPatternParts; ++part)
      for (int32_t n : textureNodes(material, makeNetwork(PatternPart(part), material))) {
        const PatternNode& node = material.nodes[size_t(n)];
        if (node.udim.empty()) mark(node.texture);
        std::for_each(node.udim.begin(), node.udim.end(), mark);
      }
  for (size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    const Texture& texture = scene.textures[i];
    const uint32_t levels = uint32_t(pyramidLevels(texture.width, texture.height).size());
    layout.tiles[i] = {layout.level_count, levels, texture.width, texture.height};
    layout.level_count += levels;
  }
  return layout;
}

TextureNodeTable::Node TextureNodeTable::makeNode(const PatternNode& node, const PointLayout& layout,
                                                  const TextureLayout& textures, std::vector<TextureTile>& tiles) {
  const bool udim = !node.udim.empty();
  const uint32_t first = uint32_t(tiles.size());
  const auto add = [&](int32_t texture) {
    tiles.push_back(texture < 0 ? TextureTile{} : textures.tiles[size_t(texture)]);
  };
  if (!udim) add(node.texture);
  std::for_each(node.udim.begin(), node.udim.end(), add);
  return {first,
          uint32_t(tiles.size()) - first,
          udim,
          slotOffset(layout, texcoordSlot(node)),
          uint32_t(node.wrap_s),
          uint32_t(node.wrap_t),
          node.st_transform,
          node.scale,
          node.bias,
          node.fallback};
}

TextureNodeTable::TextureNodeTable(Device& device, PatternPart part, const Scene& scene, const TextureLayout& layout,
                                   std::vector<TextureTile>& tiles) {
  std::vector<Range> ranges;
  std::vector<Node> nodes;
  for (const Material& material : scene.materials) {
    const Network network = makeNetwork(part, material);
    const PointLayout points = makeLayout(part, material, network);
    const uint32_t first = uint32_t(nodes.size());
    for (int32_t n : textureNodes(material, network))
      nodes.push_back(makeNode(material.nodes[size_t(n)], points, layout, tiles));
    ranges.push_back({first, uint32_t(nodes.size()) - first});
  }
  if (nodes.empty()) return;
  ranges_ = Buffer<Range>(device, ranges.size(), "texture ranges");
  nodes_ = Buffer<Node>(device, nodes.size(), "texture nodes");
  std::copy(ranges.begin(), ranges.end(), ranges_.host().begin());
  std::copy(nodes.begin(), nodes.end(), nodes_.host().begin());
  ranges_.toDevice();
  nodes_.toDevice();
}

}  // namespace encore
