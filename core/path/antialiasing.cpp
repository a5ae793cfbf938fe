// Antialiasing samples of whole blocks in one pass (§2.1): positions, camera rays, first hits, what the film needs
// of them, and the direct layer, while all of it is in cache.
//
// Packets hold sixteen consecutive samples of the block, in slot order without the pixels outside of the image.
#include <atomic>
#include <limits>

#include "core/path/antialiasing_lanes.h"
#include "core/path/blocks.h"
#include "core/path/direct_layer.h"
#include "core/path/first_hits.h"
#include "core/path/footprint.h"
#include "core/path/path.h"
#include "core/shade/lights.h"

namespace encore {

namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Just short of infinity, where domes and distant lights would count.
constexpr float kBeyondLights = std::numeric_limits<float>::max();

// What is the same for every block of a call.
struct Batch {
  const ShadeContext& context;
  const CameraRays& camera;
  std::span<FirstHit> first;
  const SharedOutputs& shared;
  const SampleOutputs& direct;
  Strata strata;
  DirectWeights weights;
  PassThrough pass_through;
  std::vector<Light> camera_lights;
  bool any_direct, any_surface, footprints;
  bool aspects;     // other than 0
  bool keyed_rays;  // pixel and sample matter

  Batch(const ShadeContext& c, const CameraRays& rays, std::span<FirstHit> f, const SharedOutputs& s,
        const SampleOutputs& d)
      : context(c),
        camera(rays),
        first(f),
        shared(s),
        direct(d),
        strata(c.settings.samples),
        weights(c),
        pass_through(c, false),
        camera_lights(cameraLights(c.scene, c.settings)),
        any_direct(!d.key.empty() || !d.uv.empty() || !d.throughput.empty() || !d.footprint.empty() ||
                   !d.aspect.empty()),
        any_surface(any_direct || !s.normal.empty()),
        footprints(!d.footprint.empty() || c.settings.footprint_reuse == FootprintReuse::Octaves),
        aspects(needsAspect(c.settings)),
        keyed_rays(rays.moves() || rays.ownOrigins()) {}

  // A ray that hits nothing still covers what it shows of lights.
  bool seesBackground(Vec3f origin, Vec3f direction) const {
    if (context.settings.dome_light_visible) return true;
    return context.settings.lights_visible &&
           intersectLights(context.lights, context.scene.lights, origin, direction, kBeyondLights).valid;
  }
};

// Samples of a block that are finished later.
struct Unresolved {
  std::vector<FirstHit> first;  // hits whose material has to be evaluated
  std::vector<uint32_t> slots;  // of the batch
  // Those that have met presence, and their rays, whose indices are the slots.
  std::vector<FirstHit> passing;
  std::vector<Passage> passages;
};

// Sixteen samples on their way.
struct Packet {
  uint32_t count;
  const float *film_x, *film_y;
  const uint32_t* slots;  // of the batch
  RayPacket rays;
  HitPacket hits;
  SurfacePacket points;
  // Of the direct layer.
  PacketLanes<uint32_t> instance;  // of the key
  PacketLanes<float> u, v, footprint;
  Vec3f throughput[kPacketWidth];

  Vec3f direction(uint32_t lane) const { return {rays.dx[lane], rays.dy[lane], rays.dz[lane]}; }
  bool hit(uint32_t lane) const { return hits.instance[lane] != kNoInstance; }
};

// All samples of one block.
class BlockTracer {
 public:
  BlockTracer(const Batch& batch, BlockOrigin block, uint32_t first_slot)
      : batch_(batch),
        layout_(block, batch.context.settings),
        first_slot_(first_slot),
        tracer_(batch.context.trace, batch.camera.origin(), batch.camera.ownOrigins()) {
    const uint32_t capacity = kStaged + layout_.per_pixel + kPacketWidth;
    film_x_.resize(capacity), film_y_.resize(capacity), slots_.resize(capacity);
    if (batch.shared.position.empty()) position_.resize(layout_.per_pixel);
  }

  void run() {
    clear();
    uint32_t staged = 0;
    for (uint32_t py = 0; py < layout_.height; ++py)
      for (uint32_t px = 0; px < layout_.width; ++px) {
        stagePixel(px, py, staged);
        staged += layout_.per_pixel;
        if (staged >= kStaged) staged = tracePackets(staged);
      }
    staged = tracePackets(staged);
    if (staged > 0) tracePacket(0, staged);
  }

  uint32_t traced() const { return layout_.length(); }
  uint64_t onSurface() const { return on_surface_; }
  Unresolved& unresolved() { return unresolved_; }

 private:
  static constexpr uint32_t kStaged = 1024;  // samples whose rays are made at once, or a pixel's if those are more

  // Slots outside of the image; and depths, which only ever fall.
  void clear() {
    if (!batch_.shared.depth.empty()) {
      const auto depth = batch_.shared.depth.subspan(first_slot_ / layout_.per_pixel, kBlockArea);
      std::fill(depth.begin(), depth.end(), kInfinity);
    }
    for (uint32_t pixel = 0; pixel < kBlockArea; ++pixel) {
      if (layout_.inside(pixel % kBlockPixels, pixel / kBlockPixels)) continue;
      const uint32_t begin = first_slot_ + pixel * layout_.per_pixel;
      const auto zero = [&](auto span, auto value) {
        if (!span.empty()) std::fill_n(span.begin() + begin, layout_.per_pixel, value);
      };
      zero(batch_.first, FirstHit{});
      zero(batch_.shared.position, 0u), zero(batch_.shared.coverage, 0.0f), zero(batch_.shared.normal, Vec3f{});
      zero(batch_.direct.key, SurfaceKey{kNoInstance, 0}), zero(batch_.direct.uv, Vec2f{});
      zero(batch_.direct.throughput, Vec3f{}), zero(batch_.direct.footprint, 0.0f);
      zero(batch_.direct.aspect, Vec4f{});
    }
  }

  void stagePixel(uint32_t px, uint32_t py, uint32_t staged) {
    const uint32_t n = layout_.per_pixel;
    const uint32_t slot = first_slot_ + (py * kBlockPixels + px) * n;
    uint32_t* const position = position_.empty() ? &batch_.shared.position[slot] : position_.data();
    jitterPixel(batch_.strata, batch_.context.settings.seed, layout_.key(px, py), layout_.x0 + int32_t(px),
                layout_.y0 + int32_t(py), position, &film_x_[staged], &film_y_[staged]);
    for (uint32_t s = 0; s < n; ++s) slots_[staged + s] = slot + s;
  }

  // Traces what fills packets and moves the rest to the front; returns its size.
  uint32_t tracePackets(uint32_t staged) {
    uint32_t first = 0;
    for (; first + kPacketWidth <= staged; first += kPacketWidth) tracePacket(first, kPacketWidth);
    const auto move = [&](auto& values) { std::copy(values.begin() + first, values.begin() + staged, values.begin()); };
    move(film_x_), move(film_y_), move(slots_);
    return staged - first;
  }

  void tracePacket(uint32_t first, uint32_t count) {
    Packet packet;
    packet.count = count;
    packet.film_x = &film_x_[first], packet.film_y = &film_y_[first], packet.slots = &slots_[first];
    makeRays(packet);
    tracer_.intersect(packet.rays, count, packet.hits);
    if (batch_.pass_through.presence()) setAside(packet);
    if (batch_.any_surface) tracer_.surface(packet.rays, packet.hits, packet.points);
    if (batch_.any_direct) resolveDirect(packet);
    store(packet);
  }

  // Samples that may see what lies behind count as having met nothing until that is known.
  void setAside(Packet& p) {
    for (uint32_t i = 0; i < p.count; ++i) {
      if (!batch_.pass_through.mayPass(p.hits.hit(i), nullptr)) continue;
      unresolved_.passing.push_back(firstHit(p, i));
      Passage passage = cameraPassage(batch_.camera, unresolved_.passing.back(), batch_.pass_through.evaluates());
      passage.index = p.slots[i];
      unresolved_.passages.push_back(passage);
      const Hit none;
      p.hits.instance[i] = none.instance, p.hits.mesh[i] = none.mesh, p.hits.triangle[i] = none.triangle;
      p.hits.b1[i] = none.b1, p.hits.b2[i] = none.b2, p.hits.t[i] = none.t;
    }
  }

  void makeRays(Packet& p) const {
    if (!batch_.keyed_rays) return batch_.camera.rays(p.film_x, p.film_y, nullptr, nullptr, p.rays);
    PacketLanes<uint32_t> pixel, sample;
    for (uint32_t i = 0; i < kPacketWidth; ++i) {
      const uint32_t lane = std::min(i, p.count - 1);
      pixel[i] = pixelOf(p.slots[lane]), sample[i] = p.slots[lane] % layout_.per_pixel;
    }
    batch_.camera.rays(p.film_x, p.film_y, pixel, sample, p.rays);
  }
  uint32_t pixelOf(uint32_t slot) const {  // its key
    const uint32_t pixel = (slot - first_slot_) / layout_.per_pixel;
    return layout_.key(pixel % kBlockPixels, pixel / kBlockPixels);
  }

  void resolveDirect(Packet& p) {
    std::copy_n(p.hits.instance, kPacketWidth, p.instance);
    std::copy_n(p.points.u, kPacketWidth, p.u);
    std::copy_n(p.points.v, kPacketWidth, p.v);
    resolveThroughput(p);
    if (batch_.footprints)
      for (uint32_t i = 0; i < p.count; ++i) resolveFootprint(p, i);
    on_surface_ += countSurfaces(p.instance);
  }

  void resolveThroughput(Packet& p) {
    if (batch_.camera_lights.empty()) {
      // Most packets see one material, and most materials have one weight.
      const int32_t material = *std::max_element(p.points.material, p.points.material + kPacketWidth);
      const Vec3f* const constant = batch_.weights.constant(material);
      if (constant && uniform(p.hits.instance, p.points.material, material))
        return fillThroughput(p.hits.instance, *constant, p.throughput);
    }
    for (uint32_t i = 0; i < p.count; ++i) resolveLane(p, i);
  }

  Vec3f origin(const Packet& p, uint32_t i) const {
    return batch_.camera.ownOrigins() ? Vec3f{p.rays.ox[i], p.rays.oy[i], p.rays.oz[i]} : batch_.camera.origin();
  }

  // Lights that the camera sees, and materials that absorb a part of what arrives.
  void resolveLane(Packet& p, uint32_t i) {
    if (!batch_.camera_lights.empty()) {
      const LightHit light =
          intersectLights(batch_.context.lights, batch_.camera_lights, origin(p, i), p.direction(i), p.hits.t[i]);
      if (light.valid) return endWithout(p, i, carriesSomething(light.radiance) ? light.radiance : Vec3f{});
    }
    if (!p.hit(i)) return endWithout(p, i, {});
    const int32_t material = p.points.material[i];
    if (batch_.weights.varies(material)) {
      unresolved_.first.push_back(firstHit(p, i));
      unresolved_.slots.push_back(p.slots[i]);
      return endWithout(p, i, {});
    }
    const bool thin = batch_.weights.asksForThin(material) && isThin(p.hits.hit(i));
    p.throughput[i] = batch_.weights.weight(material, thin, p.points.primitive_side[i] & 1, viewCosine(p, i));
    if (!carriesSomething(p.throughput[i])) endWithout(p, i, {});
  }

  bool isThin(const Hit& hit) const {
    const Scene& scene = batch_.context.scene;
    const Prototype& prototype = scene.prototypes[scene.instances[hit.instance].prototype];
    return scene.meshes[prototype.meshes[hit.mesh]].thin_walled;
  }

  // To the normal that lobes use; see arrive().
  float viewCosine(const Packet& p, uint32_t i) {
    const Vec3f wo = -p.direction(i);
    const float cosine = dot(wo, {p.points.nx[i], p.points.ny[i], p.points.nz[i]});
    if (cosine > 0) return cosine;
    const Vec3f ng = tracer_.geometricNormal(p.rays, p.hits, i);
    return dot(wo, p.points.primitive_side[i] & 1 ? -ng : ng);
  }

  static void endWithout(Packet& p, uint32_t i, Vec3f radiance) {
    p.instance[i] = kNoInstance;
    p.u[i] = p.v[i] = 0;
    p.throughput[i] = radiance;
  }

  void resolveFootprint(Packet& p, uint32_t i) {
    p.footprint[i] = 0;
    if (p.instance[i] == kNoInstance) return;
    Vec3f dpdx, dpdy, dddx, dddy;
    const Vec3f ng = tracer_.geometricNormal(p.rays, p.hits, i);
    const ParameterGradients gradients = tracer_.gradients(p.hits, i);
    batch_.camera.differential({p.film_x[i], p.film_y[i], pixelOf(p.slots[i]), p.slots[i] % layout_.per_pixel}, dpdx,
                               dpdy, dddx, dddy);
    const auto step = [&](Vec3f dp, Vec3f dd) {
      return limited(transferDifferential(dp, dd, p.hits.t[i], p.direction(i), ng), batch_.context.trace.diagonal());
    };
    p.footprint[i] = gradients.footprint(step(dpdx, dddx), step(dpdy, dddy));
    p.instance[i] = reuseKey({p.instance[i], 0}, p.footprint[i], batch_.context.settings.footprint_reuse).instance;
  }

  FirstHit firstHit(const Packet& p, uint32_t i) const {
    FirstHit first{p.hits.hit(i), p.film_x[i], p.film_y[i], pixelOf(p.slots[i]), p.slots[i] % layout_.per_pixel};
    if (batch_.camera.moves() && first.hit.valid()) first.hit.time = p.rays.time[i];
    return first;
  }

  // Writes runs of consecutive slots; most packets are one.
  void store(const Packet& p) {
    for (uint32_t begin = 0, end; begin < p.count; begin = end) {
      end = p.count;
      if (p.slots[end - 1] - p.slots[begin] != end - 1 - begin)
        for (end = begin + 1; end < p.count && p.slots[end] == p.slots[end - 1] + 1;) ++end;
      storeRun(p, begin, end);
    }
    if (!batch_.shared.depth.empty()) storeDepth(p);
  }

  void storeRun(const Packet& p, uint32_t begin, uint32_t end) {
    const uint32_t slot = p.slots[begin];
    const SampleOutputs& direct = batch_.direct;
    const SharedOutputs& shared = batch_.shared;
    if (!direct.key.empty()) storeKeys(p.instance, p.points.primitive_side, begin, end, &direct.key[slot]);
    if (!direct.uv.empty()) storePairs(p.u, p.v, begin, end, &direct.uv[slot]);
    if (!direct.throughput.empty()) std::copy(p.throughput + begin, p.throughput + end, &direct.throughput[slot]);
    if (!direct.footprint.empty()) std::copy(p.footprint + begin, p.footprint + end, &direct.footprint[slot]);
    if (!direct.aspect.empty()) storeAspects(p, begin, end, &direct.aspect[slot]);
    if (!shared.normal.empty()) storeNormals(p.points, begin, end, &shared.normal[slot]);
    if (!shared.coverage.empty()) storeCoverage(p, begin, end, &shared.coverage[slot]);
    if (!batch_.first.empty())
      for (uint32_t i = begin; i < end; ++i) batch_.first[slot + i - begin] = firstHit(p, i);
  }

  void storeAspects(const Packet& p, uint32_t begin, uint32_t end, Vec4f* out) const {
    for (uint32_t i = begin; i < end; ++i) {
      const float time = batch_.camera.moves() ? p.rays.time[i] : 0;
      const bool surface = batch_.aspects && p.instance[i] != kNoInstance;
      out[i - begin] = surface ? aspectOf(batch_.context.settings, p.direction(i), time) : Vec4f{};
    }
  }

  void storeCoverage(const Packet& p, uint32_t begin, uint32_t end, float* out) const {
    storeHits(p.hits.instance, begin, end, out);
    const Settings& settings = batch_.context.settings;
    if (!settings.dome_light_visible && !settings.lights_visible) return;
    for (uint32_t i = begin; i < end; ++i)
      if (!p.hit(i) && batch_.seesBackground(origin(p, i), p.direction(i))) out[i - begin] = 1;
  }

  void storeDepth(const Packet& p) {
    PacketLanes<float> depth;
    batch_.camera.depths(p.rays, p.hits, depth);
    const uint32_t n = layout_.per_pixel, last = p.count - 1;
    const auto lower = [&](uint32_t pixel, float to) {
      float& lowest = batch_.shared.depth[pixel];
      lowest = to < lowest ? to : lowest;
    };
    const uint32_t pixel = p.slots[0] / n;
    if (p.slots[last] < (pixel + 1) * n) return lower(pixel, nearest(depth));  // lanes beyond count hit nothing
    for (uint32_t i = 0; i <= last; ++i) lower(p.slots[i] / n, depth[i]);
  }

  const Batch& batch_;
  const BlockLayout layout_;
  const uint32_t first_slot_;
  PacketTracer tracer_;
  std::vector<float> film_x_, film_y_;
  std::vector<uint32_t> slots_, position_;
  Unresolved unresolved_;
  uint64_t on_surface_ = 0;
};

void storePassed(const Batch& batch, const FirstHit& first, const Passage& p) {
  const SharedOutputs& shared = batch.shared;
  const bool hit = first.hit.valid();
  if (!batch.first.empty()) batch.first[p.index] = first;
  if (!shared.coverage.empty())
    shared.coverage[p.index] = hit || batch.seesBackground(p.ray.origin, p.ray.direction) ? 1 : 0;
  if (!hit) return;
  if (!shared.normal.empty()) {
    const SurfacePoint point = batch.context.trace.surface(first.hit, p.ray.direction, false);
    shared.normal[p.index] = point.side ? -point.ns : point.ns;
  }
  if (!shared.depth.empty()) {
    float& lowest = shared.depth[p.index / batch.strata.count()];
    lowest = std::min(lowest, batch.camera.depth(p.ray.origin + p.ray.direction * first.hit.t));
  }
}

// What lies behind presence: first hits, and what the film needs of them. The direct layer follows.
void resolvePassing(const Batch& batch, std::vector<Unresolved>& blocks) {
  std::vector<std::vector<Passage>> passages(blocks.size());
  for (size_t b = 0; b < blocks.size(); ++b) passages[b].swap(blocks[b].passages);
  batch.pass_through.run(passages);
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
    const FlushDenormals flush;
    for (size_t i = 0; i < passages[b].size(); ++i) {
      const Passage& p = passages[b][i];
      FirstHit& first = blocks[b].passing[i];
      first.hit = p.hit;
      storePassed(batch, first, p);
      if (!batch.any_direct) continue;
      blocks[b].first.push_back(first);
      blocks[b].slots.push_back(p.index);
    }
  });
}

// Samples on materials whose path inputs vary: evaluated together, and written into their slots.
uint64_t resolveVarying(const Batch& batch, std::vector<Unresolved>& blocks) {
  std::vector<FirstHit> first;
  std::vector<uint32_t> slots, ends;
  for (Unresolved& block : blocks) {
    if (block.first.empty()) continue;
    first.insert(first.end(), block.first.begin(), block.first.end());
    slots.insert(slots.end(), block.slots.begin(), block.slots.end());
    ends.push_back(uint32_t(first.size()));
    block = {};
  }
  if (first.empty()) return 0;
  std::vector<PathVertex> vertices(first.size());
  std::vector<float> footprint(batch.direct.footprint.empty() ? 0 : first.size());
  SampleOutputs out;
  out.footprint = footprint;
  // Vertices hold all the rest.
  const uint64_t on_surface = tracePaths(batch.context, batch.camera, Layer::Direct, first, ends, vertices, out);
  for (size_t i = 0; i < slots.size(); ++i) {
    const PathVertex& v = vertices[i];
    if (!batch.direct.key.empty()) batch.direct.key[slots[i]] = v.key;
    if (!batch.direct.uv.empty()) batch.direct.uv[slots[i]] = v.uv;
    if (!batch.direct.throughput.empty()) batch.direct.throughput[slots[i]] = v.throughput;
    if (!footprint.empty()) batch.direct.footprint[slots[i]] = footprint[i];
    if (!batch.direct.aspect.empty()) batch.direct.aspect[slots[i]] = v.aspect;
  }
  return on_surface;
}

}  // namespace

uint64_t traceAntialiasing(const ShadeContext& context, const CameraRays& camera, std::span<const BlockOrigin> blocks,
                           std::span<FirstHit> first, const SharedOutputs& shared, const SampleOutputs& direct) {
  const Batch batch(context, camera, first, shared, direct);
  const uint32_t slots_per_block = kBlockArea * batch.strata.count();
  std::vector<Unresolved> unresolved(blocks.size());
  std::atomic<uint64_t> on_surface{0};
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
    const FlushDenormals flush;
    BlockTracer tracer(batch, blocks[b], uint32_t(b) * slots_per_block);
    tracer.run();
    context.rays_traced.fetch_add(tracer.traced(), std::memory_order_relaxed);
    on_surface.fetch_add(tracer.onSurface(), std::memory_order_relaxed);
    unresolved[b] = std::move(tracer.unresolved());
  });
  if (batch.pass_through.presence()) resolvePassing(batch, unresolved);
  return on_surface + resolveVarying(batch, unresolved);
}

}  // namespace encore
