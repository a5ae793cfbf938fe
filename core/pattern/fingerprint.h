// What PatternFingerprint's text is put together from.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/scene.h"

namespace encore {

// Text that differs where what was added does.
class FingerprintText {
 public:
  explicit FingerprintText(std::string& text) : text_(text) {}

  void add(const void* data, uint64_t bytes) {
    text_.append(reinterpret_cast<const char*>(&bytes), sizeof bytes);
    text_.append(static_cast<const char*>(data), bytes);
  }
  void add(const std::string& text) { add(text.data(), text.size()); }
  void add(uint32_t value) { add(&value, sizeof value); }

 private:
  std::string& text_;
};

// All that a lookup depends on besides the point; what it looks up goes to textures. False: one of them cannot be told
// from others.
bool addTextureNode(const Scene& scene, const PatternNode& node, FingerprintText& text,
                    std::vector<std::shared_ptr<const TextureSource>>& textures);

}  // namespace encore
