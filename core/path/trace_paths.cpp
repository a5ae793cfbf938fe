// Listing 2, for a whole batch at a time: one wavefront per bounce.
//
// Where this leaves the listing as printed: the recursion is a loop over bounces; effects of the first hit
// are forced by the layer (§2.4); lights and the background end a path too, with their radiance.
#include <atomic>

#include "core/path/blocks.h"
#include "core/path/differentials.h"
#include "core/path/direct_layer.h"
#include "core/path/footprint.h"
#include "core/path/path.h"
#include "core/path/scatter.h"
#include "core/shade/lights.h"
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

// How the direction of a path's ray changes over a pixel step. The change of its origin is kept in the
// vertex's dpdx and dpdy until the ray arrives.
struct Spread {
  Vec3f x, y;
};

// The paths of one block that have arrived on a surface, and how their rays spread.
struct BlockPaths {
  std::vector<uint32_t> paths;  // indices into the vertices, ascending
  std::vector<Spread> spreads;  // of each; empty in the direct layer, where it is the camera's
  size_t first_input = 0;       // of the block, in the batch's evaluated inputs
};

// What all hits on a material share.
struct PathMaterial {
  bool feeds_layer = false;
  bool varies = false;  // the lobes are those of each hit's inputs
  bool view_weight_in_shading = false;
  Lobes lobes[2];  // by side
  bool absorbs_all[2] = {false, false};
};

bool atFiniteDistance(const Light& light) {
  return light.kind != Light::Kind::Dome && light.kind != Light::Kind::Distant;
}

// Somebody looks at how pixels spread: footprints of (u, v), or textures.
bool readsSpread(const ShadeContext& context) {
  if (needsFootprints(context.settings) || context.settings.method == Method::Vertex) return true;
  for (int32_t i = 0; i < int32_t(context.scene.materials.size()); ++i)
    if (!context.patterns.texcoordName(i).empty()) return true;
  return false;
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
        camera_lights_(cameraLights(context.scene, context.settings)) {
    const bool delta = anyDelta(context.scene.lights);
    for (const Material& material : context.scene.materials) materials_.push_back(makeMaterial(material, delta));
    std::copy_if(context.scene.lights.begin(), context.scene.lights.end(), std::back_inserter(finite_lights_),
                 atFiniteDistance);
  }

  // Returns the number of paths that end on a surface.
  uint64_t run() {
    if (std::any_of(materials_.begin(), materials_.end(), [](const PathMaterial& m) { return m.varies; }))
      runTogether();
    else
      runApart();
    return on_surface_;
  }

 private:
  PathMaterial makeMaterial(const Material& material, bool zero_extent_lights) const {
    const float limit = context_.settings.roughness_limit;
    const int32_t index = int32_t(materials_.size());
    PathMaterial m;
    m.feeds_layer = layer_ == Layer::Direct ||
                    (layer_ == Layer::Reflection ? feedsReflection(material, limit) : feedsRefraction(material));
    m.varies = context_.patterns.pathVaries(index);
    m.view_weight_in_shading = viewWeightInShading(material, limit, zero_extent_lights);
    if (m.varies) return m;
    for (const bool back : {false, true}) {
      m.lobes[back] = makeLobes(material, context_.patterns.constantPath(index), back, limit);
      m.absorbs_all[back] = absorbsAll(m.lobes[back], m.view_weight_in_shading);
    }
    return m;
  }

  // Nothing has to be evaluated for the whole batch: each block goes through all of its bounces in cache.
  void runApart() {
    forEachBlock(ends_, [&](size_t, uint32_t begin, uint32_t end) {
      BlockPaths block = start(begin, end);
      const std::vector<uint32_t> started = block.paths;
      if (!started.empty()) {
        TriangleCache triangles(context_.trace);
        for (uint32_t bounce = 0; !block.paths.empty(); ++bounce) advance(block, bounce, triangles);
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
    }
    forEachBlock(ends_, [&](size_t block, uint32_t, uint32_t) { store(started[block]); });
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
  }

  // What most slots of a layer keep: nothing.
  void clear(uint32_t begin, uint32_t end) {
    const auto fill = [&](auto values, auto value) {
      if (!values.empty()) std::fill(values.begin() + begin, values.begin() + end, value);
    };
    fill(out_.key, SurfaceKey{kNoInstance, 0}), fill(out_.uv, Vec2f{});
    fill(out_.throughput, Vec3f{}), fill(out_.footprint, 0.0f);
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
      feeds = hit.valid() && wavefront.materials_[size_t(wavefront.context_.trace.material(hit))].feeds_layer;
      return feeds;
    }
  };

  // The first hit as the camera sees it. False: the path has ended already.
  bool startPath(uint32_t i, FirstFeeds& feeds) {
    const FirstHit& first = first_[i];
    const bool follows = first.active() && feeds(first.hit);
    if (!follows && lean_ && layer_ != Layer::Direct) return false;  // the outputs have it already
    PathVertex& vertex = vertices_[i];
    vertex = {first.hit, {1, 1, 1}, {}, {}, {}, first.pixel, first.sample, {kNoInstance, 0}, {}};
    if (!first.active()) return endWithout(vertex, {}), false;
    vertex.direction = camera_.ray(first.film_x, first.film_y).direction;
    if (!camera_lights_.empty()) {
      const LightHit light = intersectLights(camera_lights_, camera_.origin(), vertex.direction, first.hit.t);
      // What covers the camera's ray belongs to the direct layer only.
      if (light.valid) {
        endWithout(vertex, layer_ == Layer::Direct ? light.radiance : Vec3f{});
        return store(i), false;
      }
    }
    if (!follows) return endWithout(vertex, {}), false;
    return true;
  }

  Spread cameraSpread(uint32_t i) const {
    Spread spread;
    if (spreads_) camera_.differential(first_[i].film_x, first_[i].film_y, spread.x, spread.y);
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
    std::vector<std::vector<PatternPoint>> block_points(blocks.size());
    forEachBlock(ends_, [&](size_t b, uint32_t, uint32_t) {
      for (size_t k = 0; k < blocks[b].paths.size(); ++k) {
        const PathVertex& v = vertices_[blocks[b].paths[k]];
        if (materials_[size_t(context_.trace.material(v.hit))].varies)
          block_points[b].push_back(patternPoint(v, spreadOf(blocks[b], k)));
      }
    });
    std::vector<PatternPoint> points;
    for (size_t b = 0; b < blocks.size(); ++b) {
      blocks[b].first_input = points.size();
      points.insert(points.end(), block_points[b].begin(), block_points[b].end());
    }
    inputs_.resize(points.size());
    if (!points.empty()) context_.patterns.evaluatePath(points, inputs_);
  }

  PatternPoint patternPoint(PathVertex v, const Spread& spread) const {
    const SurfacePoint point = context_.trace.surface(v.hit, v.direction, false);
    arriveFootprint(v, spread, point);
    const std::string& name = context_.patterns.texcoordName(point.material);
    const int32_t slot = name.empty() ? -1 : context_.trace.texcoordSlot(v.hit, name);
    const TexcoordPoint t = context_.trace.texcoord(v.hit, point, slot, v.dpdx, v.dpdy);
    return {uint32_t(point.material), t.st, t.dstdx, t.dstdy, context_.trace.displayColor(v.hit)};
  }

  // What is known of a ray before it is traced.
  struct Flight {
    uint32_t path;
    bool reflected;
    Spread spread;
  };

  // One effect for every active path of a block, and the rays of those that go on.
  void advance(BlockPaths& block, uint32_t bounce, TriangleCache& triangles) {
    BlockPaths next;
    next.paths.reserve(block.paths.size()), next.spreads.reserve(block.paths.size());
    const auto land = [&](const Flight& flight, const Ray& ray, const Hit& hit) {
      if (!arriveAt(flight, ray, hit)) return;
      next.paths.push_back(flight.path);
      next.spreads.push_back(flight.spread);
    };
    // Paths of neighbouring samples stay close enough for packets, even after several bounces.
    RayQueue<Flight, decltype(land)> queue(context_, Coherence::Coherent, land);
    size_t next_input = block.first_input;
    for (size_t k = 0; k < block.paths.size(); ++k) {
      PathVertex& v = vertices_[block.paths[k]];
      TracedTriangle& triangle = triangles.triangle(v.hit);
      const PathMaterial& material = materials_[size_t(triangle.material())];
      const SurfacePoint point = triangle.surface(v.hit, v.direction);
      const PathInputs* const inputs = material.varies ? &inputs_[next_input++] : nullptr;
      const Spread spread = spreadOf(block, k);
      if (bounce > 0 && material.absorbs_all[point.side]) {
        arriveFootprint(v, spread, point);
        absorb(v, point);
        continue;
      }
      const Arrival arrival = arrive(point, v.direction, inputs ? lobesOf(point, *inputs) : material.lobes[point.side],
                                     material.view_weight_in_shading);
      follow(block.paths[k], spread, arrival, bounce, triangle, queue);
    }
    queue.finish();
    block = std::move(next);
  }

  Lobes lobesOf(const SurfacePoint& point, const PathInputs& inputs) const {
    return makeLobes(context_.scene.materials[size_t(point.material)], inputs, point.side != 0,
                     context_.settings.roughness_limit);
  }

  // The path ends on this surface.
  void absorb(PathVertex& vertex, const SurfacePoint& point) const {
    vertex.key = point.key(vertex.hit.instance);
    vertex.uv = point.uv;
    if (!footprints_) return;
    vertex.footprint = context_.trace.parametricFootprint(vertex.hit, point, vertex.dpdx, vertex.dpdy);
    vertex.key = reuseKey(vertex.key, vertex.footprint, context_.settings.footprint_reuse);
  }

  template <class Queue>
  void follow(uint32_t i, const Spread& spread, const Arrival& arrival, uint32_t bounce, TracedTriangle& triangle,
              Queue& queue) {
    PathVertex& vertex = vertices_[i];
    const BounceRandom random(context_.settings.seed, vertex.pixel, vertex.sample, layer_, bounce);
    const ChosenEffect chosen = choose(arrival, bounce, random);
    if (!(chosen.probability > 0)) return endWithout(vertex, {});
    arriveFootprint(vertex, spread, arrival.point);
    vertex.throughput *= 1 / chosen.probability;
    if (chosen.effect == Effect::Absorb) {
      vertex.throughput *= arrival.weights().absorption;
      if (!carriesSomething(vertex.throughput)) return endWithout(vertex, {});
      return absorb(vertex, arrival.point);
    }
    const Departure departure = depart(arrival, chosen.effect, random);
    vertex.throughput *= departure.weight;
    if (!departure.valid || !carriesSomething(vertex.throughput)) return endWithout(vertex, {});
    const Spread bent = spreads_ ? bend(arrival, departure, chosen.effect, vertex, spread, triangle) : Spread{};
    vertex.direction = departure.direction;
    SurfacePoint point = arrival.point;
    point.position_error = triangle.positionError(vertex.hit, point);  // only rays that leave need it
    queue.push({point.offsetOrigin(departure.direction), 0, departure.direction},
               {i, chosen.effect == Effect::Reflect, bent});
  }

  // First hits do what the layer is for, with certainty; the last allowed bounce leaves only absorption,
  // so that what would have gone on is lost and nothing gains by it.
  ChosenEffect choose(const Arrival& arrival, uint32_t bounce, const BounceRandom& random) const {
    if (bounce == 0 && layer_ == Layer::Direct) return {Effect::Absorb, 1};
    if (bounce >= context_.settings.max_bounces) return {Effect::Absorb, bounce == 0 ? 0.0f : 1.0f};
    if (bounce == 0) return {layer_ == Layer::Reflection ? Effect::Reflect : Effect::Refract, 1};
    return chooseEffect(arrival.weights(), random);
  }

  static Spread bend(const Arrival& arrival, const Departure& departure, Effect effect, const PathVertex& vertex,
                     const Spread& spread, TracedTriangle& triangle) {
    const auto one = [&](Vec3f dp, Vec3f dd) {
      const Vec2f b = triangle.barycentricChange(dp);
      const Vec3f dn = departure.dn1 * b.x + departure.dn2 * b.y;
      const Vec3f bent = effect == Effect::Reflect ? reflectDifferential(vertex.direction, departure.normal, dd, dn)
                                                   : refractDifferential(vertex.direction, departure.direction,
                                                                         departure.normal, arrival.lobes.eta, dd, dn);
      return limited(bent, kLargestDirectionChange);
    };
    return {one(vertex.dpdx, spread.x), one(vertex.dpdy, spread.y)};
  }

  // False: the ray met a light or nothing, and the path has ended.
  bool arriveAt(const Flight& flight, const Ray& ray, const Hit& hit) {
    PathVertex& vertex = vertices_[flight.path];
    // Nothing at infinity is seen beyond a hit.
    const std::span<const Light> lights = hit.valid() ? finite_lights_ : context_.scene.lights;
    const LightHit light = intersectLights(lights, ray.origin, ray.direction, hit.t);
    if (light.valid) return endWithout(vertex, flight.reflected ? light.specular_radiance : light.radiance), false;
    if (!hit.valid()) return endWithout(vertex, {}), false;
    vertex.hit = hit;
    return true;
  }

  const ShadeContext& context_;
  const CameraRays& camera_;
  Layer layer_;
  std::span<const FirstHit> first_;
  std::span<const uint32_t> ends_;
  std::span<PathVertex> vertices_;
  const SampleOutputs& out_;
  bool lean_;  // nobody reads vertices of paths that end without a surface
  bool footprints_, spreads_;
  std::atomic<uint64_t> on_surface_{0};
  std::vector<Light> camera_lights_, finite_lights_;
  std::vector<PathMaterial> materials_;
  std::vector<PathInputs> inputs_;  // of the active paths whose material varies
};

}  // namespace

uint64_t tracePaths(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
                    std::span<const uint32_t> ends, std::span<PathVertex> vertices, const SampleOutputs& out) {
  return Wavefront(context, camera, layer, first, ends, vertices, out).run();
}

}  // namespace encore
