#include "core/render/layer_search.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "core/path/footprint.h"

namespace encore {
namespace {

// Antialiasing samples per pixel from which on a pixel's groups are large enough.
constexpr uint32_t kSamplesWorthGroups = 49;
// Antialiasing samples per shading sample from which on lists are worth building.
constexpr float kQueriesWorthLists = 24;

}  // namespace

LayerSearch::LayerSearch(const Scene& scene, const Settings& settings, const TraceScene& trace,
                         const ShadingRates& rates, ReuseKernels& kernels)
    : settings_(settings), trace_(trace), rates_(rates), kernels_(kernels), projection_(scene.camera, settings) {}

// By measurement (docs/method.md): a pixel's first hits share their candidates if there are many of them; what is
// seen by way of other surfaces does not, but many queries pay for lists.
Search LayerSearch::kindOf(Layer layer) const {
  if (settings_.search != Search::Auto) return settings_.search;
  if (settings_.footprint_reuse == FootprintReuse::Metric || needsAspect(settings_)) return Search::Tree;
  const uint32_t samples_per_pixel = settings_.samples * settings_.samples;
  if (layer == Layer::Direct) return samples_per_pixel >= kSamplesWorthGroups ? Search::Groups : Search::Tree;
  return float(samples_per_pixel) >= kQueriesWorthLists * rates_.frame(layer) ? Search::Cells : Search::Tree;
}

bool LayerSearch::needsFootprints() const {
  return settings_.method == Method::Reuse &&
         (settings_.footprint_reuse == FootprintReuse::Metric || settings_.max_reuse_distance > 0);
}
bool LayerSearch::needsCells() const {
  return settings_.method == Method::Decoupled || settings_.method == Method::DecoupledPixel;
}
bool LayerSearch::needsFirstHits() const {
  return settings_.method != Method::Reuse || (settings_.max_reuse_distance > 0 && rates_.vary(Layer::Direct));
}

ReuseKernels::Share LayerSearch::sharing() const {
  if (settings_.method == Method::Reuse) return ReuseKernels::Share::InPixel;
  return needsCells() ? ReuseKernels::Share::InCell : ReuseKernels::Share::Nothing;
}

void LayerSearch::buildIndex(Layer layer, LayerShading& shading) {
  const bool metric = settings_.method == Method::Reuse && settings_.footprint_reuse == FootprintReuse::Metric;
  shading.index.reset();  // before the next one takes memory
  shading.index = kernels_.buildIndex(shading.samples, kindOf(layer), metric ? settings_.footprint_weight : 0.0f);
}

void LayerSearch::find(const LayerShading& shading, const BatchHits& hits, AaSamples& aa, LayerStatistics& statistics) {
  if (needsCells()) hashFailures(hits, aa);
  kernels_.findNearest(*shading.index, aa);
  if (settings_.method == Method::Reuse && settings_.max_reuse_distance > 0) limitDistance(shading, hits, aa);
  aa.shade.toHost(0, aa.count);
  const auto shade_index = aa.shade.host().first(aa.count);
  std::atomic<uint64_t> on_surface{0}, failed{0};
  tbb::parallel_for(tbb::blocked_range<size_t>(0, shade_index.size(), 1u << 16), [&](const auto& range) {
    const auto part = shade_index.subspan(range.begin(), range.size());
    on_surface += range.size() - size_t(std::count(part.begin(), part.end(), kShadeNone));
    failed += size_t(std::count(part.begin(), part.end(), kShadeNotFound));
  });
  statistics.antialiasing_samples += on_surface;
  statistics.failed_samples += failed;
}

// Shading samples are as far apart as pixels, over the root of their rate.
void LayerSearch::limitDistance(const LayerShading& shading, const BatchHits& hits, AaSamples& aa) {
  float limit = settings_.max_reuse_distance;
  if (rates_.vary(hits.layer)) {
    const auto footprint = aa.footprint.host();
    tbb::parallel_for(size_t{0}, size_t(aa.count), [&](size_t slot) {
      if (aa.key.host()[slot].instance != kNoInstance)
        footprint[slot] /= std::sqrt(rates_.of(hits.layer, hits.hit(slot)));
    });
    aa.footprint.toDevice(0, aa.count);
  } else {
    limit /= std::sqrt(rates_.frame(hits.layer));
  }
  kernels_.limitDistance(shading.samples, aa, limit);
}

// The modified mapping, and the standard one in the direct layer, take the sample's own place on the film.
void LayerSearch::hashFailures(const BatchHits& hits, AaSamples& aa) const {
  const bool project = settings_.method == Method::Decoupled && hits.layer != Layer::Direct;
  const float rate = rates_.frame(hits.layer);
  tbb::parallel_for(size_t{0}, size_t(aa.count), [&](size_t slot) {
    Vec2f film{hits.first[slot].film_x, hits.first[slot].film_y};
    if (project && hits.vertices[slot].hit.valid()) {
      const PathVertex& vertex = hits.vertices[slot];
      film = projection_.film(trace_.surface(vertex.hit, vertex.direction, false).position);
    }
    aa.cell.host()[slot] = decoupledCell(film, rate);
  });
  aa.cell.toDevice(0, aa.count);
}

}  // namespace encore
