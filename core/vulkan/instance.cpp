// The Vulkan loader, the instance, the validation layer, and the devices that drivers offer.
#include <cstring>
#include <optional>

#include "core/vulkan/device_impl.h"

namespace encore {

const char* const kInstallDriver =
    "Install the driver of the graphics card, or the software device: package mesa-vulkan-drivers, Mesa 25 "
    "(Debian 12: from bookworm-backports), and libvulkan1";

namespace {

constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";

// VK_TRUE makes the layer skip the offending call, which spares the driver what might crash it.
VKAPI_ATTR VkBool32 VKAPI_CALL collectMessage(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                              VkDebugUtilsMessageTypeFlagsEXT,
                                              const VkDebugUtilsMessengerCallbackDataEXT* data, void* log) {
  static_cast<ValidationLog*>(log)->add(data->pMessage);
  return severity >= VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT ? VK_TRUE : VK_FALSE;
}

// Type eGeneral is left out: that is the loader talking about drivers of absent hardware.
vk::DebugUtilsMessengerCreateInfoEXT messengerInfo(ValidationLog* log) {
  using Severity = vk::DebugUtilsMessageSeverityFlagBitsEXT;
  return {{},
          Severity::eError | Severity::eWarning,
          vk::DebugUtilsMessageTypeFlagBitsEXT::eValidation,
          &collectMessage,
          log};
}

vk::raii::Context openLoader() {
  try {
    return vk::raii::Context();
  } catch (const std::exception& error) {
    throw Error(ErrorKind::Device,
                std::string("The Vulkan loader, libvulkan.so.1, cannot be opened (") + error.what() + ")", "",
                kInstallDriver);
  }
}

void requireValidationLayer(const vk::raii::Context& context) {
  for (const vk::LayerProperties& layer : context.enumerateInstanceLayerProperties()) {
    if (std::strcmp(layer.layerName, kValidationLayer) == 0) return;
  }
  throw Error(ErrorKind::Device, std::string("The layer ") + kValidationLayer + " is not installed", "",
              "Install the package vulkan-validationlayers, or switch validation off");
}

// What every kernel of Encore relies on.
std::string missingFeatures(const vk::raii::PhysicalDevice& device) {
  const auto chain = device.getFeatures2<vk::PhysicalDeviceFeatures2, vk::PhysicalDeviceVulkan12Features,
                                         vk::PhysicalDeviceVulkan13Features>();
  const auto& v12 = chain.get<vk::PhysicalDeviceVulkan12Features>();
  std::string missing;
  const auto require = [&missing](vk::Bool32 present, const char* name) {
    if (!present) missing += std::string(missing.empty() ? "no " : ", ") + name;
  };
  require(chain.get<vk::PhysicalDeviceFeatures2>().features.shaderInt64, "shaderInt64");
  require(v12.bufferDeviceAddress, "bufferDeviceAddress");
  require(v12.scalarBlockLayout, "scalarBlockLayout");
  require(chain.get<vk::PhysicalDeviceVulkan13Features>().synchronization2, "synchronization2");
  return missing;
}

// A queue family that computes, with timestamps if there is a choice.
std::optional<uint32_t> computeQueue(const vk::raii::PhysicalDevice& device) {
  const auto families = device.getQueueFamilyProperties();
  std::optional<uint32_t> found;
  for (uint32_t i = 0; i < families.size(); ++i) {
    if (!(families[i].queueFlags & vk::QueueFlagBits::eCompute)) continue;
    if (families[i].timestampValidBits > 0) return i;
    if (!found) found = i;
  }
  return found;
}

uint64_t largestLocalHeap(const vk::PhysicalDeviceMemoryProperties& memory) {
  uint64_t bytes = 0;
  for (uint32_t i = 0; i < memory.memoryHeapCount; ++i) {
    if (memory.memoryHeaps[i].flags & vk::MemoryHeapFlagBits::eDeviceLocal) {
      bytes = std::max<uint64_t>(bytes, memory.memoryHeaps[i].size);
    }
  }
  return bytes;
}

// Uncached memory does not count: the host reads it a hundred times slower than a copy takes.
bool hasSharedMemory(const vk::PhysicalDeviceMemoryProperties& memory) {
  using Flag = vk::MemoryPropertyFlagBits;
  const vk::MemoryPropertyFlags wanted =
      Flag::eDeviceLocal | Flag::eHostVisible | Flag::eHostCoherent | Flag::eHostCached;
  for (uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    if ((memory.memoryTypes[i].propertyFlags & wanted) == wanted) return true;
  }
  return false;
}

std::string versionText(uint32_t version) {
  std::string text = std::to_string(VK_API_VERSION_MAJOR(version));
  text += '.';
  text += std::to_string(VK_API_VERSION_MINOR(version));
  return text;
}

Candidate describe(const vk::raii::PhysicalDevice& device) {
  Candidate candidate;
  candidate.physical = device;
  const vk::PhysicalDeviceProperties properties = device.getProperties();
  const vk::PhysicalDeviceMemoryProperties memory = device.getMemoryProperties();
  candidate.type = properties.deviceType;
  candidate.info.name = std::string(properties.deviceName.data());
  candidate.info.cpu = properties.deviceType == vk::PhysicalDeviceType::eCpu;
  candidate.info.memory_bytes = largestLocalHeap(memory);
  candidate.info.shared_memory = hasSharedMemory(memory);
  if (properties.apiVersion < VK_API_VERSION_1_3) {
    candidate.unfit = "has Vulkan " + versionText(properties.apiVersion) + ", 1.3 is needed";
    return candidate;
  }
  const auto more = device.getProperties2<vk::PhysicalDeviceProperties2, vk::PhysicalDeviceVulkan11Properties,
                                          vk::PhysicalDeviceVulkan12Properties>();
  const auto& v12 = more.get<vk::PhysicalDeviceVulkan12Properties>();
  candidate.info.driver = std::string(v12.driverName.data()) + " " + std::string(v12.driverInfo.data());
  const auto& v11 = more.get<vk::PhysicalDeviceVulkan11Properties>();
  candidate.info.subgroup_size = v11.subgroupSize;
  candidate.unfit = missingFeatures(device);
  const std::string subgroups = missingSubgroupOperations(v11.subgroupSupportedStages, v11.subgroupSupportedOperations);
  if (!subgroups.empty()) candidate.unfit += (candidate.unfit.empty() ? "" : "; ") + subgroups;
  const std::optional<uint32_t> queue = computeQueue(device);
  if (!queue) candidate.unfit = "no compute queue";
  candidate.queue_family = queue.value_or(0);
  return candidate;
}

}  // namespace

std::string missingSubgroupOperations(vk::ShaderStageFlags stages, vk::SubgroupFeatureFlags operations) {
  if (!(stages & vk::ShaderStageFlagBits::eCompute)) return "no subgroup operations in compute kernels";
  using Operation = vk::SubgroupFeatureFlagBits;
  std::string missing;
  for (const auto& [bit, name] : {std::pair{Operation::eBasic, "basic"},
                                  {Operation::eVote, "vote"},
                                  {Operation::eBallot, "ballot"},
                                  {Operation::eArithmetic, "arithmetic"}}) {
    if (!(operations & bit)) missing += std::string(missing.empty() ? "no subgroup " : ", ") + name;
  }
  return missing;
}

void ValidationLog::add(std::string message) {
  const std::lock_guard lock(mutex_);
  messages_.push_back(std::move(message));
}

std::string ValidationLog::take() {
  const std::lock_guard lock(mutex_);
  std::string text;
  for (const std::string& message : std::exchange(messages_, {})) text += (text.empty() ? "" : "\n") + message;
  return text;
}

InstanceBundle::InstanceBundle(bool validation) : context(openLoader()) {
  if (validation) requireValidationLayer(context);
  const vk::ApplicationInfo application("encore", 1, "encore", 1, VK_API_VERSION_1_3);
  const std::vector<const char*> layers(validation ? 1 : 0, kValidationLayer);
  const std::vector<const char*> extensions(validation ? 1 : 0, VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
  const vk::DebugUtilsMessengerCreateInfoEXT messages = messengerInfo(log.get());
  vk::InstanceCreateInfo info({}, &application, layers, extensions);
  if (validation) info.pNext = &messages;
  try {
    instance = vk::raii::Instance(context, info);
    if (validation) messenger = vk::raii::DebugUtilsMessengerEXT(instance, messages);
  } catch (const vk::SystemError& error) {
    throw Error(ErrorKind::Device, std::string("Vulkan 1.3 cannot be started (") + error.what() + ")", "",
                kInstallDriver);
  }
}

std::vector<Candidate> findCandidates(const InstanceBundle& bundle) {
  std::vector<Candidate> candidates;
  try {
    for (const vk::raii::PhysicalDevice& device : vk::raii::PhysicalDevices(bundle.instance)) {
      candidates.push_back(describe(device));
    }
  } catch (const vk::SystemError&) {
    // Without any driver the loader answers with an error instead of an empty list.
  }
  return candidates;
}

}  // namespace encore
