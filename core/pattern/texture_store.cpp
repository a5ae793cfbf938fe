#include "core/pattern/texture_store.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "core/scene/error.h"
#include "core/scene/text.h"

namespace encore {
namespace {

// So that there are never more than some hundreds of pages, and what holes in them waste stays a small part.
uint64_t pageBytes(uint64_t budget, uint64_t total) {
  constexpr uint64_t kLeast = uint64_t{1} << 20, kMost = uint64_t{64} << 20;
  return std::min(std::clamp(budget / 64, kLeast, kMost), std::max<uint64_t>(total, 8));
}

uint64_t totalBytes(const Scene& scene, const TextureLayout& layout) {
  uint64_t bytes = 0;
  for (size_t i = 0; i < layout.tiles.size(); ++i)
    if (layout.tiles[i].level_count)
      for (PyramidLevel level : pyramidLevels(scene.textures[i].width, scene.textures[i].height))
        bytes += level.texels() * 4 * sizeof(uint16_t);
  return bytes;
}

std::string mebibytes(uint64_t bytes) { return text(double(bytes) / (1 << 20)) + " MiB"; }

// Pixels of a source, read and checked: infinities become the largest half float, as for pixels that come as floats.
std::vector<uint16_t> readPixels(const Texture& texture) {
  std::vector<uint16_t> rgba(uint64_t(texture.width) * texture.height * 4);
  texture.source->read(rgba);
  for (size_t i = 0; i < rgba.size(); ++i) {
    const uint16_t magnitude = rgba[i] & 0x7fffu;
    if (magnitude < 0x7c00u) continue;
    if (magnitude > 0x7c00u)
      throw Error(ErrorKind::Scene,
                  "the pixel at column " + text(i / 4 % texture.width) + ", row " + text(i / 4 / texture.width) +
                      " from the bottom is not a number",
                  texture.path, "Repair the texture");
    rgba[i] = uint16_t((rgba[i] & 0x8000u) | 0x7bffu);
  }
  return rgba;
}

}  // namespace

TextureStore::TextureStore(Device& device, const Scene& scene, const TextureLayout& layout,
                           std::span<const TextureTile> tiles, uint64_t budget_bytes, uint64_t most_bytes,
                           PatternCache* cache)
    : scene_(scene),
      budget_(budget_bytes),
      most_(most_bytes),
      total_(totalBytes(scene, layout)),
      cache_(cache),
      heap_(cache ? cache->heap() : std::make_shared<TextureHeap>(device, 0)) {
  heap_->setPageBytes(pageBytes(budget_, total_));
  for (size_t i = 0; i < layout.tiles.size(); ++i) {
    const TextureTile& tile = layout.tiles[i];
    if (!tile.level_count) continue;
    pyramids_.push_back({uint32_t(i), tile.first_level, tile.level_count, tile.level_count, tile.level_count});
    const std::vector<PyramidLevel> levels = pyramidLevels(tile.width, tile.height);
    sizes_.insert(sizes_.end(), levels.begin(), levels.end());
  }
  blocks_.resize(layout.level_count);
  last_wanted_.resize(layout.level_count);
  if (pyramids_.empty()) {
    takeKept();
    return;
  }
  const uint32_t count = layout.level_count;
  levels_ = Buffer<MipLevel>(device, count, "texture levels");
  tiles_ = Buffer<TextureTile>(device, tiles.size(), "texture tiles");
  marks_ = Buffer<uint32_t>(device, count + 1, "texture marks");
  tables_ = Buffer<Tables>(device, 1, "texture tables");
  std::fill(levels_.host().begin(), levels_.host().end(), MipLevel{});
  std::copy(tiles.begin(), tiles.end(), tiles_.host().begin());
  tables_.host()[0] = {levels_.address(), tiles_.address(), marks_.address(), count, 1};
  takeKept();
  levels_.toDevice();
  tiles_.toDevice();
  tables_.toDevice();
  table_bytes_ = levels_.raw().bytes() + tiles_.raw().bytes() + marks_.raw().bytes() + tables_.raw().bytes();
  peak_ = bytes();
}

// What is left of the scene before, within the budget. Of other textures nothing stays.
void TextureStore::takeKept() {
  if (!cache_) return;
  const auto release = [&](ResidentTexture& texture) {
    for (TextureHeap::Block& block : texture.blocks)
      if (block.halves) heap_->release(block);
  };
  std::map<const TextureSource*, ResidentTexture> left;
  for (ResidentTexture& texture : cache_->takeTextures())
    if (const auto [known, first] = left.try_emplace(texture.source.get(), texture); !first) release(texture);
  for (Pyramid& pyramid : pyramids_) {
    const Texture& texture = scene_.textures[pyramid.texture];
    const auto found = left.find(texture.rgba.empty() ? texture.source.get() : nullptr);
    if (found == left.end()) continue;
    const ResidentTexture& kept = found->second;
    if (kept.width != texture.width || kept.height != texture.height) continue;
    pyramid.resident = kept.resident, pyramid.kept = true, ++kept_;
    for (uint32_t i = kept.resident; i < pyramid.level_count; ++i) {
      const uint32_t level = pyramid.first_level + i;
      blocks_[level] = kept.blocks[i];
      levels_.host()[level] = {heap_->address(blocks_[level]), sizes_[level].width, sizes_[level].height};
      resident_ += levelBytes(level);
    }
    left.erase(found);
  }
  for (auto& [source, texture] : left) release(texture);
  makeRoom(0);
}

void TextureStore::leaveKept() {
  std::vector<ResidentTexture> textures;
  for (const Pyramid& pyramid : pyramids_) {
    const Texture& texture = scene_.textures[pyramid.texture];
    const auto first = blocks_.begin() + pyramid.first_level;
    if (texture.rgba.empty() && texture.source && !pyramid.kept && pyramid.resident < pyramid.level_count)
      textures.push_back(
          {texture.source, texture.width, texture.height, pyramid.resident, {first, first + pyramid.level_count}});
    else
      for (auto block = first; block != first + pyramid.level_count; ++block)
        if (block->halves) heap_->release(*block);
  }
  cache_->leaveTextures(std::move(textures));
}

TextureStore::~TextureStore() {
  if (cache_) leaveKept();
}

uint64_t TextureStore::bytes() const { return resident_ + table_bytes_; }

uint64_t TextureStore::rangeBytes(const Pyramid& pyramid, uint32_t begin, uint32_t end) const {
  uint64_t sum = 0;
  for (uint32_t level = begin; level < end; ++level) sum += levelBytes(pyramid.first_level + level);
  return sum;
}

void TextureStore::beginBatch() {
  if (settled()) return;
  std::fill(marks_.host().begin(), marks_.host().end(), 0u);
  marks_.toDevice();
}

bool TextureStore::endBatch() {
  if (settled()) return true;
  marks_.toHost();
  ++batch_;
  readMarks();
  if (marks_.host().back() == 0) {
    updateMarking();
    return true;
  }

  uint64_t needed = 0, missing = 0;
  for (const Pyramid& pyramid : pyramids_) {
    needed += rangeBytes(pyramid, pyramid.wanted, pyramid.level_count);
    missing += rangeBytes(pyramid, pyramid.wanted, std::max(pyramid.wanted, pyramid.resident));
  }
  if (needed > most_) raiseTooSmall(needed);
  budget_ = std::max(budget_, needed);
  makeRoom(missing);
  levels_.toDevice();
  for (Pyramid& pyramid : pyramids_)
    if (pyramid.wanted < pyramid.resident) load(pyramid);
  updateMarking();
  return false;
}

void TextureStore::updateMarking() {
  const uint32_t marking = !settled();
  if (std::exchange(tables_.host()[0].marking, marking) != marking) tables_.toDevice();
}

void TextureStore::readMarks() {
  const std::span<const uint32_t> marks = marks_.host();
  for (Pyramid& pyramid : pyramids_) {
    pyramid.wanted = 0;
    while (pyramid.wanted < pyramid.level_count && !marks[pyramid.first_level + pyramid.wanted]) ++pyramid.wanted;
    for (uint32_t level = pyramid.wanted; level < pyramid.level_count; ++level)
      last_wanted_[pyramid.first_level + level] = batch_;
    if (pyramid.kept && pyramid.wanted < pyramid.level_count) {
      pyramid.kept = false, --kept_;
      if (pyramid.wanted >= pyramid.resident) scene_.textures[pyramid.texture].source->reused();
    }
  }
}

// What was wanted longest ago leaves first, of several the largest level. What the batch wants stays: it fits.
void TextureStore::makeRoom(uint64_t bytes) {
  while (resident_ + bytes > budget_) {
    Pyramid* oldest = nullptr;
    const auto finest = [](const Pyramid& pyramid) { return pyramid.first_level + pyramid.resident; };
    for (Pyramid& pyramid : pyramids_) {
      if (pyramid.resident >= pyramid.wanted) continue;
      if (oldest) {
        const uint64_t a = last_wanted_[finest(pyramid)], b = last_wanted_[finest(*oldest)];
        if (a > b || (a == b && levelBytes(finest(pyramid)) <= levelBytes(finest(*oldest)))) continue;
      }
      oldest = &pyramid;
    }
    if (!oldest) throw Error(ErrorKind::Internal, "no texture level can leave device memory");
    evictFinest(*oldest);
  }
}

void TextureStore::evictFinest(Pyramid& pyramid) {
  const uint32_t level = pyramid.first_level + pyramid.resident++;
  levels_.host()[level] = {};
  heap_->release(blocks_[level]);
  if (pyramid.resident == pyramid.level_count && pyramid.kept) pyramid.kept = false, --kept_;
  resident_ -= levelBytes(level);
}

// Only what is not there yet. Coarser levels first, so that what is resident is a tail whatever throws.
void TextureStore::load(Pyramid& pyramid) {
  const Texture& texture = scene_.textures[pyramid.texture];
  std::vector<std::vector<uint16_t>> made(pyramid.resident);
  for (uint32_t level = pyramid.wanted; level < pyramid.resident; ++level)
    made[level].resize(sizes_[pyramid.first_level + level].texels() * 4);
  const std::vector<std::span<uint16_t>> levels(made.begin(), made.end());
  if (texture.rgba.empty()) {
    if (cache_ && pyramid.resident == pyramid.level_count) cache_->countRead();
    const std::vector<uint16_t> pixels = readPixels(texture);
    buildPyramid(pixels, texture.width, texture.height, levels);
  } else {
    buildPyramid(texture, levels);
  }
  while (pyramid.resident > pyramid.wanted) {
    const uint32_t finer = pyramid.resident - 1, level = pyramid.first_level + finer;
    blocks_[level] = heap_->allocate(made[finer].size());
    std::copy(made[finer].begin(), made[finer].end(), heap_->host(blocks_[level]).begin());
    heap_->toDevice(blocks_[level]);
    levels_.host()[level] = {heap_->address(blocks_[level]), sizes_[level].width, sizes_[level].height};
    resident_ += levelBytes(level);
    --pyramid.resident;
    levels_.toDevice(level, 1);
  }
  peak_ = std::max(peak_, bytes());
}

void TextureStore::raiseTooSmall(uint64_t needed) const {
  size_t count = 0;
  for (const Pyramid& pyramid : pyramids_) count += pyramid.wanted < pyramid.level_count;
  throw Error(ErrorKind::Memory,
              "one batch looks up " + text(count) + " textures, whose levels need " + mebibytes(needed) +
                  ", and the budget for textures is " + mebibytes(most_),
              "texture_budget_bytes", "Raise the budget, or use smaller textures");
}

}  // namespace encore
