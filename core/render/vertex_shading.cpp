#include "core/render/vertex_shading.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/path/blocks.h"
#include "core/path/differentials.h"
#include "core/path/direct_layer.h"
#include "core/shade/lights.h"

namespace encore {
namespace {

// Tiles that are evaluated at a time: bounds what is kept of their paths.
constexpr size_t kTilesAtOnce = 4096;
// Vertices are seen at this cosine at least: their side must not depend on rounding.
constexpr float kLeastViewCosine = 1e-3f;

// Lists of requests, one per thread; together they are sorted, so that nothing depends on threads.
class Requests {
 public:
  std::vector<TileRequest>& local() { return lists_.local(); }
  std::vector<TileRequest> sorted() {
    std::vector<TileRequest> all;
    for (const auto& list : lists_) all.insert(all.end(), list.begin(), list.end());
    tbb::parallel_sort(all.begin(), all.end());
    return all;
  }

 private:
  tbb::enumerable_thread_specific<std::vector<TileRequest>> lists_;
};

// Calls work(tiles) for a bounded number of tiles at a time.
template <class Work>
void inChunks(std::span<const TileRequest> tiles, const Work& work) {
  for (size_t first = 0; first < tiles.size(); first += kTilesAtOnce)
    work(tiles.subspan(first, std::min(kTilesAtOnce, tiles.size() - first)));
}

// Seen from the camera, lights hide what lies behind them; a vertex is not seen, only interpolated.
Settings vertexSettings(Settings settings) {
  settings.dome_light_visible = settings.lights_visible = false;
  // Keys must name the face and nothing else.
  settings.footprint_reuse = FootprintReuse::Ignore;
  return settings;
}

// The direction from which a side with normal n (towards that side) is seen: `direction` itself, or its mirror image
// where it arrives from the other side.
Vec3f arrivingFrom(Vec3f direction, Vec3f n) {
  const float cosine = -dot(direction, n);
  if (cosine < 0) direction = direction + n * (-2 * dot(direction, n));
  if (std::abs(cosine) < kLeastViewCosine) direction = normalize(direction - n * kLeastViewCosine);
  return direction;
}

}  // namespace

VertexShading::VertexShading(const ShadeContext& context, const CameraRays& camera, const DicedMeshes& diced)
    : settings_(vertexSettings(context.settings)),
      context_{context.scene, settings_, context.trace, context.patterns, context.rays_traced, context.lights},
      camera_(camera),
      camera_lights_(cameraLights(context.scene, context.settings)),
      views_(context.scene.camera, context.settings),
      grids_(context.scene, context.settings, diced, views_) {
  const float limit = settings_.roughness_limit;
  const bool bounces = settings_.max_bounces > 0;
  for (const Material& material : context.scene.materials)
    feeds_.push_back({1, bounces && feedsReflection(material, limit), bounces && feedsRefraction(material)});
}

void VertexShading::shadeLayer(Layer layer, std::span<const FirstHit> first, std::span<const uint32_t> ends,
                               std::span<Vec3f> radiance) {
  std::vector<GridCell> cells(first.size());
  Requests requests;
  forEachBlock(ends, [&](size_t, uint32_t begin, uint32_t end) {
    std::vector<TileRequest>& list = requests.local();
    for (uint32_t i = begin; i < end; ++i) {
      cells[i] = seenCell(layer, first[i], radiance[i]);
      if (cells[i].grid) cells[i].request(uint32_t(layer), list);
    }
  });
  evaluate(layer, requests.sorted());
  forEachBlock(ends, [&](size_t, uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i)
      if (cells[i].grid) radiance[i] = cells[i].interpolate(uint32_t(layer));
  });
}

// What needs no vertices is written to radiance.
GridCell VertexShading::seenCell(Layer layer, const FirstHit& first, Vec3f& radiance) {
  radiance = {};
  if (!first.active()) return {};
  const Ray ray = camera_.ray(first);  // through the lens, where there is one
  if (!camera_lights_.empty()) {
    const LightHit light = intersectLights(context_.lights, camera_lights_, ray.origin, ray.direction, first.hit.t);
    if (light.valid) {
      if (layer == Layer::Direct) radiance = light.radiance;
      return {};
    }
  }
  if (!first.hit.valid()) return {};
  const SurfacePoint point = context_.trace.surface(first.hit, ray.direction, false);
  if (!feeds_[size_t(point.material)][size_t(layer)]) return {};
  return grids_.cell(first.hit, point.key(first.hit.instance));
}

void VertexShading::evaluate(Layer layer, std::span<const TileRequest> tiles) {
  inChunks(tiles, [&](std::span<const TileRequest> chunk) {
    if (layer == Layer::Direct)
      evaluateDirect(chunk);
    else
      evaluateBounces(layer, chunk);
  });
}

// Shaded radiance times the weight of absorption, as the camera sees it; tiles without any weight are not shaded.
void VertexShading::evaluateDirect(std::span<const TileRequest> tiles) {
  const Batch batch = collect(tiles);
  const std::vector<PathVertex> paths = follow(Layer::Direct, batch);
  std::vector<Vec3f> radiance(paths.size());
  std::vector<TileRequest> to_shade;
  std::vector<uint8_t> absorbs(tiles.size(), 0);
  for (size_t t = 0; t < tiles.size(); ++t) {
    const uint32_t begin = t ? batch.ends[t - 1] : 0;
    for (uint32_t i = begin; i < batch.ends[t]; ++i) absorbs[t] |= paths[i].hit.valid();
    if (!absorbs[t]) continue;
    VertexTile& tile = tiles[t].grid->tiles[tiles[t].tile];
    tile.shaded_for.fetch_or(1u << uint32_t(Layer::Direct));
    if (!(tile.requested.fetch_or(1u << kShadedValues) & 1u << kShadedValues)) to_shade.push_back(tiles[t]);
  }
  shadeTiles(to_shade);
  for (size_t t = 0; t < tiles.size(); ++t) {
    if (!absorbs[t]) continue;
    const auto& shaded = *tiles[t].grid->tiles[tiles[t].tile].values[kShadedValues];
    for (uint32_t i = t ? batch.ends[t - 1] : 0; i < batch.ends[t]; ++i)
      if (paths[i].hit.valid()) radiance[i] = paths[i].throughput * shaded[batch.slot[i]];
  }
  store(uint32_t(Layer::Direct), tiles, batch, radiance);
}

// Whole octaves by which a pixel's beam is wider at the end of the path than one from the camera to there.
uint32_t VertexShading::beamLevel(const PathVertex& v) const {
  const auto across = [&](Vec3f dp) { return dp - v.direction * dot(dp, v.direction); };
  const float beam = std::sqrt(length(cross(across(v.dpdx), across(v.dpdy))));
  const Vec3f from_camera = context_.trace.surface(v.hit, v.direction, false).position - views_.origin();
  const float octaves = std::log2(beam * views_.pixelsPerRadian(from_camera) / length(from_camera));
  return octaves > 0 ? std::min(uint32_t(std::min(octaves, 100.0f)), kGridLevels - 1) : 0;  // NaN counts as 0
}

// A path per vertex; where it is absorbed, shaded radiance comes from the vertices around.
void VertexShading::evaluateBounces(Layer layer, std::span<const TileRequest> tiles) {
  const Batch batch = collect(tiles);
  const std::vector<PathVertex> paths = follow(layer, batch);
  std::vector<GridCell> cells(paths.size());
  Requests requests;
  forEachBlock(batch.ends, [&](size_t, uint32_t begin, uint32_t end) {
    std::vector<TileRequest>& list = requests.local();
    for (uint32_t i = begin; i < end; ++i) {
      if (!paths[i].hit.valid()) continue;
      cells[i] = grids_.cell(paths[i].hit, paths[i].key, beamLevel(paths[i]));
      cells[i].request(kShadedValues, list);
      cells[i].markShadedFor(layer);
    }
  });
  inChunks(requests.sorted(), [&](std::span<const TileRequest> chunk) { shadeTiles(chunk); });
  std::vector<Vec3f> radiance(paths.size());
  forEachBlock(batch.ends, [&](size_t, uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i)
      radiance[i] = cells[i].grid ? paths[i].throughput * cells[i].interpolate(kShadedValues) : paths[i].throughput;
  });
  store(uint32_t(layer), tiles, batch, radiance);
}

void VertexShading::shadeTiles(std::span<const TileRequest> tiles) {
  if (tiles.empty()) return;
  const Batch batch = collect(tiles);
  std::vector<PathVertex> vertices(batch.first.size());
  forEachBlock(batch.ends, [&](size_t, uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i) vertices[i] = shadedVertex(batch.first[i], batch.view[i]);
  });
  std::vector<Vec3f> radiance(vertices.size());
  shade(context_, vertices, batch.ends, radiance);
  store(kShadedValues, tiles, batch, radiance);
}

VertexShading::Batch VertexShading::collect(std::span<const TileRequest> tiles) const {
  std::vector<Batch> parts(tiles.size());
  tbb::parallel_for(size_t{0}, tiles.size(), [&](size_t t) {
    const FlushDenormals flush;
    const TileRequest& tile = tiles[t];
    const uint32_t key = tile.face->randomKey(tile), side = tile.face->key().primitive_side & 1;
    const std::array<Hit, kTileVertices> hits = tile.face->vertices(tile);
    for (uint32_t slot = 0; slot < kTileVertices; ++slot)
      if (hits[slot].valid()) addVertex(hits[slot], side, key, slot, parts[t]);
  });
  Batch batch;
  for (const Batch& part : parts) {
    batch.first.insert(batch.first.end(), part.first.begin(), part.first.end());
    batch.view.insert(batch.view.end(), part.view.begin(), part.view.end());
    batch.slot.insert(batch.slot.end(), part.slot.begin(), part.slot.end());
    batch.ends.push_back(uint32_t(batch.first.size()));
  }
  return batch;
}

// As a first hit of the camera, with the tile for a pixel: its vertices stratify together.
void VertexShading::addVertex(const Hit& hit, uint32_t side, uint32_t key, uint32_t slot, Batch& batch) const {
  FirstHit first;
  first.hit = hit;
  const SurfacePoint point = context_.trace.surface(hit, {0, 0, -1}, false);  // no side yet: any direction will do
  const Vec3f towards = point.position - views_.origin();
  first.hit.t = length(towards);
  const Vec3f n = side ? -point.ng : point.ng;
  const Vec3f direction = first.hit.t > 0 ? arrivingFrom(towards * (1 / first.hit.t), n) : -n;
  const ViewPosition position = views_.position(direction);
  first.film_x = position.film_x, first.film_y = position.film_y;
  first.pixel = key, first.sample = slot;
  batch.first.push_back(first);
  batch.view.push_back(position.view);
  batch.slot.push_back(uint8_t(slot));
}

// View by view, tiles being blocks in each: packets depend on nothing but the tile.
std::vector<PathVertex> VertexShading::follow(Layer layer, const Batch& batch) const {
  std::vector<PathVertex> paths(batch.first.size());
  for (uint32_t view = 0; view < views_.count(); ++view) {
    std::vector<FirstHit> first;
    std::vector<uint32_t> indices, ends;
    uint32_t i = 0;
    for (const uint32_t end : batch.ends) {
      for (; i < end; ++i)
        if (batch.view[i] == view) first.push_back(batch.first[i]), indices.push_back(i);
      ends.push_back(uint32_t(first.size()));
    }
    if (first.empty()) continue;
    std::vector<PathVertex> seen(first.size());
    tracePaths(context_, views_.rays(view), layer, first, ends, seen);
    for (size_t k = 0; k < seen.size(); ++k) paths[indices[k]] = seen[k];
  }
  return paths;
}

// Footprint: that of a pixel, as core/path finds it in the direct layer.
PathVertex VertexShading::shadedVertex(const FirstHit& first, uint32_t view) const {
  const CameraRays& rays = views_.rays(view);
  PathVertex v;
  v.hit = first.hit;
  v.throughput = {1, 1, 1};
  v.direction = rays.ray(first).direction;
  v.pixel = first.pixel, v.sample = first.sample;
  const SurfacePoint point = context_.trace.surface(first.hit, v.direction, false);
  Vec3f dpdx, dpdy, dddx, dddy;
  rays.differential({first.film_x, first.film_y, first.pixel, first.sample}, dpdx, dpdy, dddx, dddy);
  const float longest = context_.trace.diagonal();
  v.dpdx = limited(transferDifferential({}, dddx, first.hit.t, v.direction, point.ng), longest);
  v.dpdy = limited(transferDifferential({}, dddy, first.hit.t, v.direction, point.ng), longest);
  v.key = point.key(first.hit.instance);
  v.uv = point.uv;
  return v;
}

void VertexShading::store(uint32_t value, std::span<const TileRequest> tiles, const Batch& batch,
                          std::span<const Vec3f> radiance) {
  tbb::parallel_for(size_t{0}, tiles.size(), [&](size_t t) {
    VertexTile& tile = tiles[t].grid->tiles[tiles[t].tile];
    auto values = std::make_unique<std::array<Vec3f, kTileVertices>>();
    tile.used = 0;
    for (uint32_t i = t ? batch.ends[t - 1] : 0; i < batch.ends[t]; ++i) {
      (*values)[batch.slot[i]] = radiance[i];
      tile.used = uint16_t(tile.used | 1u << batch.slot[i]);
    }
    tile.values[value] = std::move(values);
  });
}

bool VertexShading::counts(const VertexTile& tile, Layer layer, uint32_t value) const {
  if (!tile.values[value]) return false;
  return value != kShadedValues || std::countr_zero(uint32_t(tile.shaded_for.load())) == int(layer);
}

uint64_t VertexShading::count(Layer layer, uint32_t value) const {
  uint64_t sum = evicted_[size_t(layer)][value];
  grids_.forEachTile([&](const VertexTile& tile) {
    if (counts(tile, layer, value)) sum += uint64_t(std::popcount(tile.used));
  });
  return sum;
}

uint64_t VertexShading::memoryBytes() const { return grids_.memoryBytes(); }

void VertexShading::evict() {
  for (uint32_t layer = 0; layer < kMaxLayers; ++layer)
    for (const uint32_t value : {layer, kShadedValues}) evicted_[layer][value] = count(Layer(layer), value);
  grids_.clear();
}

}  // namespace encore
