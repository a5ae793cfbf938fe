// Lines 7 and 13-18 of Listing 3: which shading each antialiasing sample of a layer reuses, by what the settings
// ask of reuse.
#pragma once

#include <span>

#include "core/path/path.h"
#include "core/render/decoupled.h"
#include "core/render/shading_rates.h"
#include "core/render/statistics.h"
#include "core/reuse/reuse.h"

namespace encore {

// What the seeds of one layer of one reuse tile leave behind.
struct LayerShading {
  ShadingSamples samples;
  Buffer<Vec3f> radiance;  // of the seeds; behind them, of the failures of the batch in flight
  SearchIndexPointer index{nullptr, nullptr};
};

// What a batch's samples hit in a layer, by slot.
struct BatchHits {
  Layer layer = Layer::Direct;
  std::span<const FirstHit> first;       // empty unless needsFirstHits() or there are other layers
  std::span<const PathVertex> vertices;  // in layers other than direct

  const Hit& hit(size_t slot) const { return layer == Layer::Direct ? first[slot].hit : vertices[slot].hit; }
};

class LayerSearch {
 public:
  // Keeps references to all of them.
  LayerSearch(const Scene& scene, const Settings& settings, const TraceScene& trace, const ShadingRates& rates,
              ReuseKernels& kernels);

  // How a layer is searched.
  Search kindOf(Layer layer) const;
  // What the samples have to come with.
  bool needsFootprints() const;  // AaSamples::footprint
  bool needsCells() const;       // AaSamples::cell: decoupled sampling
  bool needsFirstHits() const;   // BatchHits::first in the direct layer

  // Line 7. The samples are on the device.
  void buildIndex(Layer layer, LayerShading& shading);
  // Lines 13-18, for samples that are on the device. Counts them and their failures.
  void find(const LayerShading& shading, const BatchHits& hits, AaSamples& aa, LayerStatistics& statistics);
  // What failures share shading by.
  ReuseKernels::Share sharing() const;

 private:
  void hashFailures(const BatchHits& hits, AaSamples& aa) const;
  void limitDistance(const LayerShading& shading, const BatchHits& hits, AaSamples& aa);

  const Settings& settings_;
  const TraceScene& trace_;
  const ShadingRates& rates_;
  ReuseKernels& kernels_;
  Projection projection_;
};

}  // namespace encore
