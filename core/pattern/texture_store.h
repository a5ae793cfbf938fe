// The pyramids of a scene's textures in device memory.
#pragma once

#include <cstdint>
#include <vector>

#include "core/pattern/network.h"
#include "core/scene/scene.h"
#include "core/vulkan/device.h"

namespace encore {

// Levels share buffers, since drivers limit the number of allocations to a few thousand.
class TextureStore {
 public:
  // Uploads the textures that the layout uses. Throws Error(Memory) when they do not fit.
  TextureStore(Device& device, const Scene& scene, const TextureLayout& layout);

  uint64_t levelsAddress() const { return levels_.address(); }  // array of MipLevel, as texture.glsl declares it
  uint64_t bytes() const;

 private:
  // MipLevel of texture.glsl.
  struct MipLevel {
    uint64_t texels;
    uint32_t width, height;
  };
  std::vector<Buffer<uint16_t>> pages_;
  Buffer<MipLevel> levels_;
};

}  // namespace encore
