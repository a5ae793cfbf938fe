// Rays in packets of 16, in order: which rays share a packet depends on nothing but their position.
#include "core/trace/shadow_hits.h"

namespace encore {

namespace {

// Calls query(packet) for every 16 rays, then each(ray index, lane) for its lanes.
template <class Run, class Each>
void forEachPacket(std::span<const Ray> rays, embree::Query&& query, Run run, Each each) {
  for (size_t first = 0; first < rays.size(); first += kPacketWidth) {
    const uint32_t count = uint32_t(std::min<size_t>(kPacketWidth, rays.size() - first));
    for (uint32_t lane = 0; lane < count; ++lane) query.setRay(lane, rays[first + lane]);
    for (uint32_t lane = count; lane < kPacketWidth; ++lane) query.disable(lane);
    run(query);
    for (uint32_t lane = 0; lane < count; ++lane) each(query, first + lane, lane);
  }
}

}  // namespace

void TraceScene::intersect(std::span<const Ray> rays, std::span<Hit> hits, Coherence coherence) const {
  forEachPacket(
      rays, impl_->query(coherence), [&](embree::Query& query) { query.intersect(impl_->top.get()); },
      [&](const embree::Query& query, size_t ray, uint32_t lane) { hits[ray] = query.hit(lane); });
}

void TraceScene::occluded(std::span<const Ray> rays, std::span<uint8_t> occluded, Coherence coherence) const {
  forEachPacket(
      rays, impl_->query(coherence), [&](embree::Query& query) { query.occluded(impl_->top.get()); },
      [&](const embree::Query& query, size_t ray, uint32_t lane) { occluded[ray] = query.isOccluded(lane) ? 1 : 0; });
}

void TraceScene::shadows(std::span<const Ray> rays, const ShadowQuery& query, std::span<ShadowHits> results,
                         Coherence coherence) const {
  std::array<ShadowHits, kPacketWidth> before;
  ShadowRecorder recorder{*impl_, nullptr, nullptr, nullptr, query.resume ? before.data() : nullptr, {}};
  embree::Query packet = impl_->query(coherence);
  packet.setRecorder(&recorder);
  size_t first = 0;
  forEachPacket(
      rays, std::move(packet),
      [&](embree::Query& p) {
        const size_t count = std::min<size_t>(kPacketWidth, rays.size() - first);
        recorder.rays = &rays[first], recorder.results = &results[first];
        recorder.groups = query.groups.empty() ? nullptr : &query.groups[first];
        if (query.resume) std::copy_n(recorder.results, count, before.begin());
        for (size_t i = 0; i < count; ++i)
          results[first + i].occluded = results[first + i].overflow = false, results[first + i].count = 0;
        recorder.dropped.fill(std::numeric_limits<float>::infinity());
        p.occluded(impl_->top.get());
        first += count;
      },
      [&](const embree::Query& p, size_t, uint32_t lane) { recorder.finish(lane, p.isOccluded(lane)); });
}

bool TraceScene::needsShadowHits() const { return impl_->filtered; }

}  // namespace encore
