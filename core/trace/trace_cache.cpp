#include "core/trace/trace_cache.h"

#include "core/trace/trace_cache_impl.h"

namespace encore {

TraceCache::TraceCache() : impl_(std::make_unique<Impl>()) {}
TraceCache::~TraceCache() = default;

size_t TraceCache::size() const { return impl_->prototypes.size(); }
uint64_t TraceCache::built() const { return impl_->built; }

}  // namespace encore
