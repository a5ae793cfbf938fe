// Distance limit: antialiasing samples that are far from their neighbour fail.
#pragma once

#include "core/reuse/reuse.h"
#include "core/vulkan/device.h"

namespace encore {

class LimitDistance {
 public:
  explicit LimitDistance(Device& device);
  // Records what ReuseKernels::limitDistance() says.
  void record(Commands& commands, const ShadingSamples& samples, AaSamples& aa, float limit);

 private:
  Kernel kernel_;
};

}  // namespace encore
