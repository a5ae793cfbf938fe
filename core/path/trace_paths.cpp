// Listing 2, for a whole batch at a time: one wavefront per bounce.
//
// Where this leaves the listing as printed: the recursion is a loop over bounces; effects of the first hit
// are forced by the layer (§2.4); lights and the background end a path too, with their radiance.
#include <atomic>

#include "core/path/blocks.h"
#include "core/path/differentials.h"
#include "core/path/direct_layer.h"
#include "core/path/footprint.h"
#include "core/path/pass_through.h"
#include "core/path/path.h"
#include "core/path/path_materials.h"
#include "core/shade/lights.h"
#include "core/trace/pattern_points.h"
#include "core/trace/traced_triangle.h"

namespace encore {

namespace {

// A path that ended on a light, on the background or nowhere.
void endWithout(PathVertex& vertex, Vec3f radiance) {
  vertex.hit = {};
  vertex.key = {kNoInstance, 0};
  vertex.throughput = vertex.throughput * radiance;
  if (!carriesSomething(vertex.throughput)) vertex.throughput = {};
  vertex.dpdx = vertex.dpdy = {};
}

// What is known of a ray before it is traced.
struct Flight {
  uint32_t path, place;  // place: among the paths of its block
  bool reflected;
  Spread spread;
};

// The paths of one block that have arrived on a surface.
struct BlockPaths {
  std::vector<uint32_t> paths;  // indices into the vertices
  // How the ray of each spreads; empty in the direct layer, where it is the camera's. The change of its origin is in
  // the vertex's dpdx and dpdy until the ray arrives.
  std::vector<Spread> spreads;
  std::vector<Interior> interiors;  // the solids that each is in, where there are any
  size_t first_input = 0;           // of the block, in the batch's evaluated inputs
  // Those that have met what they may pass.
  std::vector<Passage> passages;
  std::vector<Flight> held;
};

bool atFiniteDistance(const Light& light) {
  return light.kind != Light::Kind::Dome && light.kind != Light::Kind::Distant;
}

// Somebody looks at how pixels spread: footprints of (u, v), or textures.
bool readsSpread(const ShadeContext& context) {
  if (needsFootprints(context.settings) || context.settings.method == Method::Vertex) return true;
  return context.patterns.readsTextures();
}

class Wavefront {
 public:
  Wavefront(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
            std::span<const uint32_t> ends, std::span<PathVertex> vertices, const SampleOutputs& out)
      : context_(context),
        camera_(camera),
        layer_(layer),
        first_(first),
        ends_(ends),
        vertices_(vertices),
        out_(out),
        lean_(!out.key.empty() || !out.throughput.empty()),
        footprints_(!out.footprint.empty() || needsFootprints(context.settings)),
        spreads_(!lean_ || footprints_ || readsSpread(context)),
        aspects_(needsAspect(context.settings)),
        camera_lights_(cameraLights(context.scene, context.settings)),
        materials_(context, layer),
        pass_through_(context, layer != Layer::Direct) {
    std::copy_if(context.scene.lights.begin(), context.scene.lights.end(), std::back_inserter(finite_lights_),
                 atFiniteDistance);
  }

  // Returns the number of paths that end on a surface.
  uint64_t run() {
    if (materials_.anyVaries() || (layer_ != Layer::Direct && pass_through_.evaluates()))
      runTogether();
    else
      runApart();
    return on_surface_;
  }

 private:
  // Nothing has to be evaluated for the whole batch: each block goes through all of its bounces in cache.
  void runApart() {
    forEachBlock(ends_, [&](size_t, uint32_t begin, uint32_t end) {
      BlockPaths block = start(begin, end);
      const std::vector<uint32_t> started = block.paths;
      if (!started.empty()) {
        TriangleCache triangles(context_.trace);
        for (uint32_t bounce = 0; !block.paths.empty(); ++bounce) {
          advance(block, bounce, triangles);
          if (block.passages.empty()) continue;
          pass_through_.run(std::span(&block.passages, 1));
          land(block);
        }
      }
      store(started);
    });
  }

  // All blocks wait for each other at every bounce, so that path inputs take one dispatch.
  void runTogether() {
    std::vector<BlockPaths> blocks(ends_.size());
    forEachBlock(ends_, [&](size_t block, uint32_t begin, uint32_t end) { blocks[block] = start(begin, end); });
    std::vector<std::vector<uint32_t>> started;
    for (const BlockPaths& block : blocks) started.push_back(block.paths);
    const auto active = [](const BlockPaths& block) { return !block.paths.empty(); };
    for (uint32_t bounce = 0; std::any_of(blocks.begin(), blocks.end(), active); ++bounce) {
      evaluatePathInputs(blocks);
      forEachBlock(ends_, [&](size_t block, uint32_t, uint32_t) {
        if (!active(blocks[block])) return;
        TriangleCache triangles(context_.trace);
        advance(blocks[block], bounce, triangles);
      });
      passThrough(blocks);
    }
    forEachBlock(ends_, [&](size_t block, uint32_t, uint32_t) { store(started[block]); });
  }

  void passThrough(std::vector<BlockPaths>& blocks) {
    const auto holds = [](const BlockPaths& block) { return !block.passages.empty(); };
    if (std::none_of(blocks.begin(), blocks.end(), holds)) return;
    std::vector<std::vector<Passage>> passages(blocks.size());
    for (size_t b = 0; b < blocks.size(); ++b) passages[b].swap(blocks[b].passages);
    pass_through_.run(passages);
    for (size_t b = 0; b < blocks.size(); ++b) passages[b].swap(blocks[b].passages);
    forEachBlock(ends_, [&](size_t b, uint32_t, uint32_t) { land(blocks[b]); });
  }

  // The values of finished paths.
  void store(std::span<const uint32_t> paths) {
    uint64_t on_surface = 0;
    for (const uint32_t i : paths) {
      on_surface += vertices_[i].hit.valid();
      store(i);
    }
    on_surface_.fetch_add(on_surface, std::memory_order_relaxed);
  }
  void store(uint32_t i) {
    const PathVertex& v = vertices_[i];
    if (!out_.key.empty()) out_.key[i] = v.key;
    if (!out_.uv.empty()) out_.uv[i] = v.uv;
    if (!out_.throughput.empty()) out_.throughput[i] = v.throughput;
    if (!out_.footprint.empty()) out_.footprint[i] = v.footprint;
    if (!out_.aspect.empty()) out_.aspect[i] = v.aspect;
  }

  // What most slots of a layer keep: nothing.
  void clear(uint32_t begin, uint32_t end) {
    const auto fill = [&](auto values, auto value) {
      if (!values.empty()) std::fill(values.begin() + begin, values.begin() + end, value);
    };
    fill(out_.key, SurfaceKey{kNoInstance, 0}), fill(out_.uv, Vec2f{});
    fill(out_.throughput, Vec3f{}), fill(out_.footprint, 0.0f), fill(out_.aspect, Vec4f{});
  }

  BlockPaths start(uint32_t begin, uint32_t end) {
    clear(begin, end);
    BlockPaths block;
    FirstFeeds feeds{*this};
    for (uint32_t i = begin; i < end; ++i) {
      if (!startPath(i, feeds)) continue;
      block.paths.push_back(i);
      if (layer_ != Layer::Direct) block.spreads.push_back(cameraSpread(i));
    }
    if (pass_through_.solids()) block.interiors.resize(block.paths.size());
    return block;
  }

  // Whether a first hit feeds the layer: neighbours mostly share the answer.
  struct FirstFeeds {
    const Wavefront& wavefront;
    Hit last{};
    bool feeds = false;

    bool operator()(const Hit& hit) {
      if (hit.triangle == last.triangle && hit.mesh == last.mesh && hit.instance == last.instance) return feeds;
      last = hit;
      feeds = hit.valid() && wavefront.materials_[wavefront.context_.trace.material(hit)].feeds_layer;
      return feeds;
    }
  };

  // The first hit as the camera sees it. False: the path has ended already.
  bool startPath(uint32_t i, FirstFeeds& feeds) {
    const FirstHit& first = first_[i];
    const bool follows = first.active() && feeds(first.hit);
    if (!follows && lean_ && layer_ != Layer::Direct) return false;  // the outputs have it already
    PathVertex& vertex = vertices_[i];
    vertex = {};
    vertex.hit = first.hit, vertex.throughput = {1, 1, 1}, vertex.pixel = first.pixel, vertex.sample = first.sample;
    if (!first.active()) return endWithout(vertex, {}), false;
    const Ray ray = camera_.ray(first);
    vertex.direction = ray.direction;
    if (!camera_lights_.empty()) {
      const LightHit light = intersectLights(context_.lights, camera_lights_, ray.origin, ray.direction, first.hit.t);
      // What covers the camera's ray belongs to the direct layer only.
      if (light.valid) {
        endWithout(vertex, layer_ == Layer::Direct ? light.radiance : Vec3f{});
        return store(i), false;
      }
    }
    if (!follows) return endWithout(vertex, {}), false;
    if (spreads_ && camera_.ownOrigins()) {
      Spread spread;
      camera_.differential(CameraRays::sampleOf(first), vertex.dpdx, vertex.dpdy, spread.x, spread.y);
    }
    return true;
  }

  Spread cameraSpread(uint32_t i) const {
    Spread spread;
    Vec3f dpdx, dpdy;
    if (spreads_) camera_.differential(CameraRays::sampleOf(first_[i]), dpdx, dpdy, spread.x, spread.y);
    return spread;
  }
  Spread spreadOf(const BlockPaths& block, size_t k) const {
    return layer_ == Layer::Direct ? cameraSpread(block.paths[k]) : block.spreads[k];
  }

  // Moves the pixel's footprint from where the ray left to where it arrived, on the plane of the triangle.
  void arriveFootprint(PathVertex& v, const Spread& spread, const SurfacePoint& point) const {
    if (!spreads_) return;
    const float longest = context_.trace.diagonal();  // no two points of the scene are further apart
    v.dpdx = limited(transferDifferential(v.dpdx, spread.x, v.hit.t, v.direction, point.ng), longest);
    v.dpdy = limited(transferDifferential(v.dpdy, spread.y, v.hit.t, v.direction, point.ng), longest);
  }

  // Path inputs of all active hits whose material varies, in one dispatch for the batch; those of a block
  // stand together, in the order of its paths.
  void evaluatePathInputs(std::vector<BlockPaths>& blocks) {
    std::vector<PatternPoints> block_points(blocks.size());
    forEachBlock(ends_, [&](size_t b, uint32_t, uint32_t) {
      for (size_t k = 0; k < blocks[b].paths.size(); ++k) {
        const PathVertex& v = vertices_[blocks[b].paths[k]];
        if (materials_[context_.trace.material(v.hit)].varies) addPathPoint(v, spreadOf(blocks[b], k), block_points[b]);
      }
    });
    PatternPoints points;
    for (size_t b = 0; b < blocks.size(); ++b) {
      blocks[b].first_input = points.size();
      points.append(block_points[b]);
    }
    inputs_.resize(points.size());
    if (!points.empty()) context_.patterns.evaluate(points, inputs_);
  }

  void addPathPoint(PathVertex v, const Spread& spread, PatternPoints& points) const {
    const SurfacePoint point = context_.trace.surface(v.hit, v.direction, false);
    arriveFootprint(v, spread, point);
    appendPatternPoint(context_.trace, context_.patterns.layout(PatternPart::Path, point.material), v.hit, point,
                       v.direction, v.dpdx, v.dpdy, points);
  }

  // One effect for every active path of a block, and the rays of those that go on.
  void advance(BlockPaths& block, uint32_t bounce, TriangleCache& triangles) {
    BlockPaths next;
    next.paths.reserve(block.paths.size()), next.spreads.reserve(block.paths.size());
    const auto meet = [&](const Flight& flight, const Ray& ray, const Hit& hit) {
      const Interior* const interior = block.interiors.empty() ? nullptr : &block.interiors[flight.place];
      if (pass_through_.mayPass(hit, interior)) return hold(next, flight, ray, hit, interior, bounce);
      arriveAt(next, flight, ray, hit, interior);
    };
    // Paths of neighbouring samples stay close enough for packets, even after several bounces.
    RayQueue<Flight, decltype(meet)> queue(context_, Coherence::Coherent, meet);
    size_t next_input = block.first_input;
    for (uint32_t k = 0; k < block.paths.size(); ++k) {
      PathVertex& v = vertices_[block.paths[k]];
      TracedTriangle& triangle = triangles.triangle(v.hit);
      const PathMaterial& material = materials_[triangle.material()];
      SurfacePoint point = triangle.surface(v.hit, v.direction);
      const PathInputs* const inputs = material.varies ? &inputs_[next_input++] : nullptr;
      const Spread spread = spreadOf(block, k);
      if (bounce > 0 && material.absorbs_all[point.thin][point.side]) {
        arriveFootprint(v, spread, point);
        absorb(v, point);
        continue;
      }
      if (material.mapped) materials_.mapNormal(v.hit, inputs, point);
      Interface interface;
      if (!block.interiors.empty() && !point.thin && pass_through_.isSolid(point.material)) {
        interface.interior = &block.interiors[k];
        interface.solid = pass_through_.solidOf(v.hit, point.material, inputs);
        interface.other_ior = interface.interior->outside(interface.solid, point.side != 0);
      }
      const Arrival arrival = arrive(point, v.direction, materials_.lobesOf(point, inputs, interface.other_ior),
                                     material.view_weight_in_shading);
      follow({block.paths[k], k, false, spread}, arrival, interface, bounce, triangle, queue);
    }
    queue.finish();
    block = std::move(next);
  }

  // Of a solid.
  struct Interface {
    Interior* interior = nullptr;  // of the path; null: not a solid's
    Solid solid;
    float other_ior = 1;
  };

  // Waits until what it met is known to stop it.
  void hold(BlockPaths& block, const Flight& flight, const Ray& ray, const Hit& hit, const Interior* interior,
            uint32_t bounce) const {
    const PathVertex& v = vertices_[flight.path];
    block.passages.push_back({ray, hit, v.pixel, v.sample, 1 + bounce * kMaxLayers + uint32_t(layer_), v.dpdx, v.dpdy,
                              flight.spread, interior ? *interior : Interior{}, uint32_t(block.held.size())});
    block.held.push_back(flight);
  }
  void land(BlockPaths& block) {
    for (const Passage& p : block.passages)
      arriveAt(block, block.held[p.index], p.ray, p.hit, pass_through_.solids() ? &p.interior : nullptr);
    block.passages.clear(), block.held.clear();
  }

  // The path ends on this surface.
  void absorb(PathVertex& vertex, const SurfacePoint& point) const {
    vertex.key = point.key(vertex.hit.instance);
    vertex.uv = point.uv;
    if (aspects_) vertex.aspect = aspectOf(context_.settings, vertex.direction, vertex.hit.time);
    if (!footprints_) return;
    vertex.footprint = context_.trace.parametricFootprint(vertex.hit, point, vertex.dpdx, vertex.dpdy);
    vertex.key = reuseKey(vertex.key, vertex.footprint, context_.settings.footprint_reuse);
  }

  template <class Queue>
  void follow(Flight flight, const Arrival& arrival, const Interface& interface, uint32_t bounce,
              TracedTriangle& triangle, Queue& queue) {
    PathVertex& vertex = vertices_[flight.path];
    const BounceRandom random(context_.settings.seed, vertex.pixel, vertex.sample, layer_, bounce);
    const ChosenEffect chosen = choose(arrival, bounce, random);
    if (!(chosen.probability > 0)) return endWithout(vertex, {});
    arriveFootprint(vertex, flight.spread, arrival.point);
    vertex.throughput *= 1 / chosen.probability;
    if (chosen.effect == Effect::Absorb) {
      vertex.throughput *= arrival.weights().absorption;
      if (!carriesSomething(vertex.throughput)) return endWithout(vertex, {});
      return absorb(vertex, arrival.point);
    }
    const Departure departure = depart(arrival, chosen.effect, random);
    vertex.throughput *= departure.weight;
    if (!departure.valid || !carriesSomething(vertex.throughput)) return endWithout(vertex, {});
    flight.reflected = chosen.effect == Effect::Reflect;
    if (interface.interior && !flight.reflected) interface.interior->pass(interface.solid, arrival.point.side != 0);
    if (spreads_) flight.spread = bend(arrival, departure, chosen.effect, vertex, flight.spread, triangle);
    vertex.direction = departure.direction;
    SurfacePoint point = arrival.point;
    point.position_error = triangle.positionError(vertex.hit, point);  // only rays that leave need it
    Ray ray{point.offsetOrigin(departure.direction), 0, departure.direction};
    ray.time = vertex.hit.time;
    queue.push(ray, flight);
  }

  // First hits do what the layer is for, with certainty; the last allowed bounce leaves only absorption,
  // so that what would have gone on is lost and nothing gains by it.
  ChosenEffect choose(const Arrival& arrival, uint32_t bounce, const BounceRandom& random) const {
    if (bounce == 0 && layer_ == Layer::Direct) return {Effect::Absorb, 1};
    if (bounce >= context_.settings.max_bounces) return {Effect::Absorb, bounce == 0 ? 0.0f : 1.0f};
    if (bounce == 0) return {layer_ == Layer::Reflection ? Effect::Reflect : Effect::Refract, 1};
    return chooseEffect(arrival.weights(), random);
  }

  Spread bend(const Arrival& arrival, const Departure& departure, Effect effect, const PathVertex& vertex,
              const Spread& spread, TracedTriangle& triangle) const {
    const auto one = [&](Vec3f dp, Vec3f dd) {
      if (effect == Effect::Refract && arrival.lobes.thin) return dd;
      const Vec2f b = triangle.barycentricChange(dp);
      const Vec3f dn = departure.dn1 * b.x + departure.dn2 * b.y;
      const Vec3f bent = effect == Effect::Reflect ? reflectDifferential(vertex.direction, departure.normal, dd, dn)
                                                   : refractDifferential(vertex.direction, departure.direction,
                                                                         departure.normal, arrival.lobes.eta, dd, dn);
      return limited(bent, kLargestDirectionChange);
    };
    const Spread bent{one(vertex.dpdx, spread.x), one(vertex.dpdy, spread.y)};
    if (!(departure.lobe_width > 0)) return bent;
    // The samples of a pixel share the lobe.
    const Spread wide = widened(bent, departure.direction, departure.lobe_width / float(context_.settings.samples));
    return {limited(wide.x, kLargestDirectionChange), limited(wide.y, kLargestDirectionChange)};
  }

  // The path goes on from what it met, or has ended on a light or on nothing.
  void arriveAt(BlockPaths& block, const Flight& flight, const Ray& ray, const Hit& hit, const Interior* interior) {
    PathVertex& vertex = vertices_[flight.path];
    // Nothing at infinity is seen beyond a hit.
    const std::span<const Light> lights = hit.valid() ? finite_lights_ : context_.scene.lights;
    const LightHit light = intersectLights(context_.lights, lights, ray.origin, ray.direction, hit.t);
    if (light.valid) return endWithout(vertex, flight.reflected ? light.specular_radiance : light.radiance);
    if (!hit.valid()) return endWithout(vertex, {});
    vertex.hit = hit;
    block.paths.push_back(flight.path);
    block.spreads.push_back(flight.spread);
    if (interior) block.interiors.push_back(*interior);
  }

  const ShadeContext& context_;
  const CameraRays& camera_;
  Layer layer_;
  std::span<const FirstHit> first_;
  std::span<const uint32_t> ends_;
  std::span<PathVertex> vertices_;
  const SampleOutputs& out_;
  bool lean_;  // nobody reads vertices of paths that end without a surface
  bool footprints_, spreads_, aspects_;
  std::atomic<uint64_t> on_surface_{0};
  std::vector<Light> camera_lights_, finite_lights_;
  PathMaterials materials_;
  PassThrough pass_through_;
  std::vector<PathInputs> inputs_;  // of the active paths whose material varies
};

}  // namespace

uint64_t tracePaths(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
                    std::span<const uint32_t> ends, std::span<PathVertex> vertices, const SampleOutputs& out) {
  return Wavefront(context, camera, layer, first, ends, vertices, out).run();
}

}  // namespace encore
