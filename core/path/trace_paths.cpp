// Listing 2, for a whole batch at a time: one wavefront per bounce.
//
// Where this leaves the listing as printed: the recursion is a loop over bounces; effects of the first hit
// are forced by the layer (§2.4); lights and the background end a path too, with their radiance.
#include <limits>

#include "core/path/blocks.h"
#include "core/path/differentials.h"
#include "core/path/path.h"
#include "core/path/scatter.h"
#include "core/shade/lights.h"

namespace encore {

namespace {

// Lights that the camera sees. Near and far clipping planes do not cut them.
std::vector<Light> cameraLights(const Scene& scene, const Settings& settings) {
  std::vector<Light> lights;
  for (const Light& light : scene.lights)
    if (light.kind == Light::Kind::Dome ? settings.dome_light_visible : settings.lights_visible)
      lights.push_back(light);
  return lights;
}

bool carriesSomething(Vec3f throughput) { return isFinite(throughput) && maxComponent(throughput) > 0; }

// A path that ended on a light, on the background or nowhere.
void endWithout(PathVertex& vertex, Vec3f radiance) {
  vertex.hit = {};
  vertex.throughput = vertex.throughput * radiance;
  if (!carriesSomething(vertex.throughput)) vertex.throughput = {};
  vertex.dpdx = vertex.dpdy = {};
}

// How the direction of a path's ray changes over a pixel step. The change of its origin is kept in the
// vertex's dpdx and dpdy until the ray arrives.
struct Spread {
  Vec3f x, y;
};

class Wavefront {
 public:
  Wavefront(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
            std::span<const uint32_t> ends, std::span<PathVertex> vertices)
      : context_(context),
        camera_(camera),
        layer_(layer),
        first_(first),
        ends_(ends),
        vertices_(vertices),
        camera_lights_(cameraLights(context.scene, context.settings)),
        active_(ends.size()),
        first_point_(ends.size()) {
    const bool delta = anyDelta(context.scene.lights);
    for (const Material& material : context.scene.materials) {
      const int32_t index = int32_t(view_weight_in_shading_.size());
      view_weight_in_shading_.push_back(viewWeightInShading(material, context.settings.roughness_limit, delta));
      path_varies_.push_back(context.patterns.pathVaries(index));
      feeds_layer_.push_back(layer == Layer::Direct ||
                             (layer == Layer::Reflection ? feedsReflection(material, context.settings.roughness_limit)
                                                         : feedsRefraction(material)));
      any_varies_ = any_varies_ || path_varies_.back();
    }
    if (layer != Layer::Direct) spread_.resize(first.size());
  }

  void run() {
    forEachBlock(ends_, [&](size_t block, uint32_t begin, uint32_t end) {
      for (uint32_t i = begin; i < end; ++i)
        if (start(i)) active_[block].push_back(i);
    });
    for (uint32_t bounce = 0; anyActive(); ++bounce) {
      if (any_varies_) evaluatePathInputs();
      forEachBlock(ends_, [&](size_t block, uint32_t, uint32_t) { advance(block, bounce); });
    }
  }

 private:
  bool anyActive() const {
    return std::any_of(active_.begin(), active_.end(), [](const auto& paths) { return !paths.empty(); });
  }

  // The first hit as the camera sees it. False: the path has ended already.
  bool start(uint32_t i) {
    const FirstHit& first = first_[i];
    PathVertex& vertex = vertices_[i];
    vertex = {first.hit, {1, 1, 1}, first.direction, {}, {}, first.pixel, first.sample};
    if (!first.active) return endWithout(vertex, {}), false;
    const LightHit light = intersectLights(camera_lights_, first.origin, first.direction, first.hit.t);
    // What covers the camera's ray belongs to the direct layer only.
    if (light.valid) return endWithout(vertex, layer_ == Layer::Direct ? light.radiance : Vec3f{}), false;
    if (!first.hit.valid() || !feeds_layer_[size_t(context_.trace.material(first.hit))])
      return endWithout(vertex, {}), false;
    if (layer_ != Layer::Direct) camera_.differential(first.film_x, first.film_y, spread_[i].x, spread_[i].y);
    return true;
  }

  Spread spreadOf(uint32_t i) const {
    if (layer_ != Layer::Direct) return spread_[i];
    Spread spread;
    camera_.differential(first_[i].film_x, first_[i].film_y, spread.x, spread.y);
    return spread;
  }

  // Footprint of the pixel where path i arrived, on the plane of the triangle.
  void footprint(uint32_t i, const SurfacePoint& point, Vec3f& dpdx, Vec3f& dpdy) const {
    const PathVertex& v = vertices_[i];
    const Spread spread = spreadOf(i);
    const float longest = context_.trace.diagonal();  // no two points of the scene are further apart
    dpdx = limited(transferDifferential(v.dpdx, spread.x, v.hit.t, v.direction, point.ng), longest);
    dpdy = limited(transferDifferential(v.dpdy, spread.y, v.hit.t, v.direction, point.ng), longest);
  }

  // Path inputs of all active hits whose material varies, in one dispatch for the batch. Block b's are
  // inputs_[first_point_[b]...], in the order of its active paths.
  void evaluatePathInputs() {
    std::vector<std::vector<PatternPoint>> block_points(ends_.size());
    forEachBlock(ends_, [&](size_t block, uint32_t, uint32_t) {
      for (const uint32_t i : active_[block]) {
        const PathVertex& v = vertices_[i];
        if (!path_varies_[size_t(context_.trace.material(v.hit))]) continue;
        block_points[block].push_back(patternPoint(i, context_.trace.surface(v.hit, v.direction)));
      }
    });
    std::vector<PatternPoint> points;
    for (size_t block = 0; block < ends_.size(); ++block) {
      first_point_[block] = points.size();
      points.insert(points.end(), block_points[block].begin(), block_points[block].end());
    }
    inputs_.resize(points.size());
    if (!points.empty()) context_.patterns.evaluatePath(points, inputs_);
  }

  PatternPoint patternPoint(uint32_t i, const SurfacePoint& point) const {
    const Hit& hit = vertices_[i].hit;
    Vec3f dpdx, dpdy;
    footprint(i, point, dpdx, dpdy);
    const std::string& name = context_.patterns.texcoordName(point.material);
    const int32_t slot = name.empty() ? -1 : context_.trace.texcoordSlot(hit, name);
    const TexcoordPoint t = context_.trace.texcoord(hit, point, slot, dpdx, dpdy);
    return {uint32_t(point.material), t.st, t.dstdx, t.dstdy, context_.trace.displayColor(hit)};
  }

  // What a ray was before it is traced.
  struct Flight {
    uint32_t path;
    bool reflected;
  };

  // One effect for every active path of a block, and the rays of those that go on.
  void advance(size_t block, uint32_t bounce) {
    std::vector<uint32_t> next;
    const auto land = [&](const Flight& flight, const Ray& ray, const Hit& hit) {
      if (arriveAt(flight, ray, hit)) next.push_back(flight.path);
    };
    RayQueue<Flight, decltype(land)> queue(context_, Coherence::Incoherent, land);
    size_t next_input = first_point_[block];
    for (const uint32_t i : active_[block]) {
      const PathVertex& v = vertices_[i];
      const SurfacePoint point = context_.trace.surface(v.hit, v.direction);
      const size_t material = size_t(point.material);
      const PathInputs& inputs =
          path_varies_[material] ? inputs_[next_input++] : context_.patterns.constantPath(point.material);
      const Arrival arrival = arrive(point, v.direction, context_.scene.materials[material], inputs,
                                     context_.settings.roughness_limit, view_weight_in_shading_[material] != 0);
      follow(i, arrival, bounce, queue);
    }
    queue.finish();
    active_[block] = std::move(next);
  }

  template <class Queue>
  void follow(uint32_t i, const Arrival& arrival, uint32_t bounce, Queue& queue) {
    PathVertex& vertex = vertices_[i];
    const BounceRandom random(context_.settings.seed, vertex.pixel, vertex.sample, layer_, bounce);
    const ChosenEffect chosen = choose(arrival, bounce, random);
    if (!(chosen.probability > 0)) return endWithout(vertex, {});
    Vec3f dpdx, dpdy;
    footprint(i, arrival.point, dpdx, dpdy);
    vertex.dpdx = dpdx, vertex.dpdy = dpdy;
    vertex.throughput *= 1 / chosen.probability;
    if (chosen.effect == Effect::Absorb) {
      vertex.throughput *= arrival.weights().absorption;
      if (!carriesSomething(vertex.throughput)) endWithout(vertex, {});
      return;
    }
    const Departure departure = depart(arrival, chosen.effect, random);
    vertex.throughput *= departure.weight;
    if (!departure.valid || !carriesSomething(vertex.throughput)) return endWithout(vertex, {});
    spread_[i] = bend(arrival, departure, chosen.effect, vertex, spread_[i]);
    vertex.direction = departure.direction;
    queue.push({arrival.point.offsetOrigin(departure.direction), 0, departure.direction},
               {i, chosen.effect == Effect::Reflect});
  }

  // First hits do what the layer is for, with certainty; the last allowed bounce leaves only absorption,
  // so that what would have gone on is lost and nothing gains by it.
  ChosenEffect choose(const Arrival& arrival, uint32_t bounce, const BounceRandom& random) const {
    if (bounce == 0 && layer_ == Layer::Direct) return {Effect::Absorb, 1};
    if (bounce >= context_.settings.max_bounces) return {Effect::Absorb, bounce == 0 ? 0.0f : 1.0f};
    if (bounce == 0) return {layer_ == Layer::Reflection ? Effect::Reflect : Effect::Refract, 1};
    return chooseEffect(arrival.weights(), random.choice());
  }

  static Spread bend(const Arrival& arrival, const Departure& departure, Effect effect, const PathVertex& vertex,
                     const Spread& spread) {
    const auto one = [&](Vec3f dp, Vec3f dd) {
      const Vec2f b = arrival.point.barycentricChange(dp);
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
    const LightHit light = intersectLights(context_.scene.lights, ray.origin, ray.direction, hit.t);
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
  std::vector<Light> camera_lights_;
  std::vector<uint8_t> view_weight_in_shading_, path_varies_, feeds_layer_;  // per material
  bool any_varies_ = false;

  std::vector<std::vector<uint32_t>> active_;  // per block: paths that have arrived on a surface
  std::vector<Spread> spread_;                 // per path; empty in the direct layer, which needs the camera's
  std::vector<size_t> first_point_;            // per block
  std::vector<PathInputs> inputs_;
};

}  // namespace

void tracePaths(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
                std::span<const uint32_t> ends, std::span<PathVertex> vertices) {
  Wavefront(context, camera, layer, first, ends, vertices).run();
}

}  // namespace encore
