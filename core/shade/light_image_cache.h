// What lights leave behind for scenes that follow: their images, decoded and ready to be sampled.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/scene/scene.h"
#include "core/shade/light_image.h"

namespace encore {

// Of the last scene that was rendered with it. Not thread-safe.
class LightImageCache {
 public:
  // What an image is made from: textures are told apart by their sources.
  struct Key {
    const TextureSource* source = nullptr;
    bool dome = false;
    DomeFormat format = DomeFormat::LatLong;

    bool operator==(const Key&) const = default;
  };

  // Lets go of all images but these, and begins to count.
  void retain(const std::vector<Key>& keys) {
    std::erase_if(entries_, [&](const Entry& e) { return std::find(keys.begin(), keys.end(), e.key) == keys.end(); });
    decoded_ = 0;
  }
  std::shared_ptr<const LightImage> find(const Key& key) const {
    const auto found = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& e) { return e.key == key; });
    return key.source && found != entries_.end() ? found->image : nullptr;
  }
  void add(const Key& key, std::shared_ptr<const TextureSource> source, std::shared_ptr<const LightImage> image) {
    ++decoded_;
    if (key.source) entries_.push_back({key, std::move(source), std::move(image)});
  }

  size_t size() const { return entries_.size(); }
  uint64_t decoded() const { return decoded_; }  // images that the last scene did not find in it

 private:
  struct Entry {
    Key key;
    std::shared_ptr<const TextureSource> source;  // keeps the key's address
    std::shared_ptr<const LightImage> image;
  };
  std::vector<Entry> entries_;
  uint64_t decoded_ = 0;
};

}  // namespace encore
