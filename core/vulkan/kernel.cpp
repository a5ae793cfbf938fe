// Compute pipelines.
#include "core/vulkan/device_impl.h"

namespace encore {

namespace {

std::string keyOf(const std::string& name, std::span<const uint32_t> spirv, std::span<const uint32_t> constants) {
  std::string key = name + '\0' + std::to_string(constants.size()) + '\0';
  for (const auto words : {constants, spirv})
    key.append(reinterpret_cast<const char*>(words.data()), words.size_bytes());
  return key;
}

std::shared_ptr<Kernel::Impl> makeKernel(Device::Impl& on, const std::string& name, std::span<const uint32_t> spirv,
                                         std::span<const uint32_t> constants) {
  const auto made = std::make_shared<Kernel::Impl>();
  made->name = name;
  std::vector<vk::SpecializationMapEntry> entries;
  for (uint32_t i = 0; i < constants.size(); ++i) entries.push_back({i, i * 4, 4});
  on.guarded("creating kernel " + name, [&] {
    const vk::SpecializationInfo specialization(uint32_t(entries.size()), entries.data(), constants.size_bytes(),
                                                constants.data());
    const vk::raii::ShaderModule module(on.device, vk::ShaderModuleCreateInfo({}, spirv.size_bytes(), spirv.data()));
    const vk::PipelineShaderStageCreateInfo stage({}, vk::ShaderStageFlagBits::eCompute, *module, "main",
                                                  &specialization);
    made->pipeline = vk::raii::Pipeline(on.device, nullptr, vk::ComputePipelineCreateInfo({}, stage, *on.layout));
    on.setName(vk::ObjectType::ePipeline, uint64_t(static_cast<VkPipeline>(*made->pipeline)), name);
  });
  return made;
}

}  // namespace

Kernel::Kernel(Device& device, std::string name, std::span<const uint32_t> spirv, std::span<const uint32_t> constants) {
  Device::Impl& on = device.impl();
  if (!on.kernels) {
    impl_ = makeKernel(on, name, spirv, constants);
    return;
  }
  KernelStore::Impl& store = on.kernels->impl();
  std::string key = keyOf(name, spirv, constants);
  auto found = store.entries.find(key);
  if (found == store.entries.end()) {
    found =
        store.entries.emplace(std::move(key), KernelStore::Impl::Entry{makeKernel(on, name, spirv, constants)}).first;
    ++store.made;
  }
  found->second.used = true;
  impl_ = found->second.kernel;
}

Kernel::Kernel() = default;
Kernel::Kernel(Kernel&&) noexcept = default;
Kernel& Kernel::operator=(Kernel&&) noexcept = default;
Kernel::~Kernel() = default;

const std::string& Kernel::name() const { return impl_->name; }

KernelStore::KernelStore() : impl_(std::make_unique<Impl>()) {}
KernelStore::~KernelStore() = default;

size_t KernelStore::size() const { return impl_->entries.size(); }
uint64_t KernelStore::made() const { return impl_->made; }

KernelStore::Use::Use(Device& device, KernelStore& store) : device_(device), store_(store) {
  device.impl().kernels = &store;
  store.impl().made = 0;
  for (auto& [key, entry] : store.impl().entries) entry.used = false;
}

KernelStore::Use::~Use() {
  device_.impl().kernels = nullptr;
  std::erase_if(store_.impl().entries, [](const auto& entry) { return !entry.second.used; });
}

}  // namespace encore
