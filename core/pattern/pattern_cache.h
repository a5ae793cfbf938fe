// What patterns leave behind for scenes that follow: compiled programs, and levels of textures in device memory.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/pattern/texture_heap.h"
#include "core/scene/material.h"
#include "core/vulkan/device.h"

namespace encore {

// A tail of a texture's pyramid that is in device memory.
struct ResidentTexture {
  std::shared_ptr<const TextureSource> source;  // textures are told apart by it
  uint32_t width = 0, height = 0;
  uint32_t resident = 0;                   // the finest level that is
  std::vector<TextureHeap::Block> blocks;  // per level
};

// Of the last scene that was rendered with it, for one device. Not thread-safe.
class PatternCache {
 public:
  explicit PatternCache(Device& device) : heap_(std::make_shared<TextureHeap>(device, uint64_t{1} << 20)) {}

  // Lets go of programs whose keys are not among these, and begins to count.
  void retainPrograms(const std::set<std::string>& keys);
  // Null: it is not there. The pointers hold until programs are let go.
  std::shared_ptr<const Kernel> program(const std::string& key) const;
  // kernel: null for programs that are only known to compile.
  void addProgram(const std::string& key, std::shared_ptr<const Kernel> kernel);
  bool knows(const std::string& key) const { return programs_.contains(key); }

  const std::shared_ptr<TextureHeap>& heap() const { return heap_; }
  std::vector<ResidentTexture> takeTextures() { return std::exchange(textures_, {}); }
  void leaveTextures(std::vector<ResidentTexture> textures) { textures_ = std::move(textures); }

  size_t programs() const { return programs_.size(); }
  size_t textures() const { return textures_.size(); }
  uint64_t compiled() const { return compiled_; }  // programs that the last scene did not find in it
  uint64_t read() const { return read_; }          // textures that the last scene did not find in it, and wanted
  void countRead() { ++read_; }

 private:
  std::shared_ptr<TextureHeap> heap_;
  std::vector<ResidentTexture> textures_;
  std::map<std::string, std::shared_ptr<const Kernel>> programs_;
  uint64_t compiled_ = 0, read_ = 0;
};

}  // namespace encore
