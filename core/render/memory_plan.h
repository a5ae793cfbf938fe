// How much of a frame may be in flight under a memory budget (§3.1). Pure arithmetic, no device.
#pragma once

#include <cstdint>

#include "core/scene/settings.h"

namespace encore {

// Blocks of antialiasing samples that are in flight together. The scope of trees, the reuse tile, is
// a setting and not planned here: what a pixel gets must not depend on the budget.
struct MemoryPlan {
  uint32_t blocks_per_batch = 1;
  uint64_t fixed_bytes = 0;      // seeds and trees of one reuse tile in all layers, and the film
  uint64_t bytes_per_block = 0;  // antialiasing samples of a block, in one layer at a time
};

// budget_bytes > 0. Throws Error(Memory) that names the smallest sufficient budget.
MemoryPlan planMemory(const Settings& settings, uint32_t layers, uint64_t budget_bytes);

// The budget of a frame whose settings name none: half of what the machine has free, or on a device
// with memory of its own half of that (§3.1).
uint64_t defaultMemoryBudget(bool cpu_device, uint64_t device_bytes);

}  // namespace encore
