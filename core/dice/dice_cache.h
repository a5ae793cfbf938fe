// What dicing leaves behind for scenes that follow.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "core/dice/dice.h"
#include "core/scene/material.h"

namespace encore {

// All that a diced mesh depends on.
struct DiceKey {
  const void* identity = nullptr;  // Mesh::identity; null: the mesh cannot be told from others
  float edge_length = 0;           // in prototype space; 0 where the mesh ignores it
  uint64_t max_micropolygons = 0;
  std::string displacement;  // what displaces it, as text; empty: nothing

  auto operator<=>(const DiceKey&) const = default;
};

// Diced meshes of the last scene that was diced with it. Not thread-safe.
class DiceCache {
 public:
  struct Entry {
    DicedMeshes::Pointer mesh;
    uint64_t micropolygons = 0;  // that the cap counts
    // So that addresses in the key are not used again for something else.
    std::shared_ptr<const void> identity;
    std::vector<std::shared_ptr<const TextureSource>> textures;
  };

  // Lets go of all that has none of these keys, and begins to count.
  void retain(const std::vector<DiceKey>& keys);
  const Entry* find(const DiceKey& key) const;  // null: there is none
  void add(DiceKey key, Entry entry);

  // Called at the end of retain(); empty: nothing is.
  void onRetained(std::function<void(const DiceCache&)> call) { on_retained_ = std::move(call); }
  void dropDisplaced();
  std::set<const DicedMesh*> meshes() const;

  size_t size() const { return entries_.size(); }
  uint64_t diced() const { return diced_; }  // meshes that the last scene did not find in it
  void countDiced() { ++diced_; }

 private:
  std::map<DiceKey, Entry> entries_;
  std::function<void(const DiceCache&)> on_retained_;
  uint64_t diced_ = 0;
};

}  // namespace encore
