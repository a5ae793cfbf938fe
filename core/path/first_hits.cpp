#include "core/path/blocks.h"
#include "core/path/path.h"

namespace encore {

void traceFirstHits(const ShadeContext& context, const CameraRays& camera, std::span<FirstHit> first,
                    std::span<const uint32_t> ends) {
  forEachBlock(ends, [&](size_t, uint32_t begin, uint32_t end) {
    const auto store = [&](uint32_t slot, const Ray&, const Hit& hit) { first[slot].hit = hit; };
    RayQueue<uint32_t, decltype(store)> queue(context, Coherence::Coherent, store);
    for (uint32_t slot = begin; slot < end; ++slot) {
      FirstHit& f = first[slot];
      f.hit = {};
      if (f.active()) queue.push(camera.ray(f.film_x, f.film_y), slot);
    }
    queue.finish();
  });
}

}  // namespace encore
