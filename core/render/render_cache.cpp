#include "core/render/render_cache.h"

#include <atomic>
#include <mutex>
#include <optional>
#include <thread>

#include "core/dice/dice_cache.h"
#include "core/pattern/pattern_cache.h"
#include "core/scene/error.h"
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
  std::mutex frame;                      // held by the frame that uses the cache
  std::atomic<std::thread::id> held_by;  // the thread of that frame

  // What others may ask for at any time, of the frame that ended last.
  mutable std::mutex published;
  Counts held_counts, made_counts;
  std::shared_ptr<Device> last_device;

  DiceCache dice;
  TraceCache trace;
  LightImageCache lights;
  std::optional<DeviceParts> parts;  // none before the first frame
};

struct RenderCache::Use::Hold {
  Hold(RenderCache::Impl& impl_, Device& device) : lock(lockFrame(impl_)), impl(impl_) {
    impl.held_by = std::this_thread::get_id();
    if (impl.parts && impl.parts->device.get() != &device) {
      impl.parts.reset();
      impl.dice.dropDisplaced();  // kernels of the other device made them
    }
    if (!impl.parts) impl.parts.emplace(device);
    kernels.emplace(device, impl.parts->kernels);
    // Prototypes own their meshes: those of what is gone go before anything new is diced.
    impl.dice.onRetained([this](const DiceCache& dice) { impl.trace.retainMeshes(dice.meshes()); });
  }
  ~Hold() {
    impl.dice.onRetained({});
    kernels.reset();
    const std::lock_guard guard(impl.published);
    impl.held_counts = countHeld(impl);
    impl.made_counts = countMade(impl);
    impl.last_device = impl.parts->device;
    impl.held_by = std::thread::id();
  }
  Hold(const Hold&) = delete;
  Hold& operator=(const Hold&) = delete;

  static std::unique_lock<std::mutex> lockFrame(RenderCache::Impl& impl) {
    if (impl.held_by.load() == std::this_thread::get_id())
      throw Error(ErrorKind::Internal, "a frame cannot be rendered from inside of another that uses the same cache");
    return std::unique_lock(impl.frame);
  }
  static Counts countHeld(const RenderCache::Impl& impl) {
    return {impl.dice.size(),
            impl.trace.size(),
            impl.parts->patterns.programs(),
            impl.parts->kernels.size(),
            impl.parts->patterns.textures(),
            impl.lights.size()};
  }
  static Counts countMade(const RenderCache::Impl& impl) {
    return {impl.dice.diced(),          impl.trace.built(),          impl.parts->patterns.compiled(),
            impl.parts->kernels.made(), impl.parts->patterns.read(), impl.lights.decoded()};
  }

  const std::unique_lock<std::mutex> lock;
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
  const std::lock_guard lock(impl_->published);
  return impl_->held_counts;
}

RenderCache::Counts RenderCache::made() const {
  const std::lock_guard lock(impl_->published);
  return impl_->made_counts;
}

std::shared_ptr<Device> RenderCache::device() const {
  const std::lock_guard lock(impl_->published);
  return impl_->last_device;
}

}  // namespace encore
