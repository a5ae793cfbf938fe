#include "core/render/render_cache.h"

#include <mutex>
#include <optional>

#include "core/dice/dice_cache.h"
#include "core/pattern/pattern_cache.h"
#include "core/shade/light_image_cache.h"
#include "core/trace/trace_cache.h"

namespace encore {
namespace {

// Members go before the device that they are of.
struct DeviceParts {
  explicit DeviceParts(Device& on) : device(on.shared_from_this()), patterns(on) {}

  std::shared_ptr<Device> device;
  KernelStore kernels;
  PatternCache patterns;
};

}  // namespace

struct RenderCache::Impl {
  mutable std::mutex mutex;
  DiceCache dice;
  TraceCache trace;
  LightImageCache lights;
  std::optional<DeviceParts> parts;  // none before the first frame
};

struct RenderCache::Use::Hold {
  Hold(RenderCache::Impl& impl_, Device& device) : lock(impl_.mutex), impl(impl_) {
    if (impl.parts && impl.parts->device.get() != &device) impl.parts.reset();
    if (!impl.parts) impl.parts.emplace(device);
    kernels.emplace(device, impl.parts->kernels);
  }

  const std::lock_guard<std::mutex> lock;
  RenderCache::Impl& impl;
  std::optional<KernelStore::Use> kernels;
};

RenderCache::Use::Use(RenderCache& cache, Device& device) : hold_(std::make_unique<Hold>(*cache.impl_, device)) {}
RenderCache::Use::~Use() = default;

DiceCache* RenderCache::Use::dice() const { return &hold_->impl.dice; }
TraceCache* RenderCache::Use::trace() const { return &hold_->impl.trace; }
PatternCache* RenderCache::Use::patterns() const { return &hold_->impl.parts->patterns; }
LightImageCache* RenderCache::Use::lights() const { return &hold_->impl.lights; }

RenderCache::RenderCache() : impl_(std::make_unique<Impl>()) {}
RenderCache::~RenderCache() = default;

RenderCache::Counts RenderCache::held() const {
  const std::lock_guard lock(impl_->mutex);
  Counts counts{impl_->dice.size(), impl_->trace.size(), 0, 0, 0, impl_->lights.size()};
  if (!impl_->parts) return counts;
  counts.programs = impl_->parts->patterns.programs();
  counts.kernels = impl_->parts->kernels.size();
  counts.textures = impl_->parts->patterns.textures();
  return counts;
}

RenderCache::Counts RenderCache::made() const {
  const std::lock_guard lock(impl_->mutex);
  Counts counts{impl_->dice.diced(), impl_->trace.built(), 0, 0, 0, impl_->lights.decoded()};
  if (!impl_->parts) return counts;
  counts.programs = impl_->parts->patterns.compiled();
  counts.kernels = impl_->parts->kernels.made();
  counts.textures = impl_->parts->patterns.read();
  return counts;
}

std::shared_ptr<Device> RenderCache::device() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->parts ? impl_->parts->device : nullptr;
}

}  // namespace encore
