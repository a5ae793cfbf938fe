#include "core/trace/trace_cache.h"

#include <algorithm>

#include "core/trace/trace_cache_impl.h"

namespace encore {

TraceCache::TraceCache() : impl_(std::make_unique<Impl>()) {}
TraceCache::~TraceCache() = default;

size_t TraceCache::size() const { return impl_->prototypes.size(); }
uint64_t TraceCache::built() const { return impl_->built; }

void TraceCache::retainMeshes(const std::set<const DicedMesh*>& meshes) {
  std::erase_if(impl_->prototypes, [&](const auto& prototype) {
    const std::vector<const DicedMesh*>& own = prototype.first.meshes;
    return !std::all_of(own.begin(), own.end(), [&](const DicedMesh* mesh) { return meshes.contains(mesh); });
  });
}

}  // namespace encore
