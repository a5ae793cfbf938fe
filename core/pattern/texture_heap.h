// Device memory for texture levels: pages that levels share, since drivers limit the number of allocations.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "core/vulkan/device.h"

namespace encore {

class TextureHeap {
 public:
  // page_bytes: of what smaller levels share; those of at least half as much get a page of their own.
  TextureHeap(Device& device, uint64_t page_bytes) : device_(device), page_halves_(page_bytes / sizeof(uint16_t)) {}

  struct Block {
    uint32_t page = 0;
    uint64_t first = 0, halves = 0;  // none: not allocated
  };
  void setPageBytes(uint64_t page_bytes) { page_halves_ = page_bytes / sizeof(uint16_t); }  // of pages to come
  // halves: a multiple of 4, above 0. Throws Error(Memory) when the device has no more. Contents are undefined.
  Block allocate(uint64_t halves);
  void release(Block& block);

  std::span<uint16_t> host(const Block& block) const;
  void toDevice(const Block& block) { pages_[block.page].buffer.toDevice(block.first, block.halves); }
  uint64_t address(const Block& block) const { return pages_[block.page].buffer.address(block.first); }

 private:
  struct Page {
    Buffer<uint16_t> buffer;             // empty: the place is free for another page
    std::map<uint64_t, uint64_t> holes;  // first half → halves
  };
  uint32_t addPage(uint64_t halves);

  Device& device_;
  uint64_t page_halves_;
  std::vector<Page> pages_;
};

}  // namespace encore
