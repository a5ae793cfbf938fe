// Inside of TraceCache; not for other rooms.
#pragma once

#include <compare>
#include <map>
#include <memory>
#include <vector>

#include "core/dice/dice.h"
#include "core/trace/embree_api.h"
#include "core/trace/trace_cache.h"

namespace encore {

// All that Embree's structure of a prototype is made from.
struct PrototypeKey {
  std::vector<const DicedMesh*> meshes;
  std::vector<uint8_t> may_pass;  // per mesh: shadow rays look at what they hit
  bool in_motion = false;         // and deforms: bounds hold over the whole shutter

  auto operator<=>(const PrototypeKey&) const = default;
};

// Embree's structure with all that it refers to. Members go in the reverse of their order.
struct BuiltPrototype {
  std::shared_ptr<embree::Device> device;
  std::vector<DicedMeshes::Pointer> meshes;
  embree::Scene scene;
};

struct TraceCache::Impl {
  std::shared_ptr<embree::Device> device = std::make_shared<embree::Device>();
  std::map<PrototypeKey, std::shared_ptr<const BuiltPrototype>> prototypes;
  uint64_t built = 0;
};

}  // namespace encore
