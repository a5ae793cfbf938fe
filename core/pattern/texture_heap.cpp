#include "core/pattern/texture_heap.h"

#include <algorithm>
#include <iterator>

namespace encore {

TextureHeap::Block TextureHeap::allocate(uint64_t halves) {
  const auto take = [&](uint32_t index, std::map<uint64_t, uint64_t>::iterator hole) {
    std::map<uint64_t, uint64_t>& holes = pages_[index].holes;
    const auto [first, size] = *hole;
    holes.erase(hole);
    if (size > halves) holes[first + halves] = size - halves;
    return Block{index, first, halves};
  };
  const bool shares = halves < page_halves_ / 2;
  for (uint32_t i = 0; shares && i < pages_.size(); ++i) {
    std::map<uint64_t, uint64_t>& holes = pages_[i].holes;
    const auto hole = std::find_if(holes.begin(), holes.end(), [&](const auto& h) { return h.second >= halves; });
    if (hole != holes.end()) return take(i, hole);
  }
  const uint32_t index = addPage(shares ? page_halves_ : halves);
  return take(index, pages_[index].holes.begin());
}

uint32_t TextureHeap::addPage(uint64_t halves) {
  Buffer<uint16_t> buffer(device_, halves, "textures");
  const auto unused = std::find_if(pages_.begin(), pages_.end(), [](const Page& page) { return page.buffer.empty(); });
  const auto place = unused != pages_.end() ? unused : pages_.emplace(pages_.end());
  *place = {std::move(buffer), {{0, halves}}};
  return uint32_t(place - pages_.begin());
}

void TextureHeap::release(Block& block) {
  Page& page = pages_[block.page];
  auto hole = page.holes.emplace(block.first, block.halves).first;
  if (const auto next = std::next(hole); next != page.holes.end() && hole->first + hole->second == next->first) {
    hole->second += next->second;
    page.holes.erase(next);
  }
  if (hole != page.holes.begin()) {
    const auto before = std::prev(hole);
    if (before->first + before->second == hole->first) {
      before->second += hole->second;
      page.holes.erase(hole);
      hole = before;
    }
  }
  if (hole->second == page.buffer.size()) page = {};
  block = {};
}

std::span<uint16_t> TextureHeap::host(const Block& block) const {
  return pages_[block.page].buffer.host().subspan(block.first, block.halves);
}

}  // namespace encore
