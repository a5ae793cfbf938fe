#include "core/render/seeds.h"

#include <algorithm>
#include <cmath>

#include "core/path/footprint.h"

namespace encore {
namespace {

// Rounding may put a seed onto the border of its block.
void addEvaluation(Film& film, uint32_t layer, BlockOrigin block, const FirstHit& seed) {
  const int32_t last = int32_t(kBlockPixels) - 1;
  film.addEvaluation(layer, std::min(int32_t(std::floor(seed.film_x)), block.x + last),
                     std::min(int32_t(std::floor(seed.film_y)), block.y + last));
}

}  // namespace

Seeds::Seeds(const ShadeContext& context, const CameraRays& camera, const ShadingRates& rates, Device& device,
             std::span<const Layer> layers)
    : context_(context), camera_(camera), rates_(rates), device_(device), layers_(layers) {}

void Seeds::shade(const ReuseTile& tile, uint32_t blocks_per_batch, size_t failures, std::span<LayerShading> shading,
                  Film& film, Statistics& statistics, const std::function<void(double)>& progress) {
  float highest = 0;
  for (size_t layer = 0; layer < layers_.size(); ++layer) {
    const float rate = rates_.highest(layers_[layer]);
    reserve(shading[layer], tile.blocks.size() * mostShadingRays(rate), failures);
    highest = std::max(highest, rate);
  }
  for (size_t b = 0; b < tile.blocks.size(); b += blocks_per_batch) {
    const size_t count = std::min<size_t>(blocks_per_batch, tile.blocks.size() - b);
    const auto blocks = std::span(tile.blocks).subspan(b, count);
    BlockRays rays;
    {
      StageTimer timer(statistics.time_s["trace"]);
      rays = generateShadingRays(context_.settings, blocks, highest);
      traceFirstHits(context_, camera_, rays.first, rays.ends);
    }
    for (size_t layer = 0; layer < layers_.size(); ++layer) {
      LayerStatistics& counts = statistics.layers[layerName(layers_[layer])];
      StageTimer trace_timer(counts.trace_s);
      const Kept kept = follow(layer, blocks, rays, film);
      trace_timer.stop();
      StageTimer shade_timer(counts.shade_s);
      const auto radiance = shading[layer].radiance.host().subspan(shading[layer].samples.count, kept.vertices.size());
      encore::shade(context_, kept.vertices, kept.ends, radiance);
      store(shading[layer], kept.vertices);
      counts.shading_evaluations += kept.vertices.size();
    }
    progress(double(b + count) / double(tile.blocks.size()));
  }
}

void Seeds::reserve(LayerShading& shading, size_t seeds, size_t failures) const {
  ShadingSamples& samples = shading.samples;
  samples.count = 0;
  samples.key.reserve(device_, seeds, "seed key");
  samples.uv.reserve(device_, seeds, "seed uv");
  if (context_.settings.footprint_reuse == FootprintReuse::Metric)
    samples.footprint.reserve(device_, seeds, "seed footprint");
  if (needsAspect(context_.settings)) samples.aspect.reserve(device_, seeds, "seed aspect");
  shading.radiance.reserve(device_, seeds + failures, "radiance");
}

// Drops paths that ended on nothing, and those whose index lies beyond the rate of what they hit.
Seeds::Kept Seeds::follow(size_t layer, std::span<const BlockOrigin> blocks, const BlockRays& rays, Film& film) const {
  Kept result;
  std::vector<PathVertex>& vertices = result.vertices;
  vertices.resize(rays.first.size());
  tracePaths(context_, camera_, layers_[layer], rays.first, rays.ends, vertices);
  size_t kept = 0, i = 0;
  for (size_t b = 0; b < blocks.size(); ++b) {
    float rate = rates_.frame(layers_[layer]);
    uint32_t count = shadingRayCount(context_.settings, blocks[b], rate);
    for (; i < rays.ends[b]; ++i) {
      if (!vertices[i].hit.valid()) continue;
      const float own = rates_.of(layers_[layer], vertices[i].hit);
      if (own != rate) count = shadingRayCount(context_.settings, blocks[b], rate = own);
      if (vertices[i].sample >= count) continue;
      if (context_.settings.debug_aovs) addEvaluation(film, uint32_t(layer), blocks[b], rays.first[i]);
      vertices[kept++] = vertices[i];
    }
    result.ends.push_back(uint32_t(kept));
  }
  vertices.resize(kept);
  return result;
}

void Seeds::store(LayerShading& shading, std::span<const PathVertex> vertices) const {
  ShadingSamples& samples = shading.samples;
  const size_t first = samples.count;
  for (size_t i = 0; i < vertices.size(); ++i) {
    samples.key.host()[first + i] = vertices[i].key;
    samples.uv.host()[first + i] = vertices[i].uv;
    if (!samples.footprint.empty()) samples.footprint.host()[first + i] = vertices[i].footprint;
    if (!samples.aspect.empty()) samples.aspect.host()[first + i] = vertices[i].aspect;
  }
  samples.count += uint32_t(vertices.size());
}

}  // namespace encore
