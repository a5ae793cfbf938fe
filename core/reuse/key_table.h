// Hash table on the device from SurfaceKey to the number of its primitive.
#pragma once

#include <cstdint>

#include "core/reuse/tree_primitive.h"
#include "core/vulkan/device.h"

namespace encore {

inline constexpr uint32_t kNoPrimitive = 0xffffffffu;

class KeyTable {
 public:
  // Numbers of primitives, or kNoPrimitive; at most half full. Their keys stand in the primitives.
  using Slots = Buffer<uint32_t>;

  explicit KeyTable(Device& device);

  // An empty table for this many primitives.
  Slots create(uint32_t primitives) const;
  // Records: enters all primitives (a device address), whose keys must differ, into an empty table.
  // record_bytes: size of a primitive's record, which starts with its key.
  void recordInsert(Commands& commands, Slots& slots, uint64_t primitives, uint32_t count,
                    uint32_t record_bytes = sizeof(TreePrimitive));
  // Records: found[i] = number of the primitive with keys[i], or kNoPrimitive.
  void recordFind(Commands& commands, const Slots& slots, uint64_t primitives, uint64_t keys, uint64_t found,
                  uint32_t count);

  // Slots of a table for this many primitives: a power of two; 0 for none.
  static uint64_t capacityFor(uint64_t primitives);

 private:
  Device& device_;
  Kernel insert_, find_;
};

}  // namespace encore
