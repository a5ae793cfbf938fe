// Exact nearest neighbours of antialiasing samples among the shading samples of their primitive (§2.2).
#pragma once

#include "core/reuse/reuse.h"
#include "core/reuse/trees.h"
#include "core/vulkan/device.h"

namespace encore {

class NearestNeighbour {
 public:
  explicit NearestNeighbour(Device& device);
  // Records: writes aa.shade, as ReuseKernels::findNearest() says.
  void record(Commands& commands, const Trees& trees, AaSamples& aa);

 private:
  Kernel kernel_;
};

}  // namespace encore
