// A Vulkan device for compute: choice, command submission, timings. Nothing here knows the renderer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace encore {

struct DeviceOptions {
  std::string select = {};  // name (case-insensitive substring) or index; empty: $ENCORE_DEVICE, else the best
  bool validation = false;  // VK_LAYER_KHRONOS_validation; its messages become Error(Device) at submission
  bool staging = false;     // host copies even where memory is shared: how tests reach that path
};

struct DeviceInfo {
  std::string name, driver;
  bool cpu = false;            // a software device, such as lavapipe
  bool shared_memory = false;  // buffers are mapped where they live: no copies
  uint32_t subgroup_size = 0;
  uint64_t memory_bytes = 0;  // of the largest device-local heap
};

struct KernelTiming {
  uint64_t dispatches = 0;
  double seconds = 0;
};

class Kernel;
class RawBuffer;

// One device with one compute queue. Not thread-safe: one thread submits at a time.
// Must outlive its buffers, kernels and commands.
class Device : public std::enable_shared_from_this<Device> {
 public:
  // Throws Error(Device) that says what was found and what to install.
  static std::shared_ptr<Device> create(const DeviceOptions& options = {});
  // Every device of every driver, usable or not, in the order of the indices that select one.
  // Empty when there is no driver or no loader; create() says what is missing.
  static std::vector<DeviceInfo> list();
  ~Device();

  const DeviceInfo& info() const;
  // Seconds on the device per kernel name since the last reset (timestamp queries).
  const std::map<std::string, KernelTiming>& timings() const;
  void resetTimings();
  // Bytes of device memory in live buffers, and the most there ever were.
  uint64_t allocatedBytes() const;
  uint64_t peakAllocatedBytes() const;

  struct Impl;
  Impl& impl() { return *impl_; }

 private:
  explicit Device(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// A storage buffer with a device address. On devices with shared memory host() is the buffer itself;
// elsewhere it is a host copy that toDevice() and toHost() move.
class RawBuffer {
 public:
  RawBuffer();
  RawBuffer(Device& device, size_t bytes, std::string_view name);
  RawBuffer(RawBuffer&&) noexcept;
  RawBuffer& operator=(RawBuffer&&) noexcept;
  ~RawBuffer();

  std::byte* host() const;
  size_t bytes() const;
  uint64_t address() const;  // 0 when empty
  void toDevice(size_t offset, size_t bytes);
  void toHost(size_t offset, size_t bytes);

  struct Impl;
  Impl* impl() const { return impl_.get(); }

 private:
  std::unique_ptr<Impl> impl_;
};

// A RawBuffer of `size` elements of a trivially copyable T. Contents start undefined.
template <class T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(Device& device, size_t size, std::string_view name) : raw_(device, size * sizeof(T), name), size_(size) {}

  std::span<T> host() const { return {reinterpret_cast<T*>(raw_.host()), size_}; }
  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  uint64_t address(size_t first = 0) const { return raw_.address() + first * sizeof(T); }
  void toDevice() { toDevice(0, size_); }
  void toDevice(size_t first, size_t count) { raw_.toDevice(first * sizeof(T), count * sizeof(T)); }
  void toHost() { toHost(0, size_); }
  void toHost(size_t first, size_t count) { raw_.toHost(first * sizeof(T), count * sizeof(T)); }
  RawBuffer& raw() { return raw_; }
  // Replaces the buffer by a larger one when it is too small. Contents are lost then.
  void reserve(Device& device, size_t size, std::string_view name) {
    if (size > size_) {
      *this = Buffer();
      *this = Buffer(device, size, name);
    }
  }

 private:
  RawBuffer raw_;
  size_t size_ = 0;
};

// A compute kernel: one entry point `main`, push constants for all arguments (buffers by address).
class Kernel {
 public:
  Kernel();
  // spirv: as compiled by CMake or by compileGlsl(). constants: values of specialisation constants 0, 1, …
  Kernel(Device& device, std::string name, std::span<const uint32_t> spirv, std::span<const uint32_t> constants = {});
  Kernel(Kernel&&) noexcept;
  Kernel& operator=(Kernel&&) noexcept;
  ~Kernel();

  const std::string& name() const;
  struct Impl;
  Impl* impl() const { return impl_.get(); }

 private:
  std::shared_ptr<Impl> impl_;
};

// Kernels of a device that outlive those who made them: making one takes a millisecond or more.
class KernelStore {
 public:
  KernelStore();
  ~KernelStore();
  KernelStore(const KernelStore&) = delete;
  KernelStore& operator=(const KernelStore&) = delete;

  // While this exists, kernels that are made on the device are taken from the store if one of the same name, code and
  // constants is in it. At its end those leave the store that nobody has asked for. The device must outlive the store.
  class Use {
   public:
    Use(Device& device, KernelStore& store);
    ~Use();
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;

   private:
    Device& device_;
    KernelStore& store_;
  };

  size_t size() const;
  uint64_t made() const;  // kernels that were not there, since the last use began

  struct Impl;
  Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

// Records dispatches and runs them in order; each sees the writes of those before it.
// Kernels and buffers must live until run() has returned.
class Commands {
 public:
  explicit Commands(Device& device);
  ~Commands();

  // groups: workgroups in x, any number (spread over y when there are more than the device's limit:
  // kernels compute their group as gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x and test
  // their range). arguments: at most 128 bytes, scalar layout.
  template <class Push>
  void dispatch(const Kernel& kernel, uint64_t groups, const Push& arguments) {
    static_assert(sizeof(Push) <= 128 && std::is_trivially_copyable_v<Push>);
    dispatchBytes(kernel, groups, std::as_bytes(std::span<const Push, 1>(&arguments, 1)));
  }
  void fill(RawBuffer& buffer, uint32_t value);
  // Submits, waits, adds to the timings. Throws Error(Device). The object is empty and usable again after it.
  void run();

 private:
  void dispatchBytes(const Kernel& kernel, uint64_t groups, std::span<const std::byte> arguments);
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Workgroups of `local` invocations that cover `count`.
inline uint64_t groupsFor(uint64_t count, uint32_t local) { return (count + local - 1) / local; }

}  // namespace encore
