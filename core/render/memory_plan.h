// How much of a frame may be in flight under a memory budget (§3.1). Pure arithmetic, no device.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/settings.h"

namespace encore {

// Blocks of antialiasing samples, and of shading rays, that are in flight together. The scope of trees, the reuse tile,
// is a setting and not planned here: what a pixel gets must not depend on the budget.
struct MemoryPlan {
  uint32_t blocks_per_batch = 1;       // of antialiasing samples
  uint32_t blocks_per_seed_batch = 1;  // of shading rays, while they are traced and shaded
  uint64_t fixed_bytes = 0;      // shading samples and indices of one reuse tile in all layers, and the film of it
  uint64_t bytes_per_block = 0;  // antialiasing samples of a block, in one layer at a time
  uint64_t bytes_per_seed_block = 0;
};

// What the plan is for, besides the settings.
struct PlanInput {
  // Of each layer: the highest shading rate of any surface, and how it is searched.
  struct LayerInput {
    float rate = 0;
    Search search = Search::Tree;
  };
  std::vector<LayerInput> layers;
  uint64_t path_state_bytes = 0;  // that a path takes more than in scenes where it never passes a surface
};

// budget_bytes > 0. Throws Error(Memory) that names the smallest sufficient budget.
MemoryPlan planMemory(const Settings& settings, const PlanInput& input, uint64_t budget_bytes);

// The budget of a frame whose settings name none: half of what the machine has free, or on a device
// with memory of its own half of that (§3.1).
uint64_t defaultMemoryBudget(bool cpu_device, uint64_t device_bytes);

}  // namespace encore
