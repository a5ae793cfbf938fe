// Which levels of the scene's textures are in device memory, and the tables by which kernels find them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/pattern/pattern_cache.h"
#include "core/pattern/texture_heap.h"
#include "core/pattern/texture_nodes.h"
#include "core/pattern/texture_pyramid.h"
#include "core/scene/scene.h"
#include "core/vulkan/device.h"

namespace encore {

// Of every texture a tail of its pyramid is resident: from some level, which may be none, to the coarsest. A batch is
// evaluated as if everything were there; lookups mark the levels that they want. If one of them was missing, the
// wanted tails are made resident, others leave for them, and the batch is evaluated again.
class TextureStore {
 public:
  // Keeps a reference to the scene. tiles: what tables of nodes refer to. budget_bytes: of resident levels, up to
  // most_bytes where one batch needs more. cache: levels that are in it are resident at once, and what has been wanted
  // goes back into it at the end; it must outlive this. Null: none.
  TextureStore(Device& device, const Scene& scene, const TextureLayout& layout, std::span<const TextureTile> tiles,
               uint64_t budget_bytes, uint64_t most_bytes, PatternCache* cache = nullptr);
  ~TextureStore();
  TextureStore(const TextureStore&) = delete;
  TextureStore& operator=(const TextureStore&) = delete;

  uint64_t tablesAddress() const { return tables_.address(); }
  void beginBatch();
  // Whether the values of the batch hold. Else what it wants has been made resident, and a second try will do.
  // Throws Error(Memory) when all that it wants does not fit most_bytes together, and what texture sources throw.
  bool endBatch();

  uint64_t bytes() const;  // of resident levels and tables
  uint64_t peakBytes() const { return peak_; }

 private:
  // MipLevel and TextureTables of texture.glsl.
  struct MipLevel {
    uint64_t texels;
    uint32_t width, height;
  };
  struct Tables {
    uint64_t levels, tiles, marks;
    uint32_t level_count, marking;
  };
  // A texture's pyramid; levels count in its own.
  struct Pyramid {
    uint32_t texture, first_level, level_count;
    uint32_t resident;  // the finest level that is resident; level_count: none
    uint32_t wanted;    // the finest level that the batch wants
    bool kept = false;  // its levels are of a scene before, and no batch has wanted any of them yet
  };
  uint64_t levelBytes(uint32_t level) const { return sizes_[level].texels() * 4 * sizeof(uint16_t); }
  uint64_t rangeBytes(const Pyramid& pyramid, uint32_t begin, uint32_t end) const;
  void takeKept();
  void leaveKept();
  // Everything is there, and it is known that it is wanted: nothing can be learned from marks.
  bool settled() const { return resident_ == total_ && kept_ == 0; }
  void readMarks();
  void updateMarking();
  void makeRoom(uint64_t bytes);
  void evictFinest(Pyramid& pyramid);
  void load(Pyramid& pyramid);
  [[noreturn]] void raiseTooSmall(uint64_t needed) const;

  const Scene& scene_;
  uint64_t budget_, most_, total_ = 0;  // total: of all levels
  uint64_t resident_ = 0, table_bytes_ = 0, peak_ = 0;
  uint64_t batch_ = 0;
  PatternCache* cache_;
  std::shared_ptr<TextureHeap> heap_;
  uint32_t kept_ = 0;  // pyramids that are
  std::vector<Pyramid> pyramids_;
  std::vector<PyramidLevel> sizes_;         // per level
  std::vector<TextureHeap::Block> blocks_;  // per level
  std::vector<uint64_t> last_wanted_;       // per level, never before that of a finer one: number of a batch
  Buffer<MipLevel> levels_;
  Buffer<TextureTile> tiles_;
  Buffer<uint32_t> marks_;
  Buffer<Tables> tables_;
};

}  // namespace encore
