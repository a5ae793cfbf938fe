#include "core/pattern/texture_store.h"

#include "core/pattern/texture_pyramid.h"

namespace encore {
namespace {

constexpr uint64_t kPageHalves = uint64_t{128} << 20;  // 256 MiB

// Where a level lies.
struct Place {
  size_t page = 0;
  uint64_t offset = 0, halves = 0;
};

}  // namespace

TextureStore::TextureStore(Device& device, const Scene& scene, const TextureLayout& layout) {
  // Plan: levels one after the other; a level that does not fit into what is left of a page opens the next.
  std::vector<Place> places;
  std::vector<uint64_t> page_halves;
  std::vector<PyramidLevel> sizes;
  for (size_t t = 0; t < scene.textures.size(); ++t) {
    if (layout.first_level[t] == TextureLayout::kUnused) continue;
    for (PyramidLevel size : pyramidLevels(scene.textures[t].width, scene.textures[t].height)) {
      const uint64_t halves = size.texels() * 4;
      if (page_halves.empty() || page_halves.back() + halves > kPageHalves) page_halves.push_back(0);
      places.push_back({page_halves.size() - 1, page_halves.back(), halves});
      page_halves.back() += halves;
      sizes.push_back(size);
    }
  }
  if (places.empty()) return;

  for (uint64_t halves : page_halves) pages_.emplace_back(device, halves, "textures");
  levels_ = Buffer<MipLevel>(device, places.size(), "texture levels");
  for (size_t i = 0; i < places.size(); ++i)
    levels_.host()[i] = {pages_[places[i].page].address(places[i].offset), sizes[i].width, sizes[i].height};

  for (size_t t = 0; t < scene.textures.size(); ++t) {
    if (layout.first_level[t] == TextureLayout::kUnused) continue;
    const size_t count = pyramidLevels(scene.textures[t].width, scene.textures[t].height).size();
    std::vector<std::span<uint16_t>> levels;
    for (size_t i = layout.first_level[t]; i < layout.first_level[t] + count; ++i)
      levels.push_back(pages_[places[i].page].host().subspan(places[i].offset, places[i].halves));
    buildPyramid(scene.textures[t], levels);
  }
  for (Buffer<uint16_t>& page : pages_) page.toDevice();
  levels_.toDevice();
}

uint64_t TextureStore::bytes() const {
  uint64_t bytes = levels_.size() * sizeof(MipLevel);
  for (const Buffer<uint16_t>& page : pages_) bytes += page.size() * sizeof(uint16_t);
  return bytes;
}

}  // namespace encore
