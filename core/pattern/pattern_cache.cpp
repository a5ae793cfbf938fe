#include "core/pattern/pattern_cache.h"

#include <utility>

namespace encore {

void PatternCache::retainPrograms(const std::set<std::string>& keys) {
  std::erase_if(programs_, [&](const auto& entry) { return !keys.contains(entry.first); });
  compiled_ = read_ = 0;
}

std::shared_ptr<const Kernel> PatternCache::program(const std::string& key) const {
  const auto found = programs_.find(key);
  return found == programs_.end() ? nullptr : found->second;
}

void PatternCache::addProgram(const std::string& key, std::shared_ptr<const Kernel> kernel) {
  programs_.insert_or_assign(key, std::move(kernel));
  ++compiled_;
}

}  // namespace encore
