#include "core/pattern/fingerprint.h"

#include <algorithm>

namespace encore {

bool addTextureNode(const Scene& scene, const PatternNode& node, FingerprintText& text,
                    std::vector<std::shared_ptr<const TextureSource>>& textures) {
  const auto addTexture = [&](int32_t index) {
    const Texture* texture = index < 0 ? nullptr : &scene.textures[size_t(index)];
    if (texture && !(texture->rgba.empty() && texture->source)) return false;
    const void* const source = texture ? texture->source.get() : nullptr;
    text.add(&source, sizeof source);
    text.add(texture ? texture->width : 0), text.add(texture ? texture->height : 0);
    if (texture) textures.push_back(texture->source);
    return true;
  };
  text.add(uint32_t(node.udim.size()));
  if (node.udim.empty() && !addTexture(node.texture)) return false;
  if (!std::all_of(node.udim.begin(), node.udim.end(), addTexture)) return false;
  text.add(node.texcoord);
  text.add(node.texcoord_fallback.data(), sizeof node.texcoord_fallback);
  text.add(node.st_transform.data(), sizeof node.st_transform);
  text.add(uint32_t(node.wrap_s)), text.add(uint32_t(node.wrap_t));
  for (const auto* values : {&node.scale, &node.bias, &node.fallback}) text.add(values->data(), sizeof *values);
  return true;
}

}  // namespace encore
