// Tables of what one part's networks look up: read by shaders/pattern/evaluate.glsl.
#pragma once

#include <cstdint>
#include <vector>

#include "core/pattern/network.h"
#include "core/vulkan/device.h"

namespace encore {

// A texture's pyramid in the table of levels; TextureTile of texture.glsl.
struct TextureTile {
  uint32_t first_level = 0, level_count = 0;
  uint32_t width = 0, height = 0;
};

// Which pyramids there are: one for each texture that some network reads.
struct TextureLayout {
  std::vector<TextureTile> tiles;  // per texture of the scene; without levels where nothing reads it
  uint32_t level_count = 0;        // of all textures together
};
TextureLayout layoutTextures(const Scene& scene);

class TextureNodeTable {
 public:
  // Appends the tiles that its nodes look up to `tiles`, which all parts share.
  TextureNodeTable(Device& device, PatternPart part, const Scene& scene, const TextureLayout& layout,
                   std::vector<TextureTile>& tiles);

  uint64_t rangesAddress() const { return ranges_.address(); }  // MaterialTextures
  uint64_t nodesAddress() const { return nodes_.address(); }    // TextureNodes

 private:
  // TextureNode of texture.glsl.
  struct Node {
    uint32_t first_tile, tile_count, udim, texcoord, wrap_s, wrap_t;
    std::array<float, 6> rows;
    std::array<float, 4> scale, bias, fallback;
  };
  static Node makeNode(const PatternNode& node, const PointLayout& layout, const TextureLayout& textures,
                       std::vector<TextureTile>& tiles);
  struct Range {
    uint32_t first, count;
  };
  Buffer<Range> ranges_;
  Buffer<Node> nodes_;
};

}  // namespace encore
