// Exact nearest neighbours of antialiasing samples among the shading samples of their primitive (§2.2, and §2.4 with
// the metric).
#pragma once

#include <array>

#include "core/reuse/reuse.h"
#include "core/reuse/trees.h"
#include "core/vulkan/device.h"

namespace encore {

class NearestNeighbour {
 public:
  // How the trees are walked; the answer is the same. Grouped: by all samples of a subgroup that are on one
  // primitive together, and one by one where that does not pay. Single: always one by one.
  enum class Walk { kGrouped, kSingle };

  explicit NearestNeighbour(Device& device, Walk walk = Walk::kGrouped);
  // Records: writes aa.shade, as ReuseKernels::findNearest() says. Reads aa.footprint where trees.footprint_weight
  // is above 0, and aa.aspect
  // where trees.sample_aspects is not 0.
  void record(Commands& commands, const Trees& trees, AaSamples& aa);

 private:
  struct Kernels {
    Kernel grouped, single;
  };
  // Made when first needed.
  Kernels& kernels(bool metric, bool aspects);

  Device& device_;
  Walk walk_;
  std::array<std::array<Kernels, 2>, 2> kernels_;  // without and with the metric, and aspects
};

}  // namespace encore
