#include "core/dice/dice_cache.h"

#include <utility>

namespace encore {

void DiceCache::retain(const std::vector<DiceKey>& keys) {
  std::map<DiceKey, Entry> kept;
  for (const DiceKey& key : keys)
    if (const auto found = entries_.find(key); found != entries_.end()) kept.insert(entries_.extract(found));
  entries_ = std::move(kept);
  diced_ = 0;
  if (on_retained_) on_retained_(*this);
}

void DiceCache::dropDisplaced() {
  std::erase_if(entries_, [](const auto& entry) { return !entry.first.displacement.empty(); });
}

std::set<const DicedMesh*> DiceCache::meshes() const {
  std::set<const DicedMesh*> found;
  for (const auto& [key, entry] : entries_) found.insert(entry.mesh.get());
  return found;
}

const DiceCache::Entry* DiceCache::find(const DiceKey& key) const {
  const auto found = key.identity ? entries_.find(key) : entries_.end();
  return found == entries_.end() ? nullptr : &found->second;
}

void DiceCache::add(DiceKey key, Entry entry) {
  if (key.identity) entries_.insert_or_assign(std::move(key), std::move(entry));
}

}  // namespace encore
