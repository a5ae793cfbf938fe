// What tracing leaves behind for scenes that follow: Embree's structures of prototypes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <set>

namespace encore {

struct DicedMesh;

// Of the last scene that was built with it. Not thread-safe while a scene is built.
class TraceCache {
 public:
  TraceCache();
  ~TraceCache();
  TraceCache(const TraceCache&) = delete;
  TraceCache& operator=(const TraceCache&) = delete;

  size_t size() const;     // prototypes
  uint64_t built() const;  // prototypes that the last scene did not find in it

  // Lets go of all prototypes that are not made of these meshes alone.
  void retainMeshes(const std::set<const DicedMesh*>& meshes);

  struct Impl;
  Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
