// Antialiasing rays once more: single ones that have to be known again, and all of them for their speed alone.
#include <atomic>

#include "core/path/antialiasing_samples.h"
#include "core/path/blocks.h"
#include "core/path/path.h"

namespace encore {

namespace {

// One packet of a block's sequence, made from nothing but its number.
class NumberedPacket {
 public:
  NumberedPacket(const Strata& strata, const BlockLayout& layout, const Settings& settings, uint32_t number)
      : count_(std::min(kPacketWidth, layout.length() - number * kPacketWidth)) {
    for (uint32_t lane = 0; lane < count_; ++lane) {
      const uint32_t slot = layout.slot(number * kPacketWidth + lane), s = slot % strata.count();
      const uint32_t in_block = slot / strata.count();
      const uint32_t px = in_block % kBlockPixels, py = in_block / kBlockPixels;
      const int32_t x = layout.x0 + int32_t(px), y = layout.y0 + int32_t(py);
      pixel_[lane] = layout.key(px, py), sample_[lane] = s;
      const Strata::Pattern pattern = strata.pattern(pixel_[lane], settings.seed);
      const uint32_t position =
          jitteredPosition(pattern.column[s], pattern.row[s], strata.across(), pixel_[lane], s, settings.seed);
      film_x_[lane] = filmX(x, position), film_y_[lane] = filmY(y, position);
    }
  }

  uint32_t count() const { return count_; }
  RayPacket rays(const CameraRays& camera) const {
    RayPacket rays;
    camera.rays(film_x_, film_y_, pixel_, sample_, rays);
    return rays;
  }
  FirstHit firstHit(const CameraRays& camera, uint32_t lane, const HitPacket& hits) const {
    FirstHit first{hits.hit(lane), film_x_[lane], film_y_[lane], pixel_[lane], sample_[lane]};
    if (first.hit.valid()) first.hit.time = camera.time(CameraRays::sampleOf(first));
    return first;
  }

 private:
  uint32_t count_;
  PacketLanes<float> film_x_{}, film_y_{};
  PacketLanes<uint32_t> pixel_{}, sample_{};
};

// Slots of one block, ascending, within the block.
class BlockRetrace {
 public:
  BlockRetrace(const ShadeContext& context, const CameraRays& camera, const Strata& strata, BlockOrigin block)
      : context_(context),
        camera_(camera),
        strata_(strata),
        layout_(block, context.settings),
        tracer_(context.trace, camera.origin(), camera.ownOrigins()),
        packet_(strata, layout_, context.settings, 0) {}

  FirstHit trace(uint32_t slot) {
    const uint32_t pixel = slot / strata_.count();
    if (!layout_.inside(pixel % kBlockPixels, pixel / kBlockPixels)) return {};
    const uint32_t place = layout_.place(slot);
    if (place / kPacketWidth != number_) tracePacket(place / kPacketWidth);
    return packet_.firstHit(camera_, place % kPacketWidth, hits_);
  }

 private:
  void tracePacket(uint32_t number) {
    number_ = number;
    packet_ = NumberedPacket(strata_, layout_, context_.settings, number);
    tracer_.intersect(packet_.rays(camera_), packet_.count(), hits_);
    context_.rays_traced.fetch_add(packet_.count(), std::memory_order_relaxed);
  }

  const ShadeContext& context_;
  const CameraRays& camera_;
  const Strata& strata_;
  const BlockLayout layout_;
  PacketTracer tracer_;
  NumberedPacket packet_;
  HitPacket hits_;
  uint32_t number_ = 0xffffffffu;  // of the packet that hits_ is of
};

}  // namespace

void retraceFirstHits(const ShadeContext& context, const CameraRays& camera, std::span<const BlockOrigin> blocks,
                      std::span<const uint32_t> slots, std::span<FirstHit> first) {
  const Strata strata(context.settings.samples);
  const uint64_t slots_per_block = uint64_t{kBlockArea} * strata.count();
  std::vector<uint32_t> ends;
  for (size_t b = 1; b <= blocks.size(); ++b)
    ends.push_back(uint32_t(std::lower_bound(slots.begin(), slots.end(), b * slots_per_block) - slots.begin()));
  forEachBlock(ends, [&](size_t b, uint32_t begin, uint32_t end) {
    if (begin == end) return;
    BlockRetrace block(context, camera, strata, blocks[b]);
    for (uint32_t k = begin; k < end; ++k) first[k] = block.trace(uint32_t(slots[k] - b * slots_per_block));
  });
}

RawTrace timeRawPrimaryRays(const TraceScene& trace, const CameraRays& camera, const Settings& settings) {
  constexpr size_t kPackets = 256;  // filled before they are timed
  const Strata strata(settings.samples);
  std::vector<BlockOrigin> blocks;
  for (uint32_t y = 0; y < settings.height; y += kBlockPixels)
    for (uint32_t x = 0; x < settings.width; x += kBlockPixels) blocks.push_back({int32_t(x), int32_t(y)});
  std::atomic<uint64_t> rays{0}, nanoseconds{0};
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
    const FlushDenormals flush;
    const BlockLayout layout(blocks[b], settings);
    PacketTracer tracer(trace, camera.origin(), camera.ownOrigins());
    std::vector<RayPacket> packets;
    double seconds = 0;
    // Whole packets only: the last one of a block may be short, and is left out.
    const uint32_t whole = layout.length() / kPacketWidth;
    for (uint32_t number = 0; number < whole; ++number) {
      packets.push_back(NumberedPacket(strata, layout, settings, number).rays(camera));
      if (packets.size() < kPackets && number + 1 < whole) continue;
      seconds += tracer.rawSeconds(packets);
      packets.clear();
    }
    rays += uint64_t{whole} * kPacketWidth;
    nanoseconds += uint64_t(seconds * 1e9);
  });
  return {rays, double(nanoseconds) * 1e-9 / double(tbb::this_task_arena::max_concurrency())};
}

}  // namespace encore
