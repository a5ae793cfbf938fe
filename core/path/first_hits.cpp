#include "core/path/first_hits.h"

#include "core/path/blocks.h"

namespace encore {

Passage cameraPassage(const CameraRays& camera, const FirstHit& first, bool spreads) {
  Passage p;
  p.ray = camera.ray(first);
  p.hit = first.hit;
  p.pixel = first.pixel, p.sample = first.sample;
  if (spreads) camera.differential(CameraRays::sampleOf(first), p.dpdx, p.dpdy, p.spread.x, p.spread.y);
  return p;
}

void traceFirstHits(const ShadeContext& context, const CameraRays& camera, std::span<FirstHit> first,
                    std::span<const uint32_t> ends) {
  const PassThrough pass_through(context, false);
  std::vector<std::vector<Passage>> passages(pass_through.presence() ? ends.size() : 0);
  forEachBlock(ends, [&](size_t block, uint32_t begin, uint32_t end) {
    const auto store = [&](uint32_t slot, const Ray&, const Hit& hit) {
      first[slot].hit = hit;
      if (!pass_through.mayPass(hit, nullptr)) return;
      passages[block].push_back(cameraPassage(camera, first[slot], pass_through.evaluates()));
      passages[block].back().index = slot;
    };
    RayQueue<uint32_t, decltype(store)> queue(context, Coherence::Coherent, store);
    for (uint32_t slot = begin; slot < end; ++slot) {
      FirstHit& f = first[slot];
      f.hit = {};
      if (f.active()) queue.push(camera.ray(f), slot);
    }
    queue.finish();
  });
  pass_through.run(passages);
  for (const std::vector<Passage>& block : passages)
    for (const Passage& p : block) first[p.index].hit = p.hit;
}

}  // namespace encore
