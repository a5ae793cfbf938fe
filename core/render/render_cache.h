// What frames leave behind for those that follow, so that a frame after an edit makes anew only what was edited.
//
// Everything in it is kept by all that it depends on: meshes by their identity and edge length (displaced ones also by
// what displaces them), Embree's prototypes by their meshes, programs by their source, textures by their source. So a
// frame with a cache is the frame without, to the last bit, whatever came before it. What a frame does not use leaves
// the cache, at the latest at its end: memory does not grow with edits.
#pragma once

#include <cstdint>
#include <memory>

#include "core/vulkan/device.h"

namespace encore {

class DiceCache;
class LightImageCache;
class PatternCache;
class TraceCache;

class RenderCache {
 public:
  RenderCache();
  ~RenderCache();
  RenderCache(const RenderCache&) = delete;
  RenderCache& operator=(const RenderCache&) = delete;

  // Of what it keeps: how many.
  struct Counts {
    uint64_t meshes = 0;        // diced
    uint64_t prototypes = 0;    // Embree's structures
    uint64_t programs = 0;      // of materials, translated from GLSL
    uint64_t kernels = 0;       // of the device
    uint64_t textures = 0;      // of materials, in device memory
    uint64_t light_images = 0;  // of lights
  };
  // At the end of the last frame that has ended; neither waits for one that is being rendered.
  Counts held() const;
  Counts made() const;  // anew by that frame

  // The device of that frame, which it keeps; null before the first. A frame on another device makes anew what is
  // of the device.
  std::shared_ptr<Device> device() const;

  // A frame's hold of the cache: frames that ask for the same cache at once come one after the other. Throws
  // Error(Internal) for one that is asked for from inside of another.
  class Use {
   public:
    Use(RenderCache& cache, Device& device);
    ~Use();
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

    DiceCache* dice() const;
    TraceCache* trace() const;
    PatternCache* patterns() const;
    LightImageCache* lights() const;

   private:
    struct Hold;
    std::unique_ptr<Hold> hold_;
  };

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
