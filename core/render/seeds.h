// Lines 3-6 of Listing 3: the shading samples of a reuse tile.
#pragma once

#include <functional>
#include <span>

#include "core/film/film.h"
#include "core/render/layer_search.h"
#include "core/render/samples.h"
#include "core/render/shading_rates.h"
#include "core/render/statistics.h"

namespace encore {

class Seeds {
 public:
  // Keeps references to all of them.
  Seeds(const ShadeContext& context, const CameraRays& camera, const ShadingRates& rates, Device& device,
        std::span<const Layer> layers);

  // Traces and shades the seeds of a tile, some blocks at a time, of which only the shading samples stay: in host
  // memory; LayerSearch::buildIndex()'s caller brings them to the device. First hits are traced once for all layers.
  // Leaves room for `failures` more radiances. Seeds are traced at the highest rate of any surface, and kept where
  // their index in the block's sequence is below the rate of what they hit. film: for the debug AOVs.
  // progress(share): called with the share of the tile that is done.
  void shade(const ReuseTile& tile, uint32_t blocks_per_batch, size_t failures, std::span<LayerShading> shading,
             Film& film, Statistics& statistics, const std::function<void(double)>& progress);

 private:
  struct Kept {
    std::vector<PathVertex> vertices;
    std::vector<uint32_t> ends;  // of the blocks
  };
  void reserve(LayerShading& shading, size_t seeds, size_t failures) const;
  Kept follow(size_t layer, std::span<const BlockOrigin> blocks, const BlockRays& rays, Film& film) const;
  void store(LayerShading& shading, std::span<const PathVertex> vertices) const;

  const ShadeContext& context_;
  const CameraRays& camera_;
  const ShadingRates& rates_;
  Device& device_;
  std::span<const Layer> layers_;
};

}  // namespace encore
