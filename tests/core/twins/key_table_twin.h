// What core/reuse/key_table.h must compute.
#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "core/reuse/key_table.h"

namespace encore::twin {

inline std::pair<uint32_t, uint32_t> pairOf(SurfaceKey key) { return {key.instance, key.primitive_side}; }

class KeyTable {
 public:
  void insert(SurfaceKey key, uint32_t primitive) { primitives_[pairOf(key)] = primitive; }
  uint32_t find(SurfaceKey key) const {
    const auto found = primitives_.find(pairOf(key));
    return found == primitives_.end() ? kNoPrimitive : found->second;
  }

 private:
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> primitives_;
};

}  // namespace encore::twin
