// Work by blocks, and rays in packets within them: what makes results independent of threads and batches.
#pragma once

#include <tbb/parallel_for.h>

#include <array>
#include <cstdint>
#include <span>

#include "core/shade/shade.h"
#include "core/trace/trace_scene.h"

namespace encore {

// Calls work(block, first, end) for every block in parallel, denormals flushed.
// ends: ascending ends of the blocks.
template <class Work>
void forEachBlock(std::span<const uint32_t> ends, const Work& work) {
  tbb::parallel_for(size_t{0}, ends.size(), [&](size_t block) {
    const FlushDenormals flush;
    work(block, block == 0 ? 0u : ends[block - 1], ends[block]);
  });
}

// Collects the rays of one block and traces them a few packets at a time, in the order of push().
// sink(payload, ray, hit) is called for each in the same order, at the latest by finish().
template <class Payload, class Sink>
class RayQueue {
 public:
  RayQueue(const ShadeContext& context, Coherence coherence, const Sink& sink)
      : context_(context), coherence_(coherence), sink_(sink) {}

  void push(const Ray& ray, const Payload& payload) {
    rays_[count_] = ray;
    payloads_[count_] = payload;
    if (++count_ == kCapacity) flush();
  }
  void finish() {
    flush();
    context_.rays_traced.fetch_add(traced_, std::memory_order_relaxed);
    traced_ = 0;
  }

 private:
  static constexpr uint32_t kCapacity = 256;  // a multiple of the packet width: packets do not depend on it

  void flush() {
    context_.trace.intersect(std::span(rays_).first(count_), std::span(hits_).first(count_), coherence_);
    for (uint32_t i = 0; i < count_; ++i) sink_(payloads_[i], rays_[i], hits_[i]);
    traced_ += count_;
    count_ = 0;
  }

  const ShadeContext& context_;
  Coherence coherence_;
  const Sink& sink_;
  uint32_t count_ = 0;
  uint64_t traced_ = 0;
  std::array<Ray, kCapacity> rays_;
  std::array<Hit, kCapacity> hits_;
  std::array<Payload, kCapacity> payloads_;
};

}  // namespace encore
