// Exact nearest neighbours of antialiasing samples among the shading samples of their primitive (§2.2).
#pragma once

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
  // Records: writes aa.shade, as ReuseKernels::findNearest() says.
  void record(Commands& commands, const Trees& trees, AaSamples& aa);

 private:
  Walk walk_;
  Kernel grouped_, single_;
};

}  // namespace encore
