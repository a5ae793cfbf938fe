// Choice of the device, its creation, and the self-test that catches drivers known to compute wrongly.
#include "core/vulkan/device.h"

#include <cctype>
#include <charconv>
#include <cstdlib>

#include "core/vulkan/device_impl.h"
#include "kernels/vulkan/self_test.h"

namespace encore {
namespace {

std::string lowerCase(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = char(std::tolower(static_cast<unsigned char>(c)));
  return lower;
}

// "0: llvmpipe (…); 1: …", with what each lacks.
std::string describeAll(const std::vector<Candidate>& candidates) {
  std::string text;
  for (size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& c = candidates[i];
    text += (i == 0 ? "" : "; ") + std::to_string(i) + ": " + c.info.name;
    if (!c.unfit.empty()) text += " (" + c.unfit + ")";
  }
  return text.empty() ? "none" : text;
}

int preference(vk::PhysicalDeviceType type) {
  switch (type) {
    case vk::PhysicalDeviceType::eDiscreteGpu:
      return 4;
    case vk::PhysicalDeviceType::eIntegratedGpu:
      return 3;
    case vk::PhysicalDeviceType::eVirtualGpu:
      return 2;
    case vk::PhysicalDeviceType::eCpu:
      return 1;
    default:
      return 0;
  }
}

// The device with this index, else the first whose name contains the text; -1: none.
int findSelected(const std::vector<Candidate>& candidates, const std::string& select) {
  size_t index = 0;
  const char* const end = select.data() + select.size();
  const auto parsed = std::from_chars(select.data(), end, index);
  if (parsed.ec == std::errc() && parsed.ptr == end && index < candidates.size()) return int(index);
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (lowerCase(candidates[i].info.name).find(lowerCase(select)) != std::string::npos) return int(i);
  }
  return -1;
}

int findBest(const std::vector<Candidate>& candidates) {
  int best = -1;
  for (size_t i = 0; i < candidates.size(); ++i) {
    if (!candidates[i].unfit.empty()) continue;
    if (best < 0 || preference(candidates[i].type) > preference(candidates[size_t(best)].type)) best = int(i);
  }
  return best;
}

Candidate choose(std::vector<Candidate>&& candidates, const std::string& select) {
  const std::string found = "Devices found: " + describeAll(candidates);
  if (!select.empty()) {
    const int selected = findSelected(candidates, select);
    if (selected < 0) {
      throw Error(ErrorKind::Device, "No Vulkan device is called or numbered \"" + select + "\". " + found,
                  "ENCORE_DEVICE", "Name one of these by its number or a part of its name, or none");
    }
    Candidate& candidate = candidates[size_t(selected)];
    if (!candidate.unfit.empty()) {
      throw Error(ErrorKind::Device, "The Vulkan device " + candidate.info.name + " cannot be used: " + candidate.unfit,
                  "ENCORE_DEVICE", "Choose another one. " + found);
    }
    return std::move(candidate);
  }
  const int best = findBest(candidates);
  if (best < 0) throw Error(ErrorKind::Device, "No usable Vulkan device. " + found, "", kInstallDriver);
  return std::move(candidates[size_t(best)]);
}

using FeatureChain = vk::StructureChain<vk::PhysicalDeviceFeatures2, vk::PhysicalDeviceVulkan11Features,
                                        vk::PhysicalDeviceVulkan12Features, vk::PhysicalDeviceVulkan13Features>;

// The needed features (which findCandidates has checked), and the optional ones where they exist.
FeatureChain enabledFeatures(const vk::raii::PhysicalDevice& physical) {
  const auto has = physical.getFeatures2<vk::PhysicalDeviceFeatures2, vk::PhysicalDeviceVulkan11Features,
                                         vk::PhysicalDeviceVulkan12Features, vk::PhysicalDeviceVulkan13Features>();
  const auto& has10 = has.get<vk::PhysicalDeviceFeatures2>().features;
  const auto& has11 = has.get<vk::PhysicalDeviceVulkan11Features>();
  const auto& has12 = has.get<vk::PhysicalDeviceVulkan12Features>();
  const auto& has13 = has.get<vk::PhysicalDeviceVulkan13Features>();
  FeatureChain use;
  auto& use10 = use.get<vk::PhysicalDeviceFeatures2>().features;
  use10.shaderInt64 = true;
  use10.shaderInt16 = has10.shaderInt16;
  use10.shaderFloat64 = has10.shaderFloat64;
  use.get<vk::PhysicalDeviceVulkan11Features>().storageBuffer16BitAccess = has11.storageBuffer16BitAccess;
  auto& use12 = use.get<vk::PhysicalDeviceVulkan12Features>();
  use12.bufferDeviceAddress = true;
  use12.scalarBlockLayout = true;
  use12.storageBuffer8BitAccess = has12.storageBuffer8BitAccess;
  use12.shaderFloat16 = has12.shaderFloat16;
  use12.shaderInt8 = has12.shaderInt8;
  use12.shaderBufferInt64Atomics = has12.shaderBufferInt64Atomics;
  use12.shaderSharedInt64Atomics = has12.shaderSharedInt64Atomics;
  use12.shaderSubgroupExtendedTypes = has12.shaderSubgroupExtendedTypes;
  use12.timelineSemaphore = has12.timelineSemaphore;
  auto& use13 = use.get<vk::PhysicalDeviceVulkan13Features>();
  use13.synchronization2 = true;
  use13.maintenance4 = has13.maintenance4;
  return use;
}

constexpr uint32_t kSelfTestTurns = 100'000;

// The twin of shaders/vulkan/self_test.comp.
uint32_t selfTestValue(uint32_t seed) {
  uint32_t value = seed;
  for (uint32_t i = 0; i < kSelfTestTurns; ++i) value = value * 1664525u + 1013904223u;
  return value;
}

void selfTest(Device& device) {
  struct Arguments {
    uint64_t values;
    uint32_t count, turns;
  };
  constexpr uint32_t kCount = 8;
  Buffer<uint32_t> values(device, kCount, "self_test");
  const Kernel kernel(device, "self_test", kSelfTestSpirv);
  Commands commands(device);
  commands.dispatch(kernel, 1, Arguments{values.address(), kCount, kSelfTestTurns});
  commands.run();
  values.toHost();
  for (uint32_t i = 0; i < kCount; ++i) {
    if (values.host()[i] != selfTestValue(i)) {
      throw Error(ErrorKind::Device,
                  "The driver of " + device.info().name + " (" + device.info().driver +
                      ") computes wrongly: it ends loops of " + std::to_string(kSelfTestTurns) + " turns early",
                  "", "Install Mesa 25 (Debian 12: package mesa-vulkan-drivers from bookworm-backports)");
    }
  }
}

}  // namespace

Device::Impl::Impl(InstanceBundle&& instance_bundle, Candidate&& candidate, const DeviceOptions& options)
    : bundle(std::move(instance_bundle)),
      physical(std::move(candidate.physical)),
      info(std::move(candidate.info)),
      queue_family(candidate.queue_family),
      validation(options.validation),
      staging(options.staging || !info.shared_memory),
      limits(physical.getProperties().limits),
      memory(physical.getMemoryProperties()) {
  info.shared_memory = !staging;
  const auto v13 = physical.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceVulkan11Properties,
                                           vk::PhysicalDeviceVulkan13Properties>();
  max_buffer_bytes = std::min(v13.get<vk::PhysicalDeviceVulkan13Properties>().maxBufferSize,
                              v13.get<vk::PhysicalDeviceVulkan11Properties>().maxMemoryAllocationSize);
  timestamp_bits = physical.getQueueFamilyProperties()[queue_family].timestampValidBits;
  guarded("creating the device", [this] {
    const float priority = 1;
    const vk::DeviceQueueCreateInfo queue_info({}, queue_family, 1, &priority);
    const FeatureChain features = enabledFeatures(physical);
    vk::DeviceCreateInfo device_info({}, queue_info);
    device_info.pNext = &features.get<vk::PhysicalDeviceFeatures2>();
    device = vk::raii::Device(physical, device_info);
    queue = device.getQueue(queue_family, 0);
    command_pool = vk::raii::CommandPool(device, {vk::CommandPoolCreateFlagBits::eResetCommandBuffer, queue_family});
    const vk::PushConstantRange range(vk::ShaderStageFlagBits::eCompute, 0, kPushConstantBytes);
    layout = vk::raii::PipelineLayout(device, vk::PipelineLayoutCreateInfo({}, {}, range));
    fence = vk::raii::Fence(device, vk::FenceCreateInfo());
  });
}

void Device::Impl::throwIfInvalid(std::string_view doing) {
  const std::string messages = bundle.log->take();
  if (!messages.empty()) {
    throw Error(ErrorKind::Device, "Vulkan validation, while " + std::string(doing) + ":\n" + messages);
  }
}

void Device::Impl::submitAndWait(vk::CommandBuffer commands) {
  const vk::CommandBufferSubmitInfo command_info(commands);
  device.resetFences(*fence);
  queue.submit2(vk::SubmitInfo2({}, {}, command_info), *fence);
  if (device.waitForFences(*fence, true, UINT64_MAX) != vk::Result::eSuccess) {
    throw Error(ErrorKind::Device, "The Vulkan device " + info.name + " did not finish its work");
  }
}

void Device::Impl::setName(vk::ObjectType type, uint64_t handle, const std::string& name) {
  if (validation) device.setDebugUtilsObjectNameEXT({type, handle, name.c_str()});
}

int Device::Impl::memoryType(uint32_t allowed, vk::MemoryPropertyFlags wanted) const {
  for (uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    if ((allowed & (1u << i)) && (memory.memoryTypes[i].propertyFlags & wanted) == wanted) return int(i);
  }
  return -1;
}

std::shared_ptr<Device> Device::create(const DeviceOptions& options) {
  const char* const variable = std::getenv("ENCORE_DEVICE");
  const std::string select = !options.select.empty() ? options.select : variable ? variable : "";
  InstanceBundle bundle(options.validation);
  Candidate candidate = choose(findCandidates(bundle), select);
  std::shared_ptr<Device> device(new Device(std::make_unique<Impl>(std::move(bundle), std::move(candidate), options)));
  selfTest(*device);
  device->resetTimings();
  device->impl_->peak_bytes = 0;
  return device;
}

std::vector<DeviceInfo> Device::list() {
  std::vector<DeviceInfo> devices;
  try {
    const InstanceBundle bundle(false);
    for (Candidate& candidate : findCandidates(bundle)) devices.push_back(std::move(candidate.info));
  } catch (const Error&) {
    // No loader or no driver at all: nothing to list.
  }
  return devices;
}

Device::Device(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Device::~Device() = default;

const DeviceInfo& Device::info() const { return impl_->info; }
const std::map<std::string, KernelTiming>& Device::timings() const { return impl_->timings; }
void Device::resetTimings() { impl_->timings.clear(); }
uint64_t Device::allocatedBytes() const { return impl_->allocated_bytes; }
uint64_t Device::peakAllocatedBytes() const { return impl_->peak_bytes; }

}  // namespace encore
