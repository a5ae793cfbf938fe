// What the files of core/vulkan share. Only they include this: Vulkan-Hpp is slow to compile.
// vulkan_raii.hpp opens the loader at run time, so that a machine without one gets an Error and not a
// program that does not start.
#pragma once

#include <algorithm>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>
#include <vulkan/vulkan_raii.hpp>

#include "core/scene/error.h"
#include "core/vulkan/device.h"

namespace encore {

inline constexpr uint32_t kPushConstantBytes = 128;  // what every Vulkan device has

// Messages of the validation layer since the last look. The layer may call from any thread.
class ValidationLog {
 public:
  void add(std::string message);
  // All messages, one a line; forgets them.
  std::string take();

 private:
  std::mutex mutex_;
  std::vector<std::string> messages_;
};

// The loader, an instance, and where its validation messages go. Movable: the log stays where it is.
struct InstanceBundle {
  // Throws Error(Device) when there is no loader, no Vulkan 1.3, or no validation layer where asked for.
  explicit InstanceBundle(bool validation);

  vk::raii::Context context;
  std::unique_ptr<ValidationLog> log = std::make_unique<ValidationLog>();
  vk::raii::Instance instance{nullptr};
  vk::raii::DebugUtilsMessengerEXT messenger{nullptr};
};

// A device as the driver offers it. unfit: what it lacks, empty when it can be used.
struct Candidate {
  vk::raii::PhysicalDevice physical{nullptr};
  DeviceInfo info;
  vk::PhysicalDeviceType type = vk::PhysicalDeviceType::eOther;
  uint32_t queue_family = 0;
  std::string unfit;
};
std::vector<Candidate> findCandidates(const InstanceBundle& bundle);

// What compute kernels rely on and a device with these subgroup properties lacks: "" or "no subgroup vote, ballot".
std::string missingSubgroupOperations(vk::ShaderStageFlags stages, vk::SubgroupFeatureFlags operations);

// What to install when there is no device.
extern const char* const kInstallDriver;

struct Device::Impl {
  Impl(InstanceBundle&& bundle, Candidate&& candidate, const DeviceOptions& options);

  // Throws Error(Device) with the validation messages, if there are any.
  void throwIfInvalid(std::string_view doing);
  // Calls f; Vulkan's exceptions and validation messages become Error. doing: "creating kernel x".
  template <class F>
  auto guarded(std::string_view doing, F&& f);
  // Submits recorded commands and waits.
  void submitAndWait(vk::CommandBuffer commands);
  void setName(vk::ObjectType type, uint64_t handle, const std::string& name);
  // Memory type among `allowed` (bits) that has all of `wanted`; -1: none.
  int memoryType(uint32_t allowed, vk::MemoryPropertyFlags wanted) const;

  InstanceBundle bundle;
  vk::raii::PhysicalDevice physical;
  DeviceInfo info;
  uint32_t queue_family;
  bool validation;
  bool staging;  // buffers have host copies
  vk::PhysicalDeviceLimits limits;
  vk::PhysicalDeviceMemoryProperties memory;
  uint64_t max_buffer_bytes = 0;
  uint32_t timestamp_bits = 0;  // 0: the queue has no timestamps
  vk::raii::Device device{nullptr};
  vk::raii::Queue queue{nullptr};
  vk::raii::CommandPool command_pool{nullptr};
  vk::raii::PipelineLayout layout{nullptr};  // of all kernels: push constants only
  vk::raii::Fence fence{nullptr};

  std::map<std::string, KernelTiming> timings;
  KernelStore* kernels = nullptr;  // in use; null: none
  uint64_t allocated_bytes = 0, peak_bytes = 0;
};

template <class F>
auto Device::Impl::guarded(std::string_view doing, F&& f) {
  try {
    if constexpr (std::is_void_v<decltype(f())>) {
      f();
      throwIfInvalid(doing);
    } else {
      auto result = f();
      throwIfInvalid(doing);
      return result;
    }
  } catch (const vk::SystemError& error) {
    throwIfInvalid(doing);
    const bool memory_short =
        error.code() == vk::Result::eErrorOutOfDeviceMemory || error.code() == vk::Result::eErrorOutOfHostMemory;
    throw Error(memory_short ? ErrorKind::Memory : ErrorKind::Device,
                std::string(doing) + " on " + info.name + ": " + error.what());
  }
}

// Host-visible memory behind a buffer of a device without shared memory.
struct HostCopy {
  vk::raii::DeviceMemory memory{nullptr};
  vk::raii::Buffer buffer{nullptr};
  std::byte* data = nullptr;
};

struct RawBuffer::Impl {
  Impl(Device::Impl& owner, size_t size, std::string_view buffer_name);
  ~Impl();
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  HostCopy& hostCopy();
  void copy(size_t offset, size_t count, bool to_device);

  Device::Impl& device;
  std::string name;
  size_t bytes;           // as asked for
  size_t padded_bytes;    // a multiple of 4, as fills need
  size_t allocation = 0;  // bytes of device memory
  vk::raii::DeviceMemory memory{nullptr};
  vk::raii::Buffer buffer{nullptr};
  uint64_t address = 0;
  std::byte* mapped = nullptr;  // only with shared memory
  HostCopy host_copy;           // made when first asked for
};

struct Kernel::Impl {
  std::string name;
  vk::raii::Pipeline pipeline{nullptr};
};

struct KernelStore::Impl {
  struct Entry {
    std::shared_ptr<Kernel::Impl> kernel;
    bool used = true;  // since the use began
  };
  std::map<std::string, Entry> entries;  // by name, code and constants
  uint64_t made = 0;
};

}  // namespace encore
