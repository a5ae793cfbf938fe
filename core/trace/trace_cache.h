// What tracing leaves behind for scenes that follow: Embree's structures of prototypes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace encore {

// Of the last scene that was built with it. Not thread-safe while a scene is built.
class TraceCache {
 public:
  TraceCache();
  ~TraceCache();
  TraceCache(const TraceCache&) = delete;
  TraceCache& operator=(const TraceCache&) = delete;

  size_t size() const;     // prototypes
  uint64_t built() const;  // prototypes that the last scene did not find in it

  struct Impl;
  Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
