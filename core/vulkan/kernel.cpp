// Compute pipelines.
#include "core/vulkan/device_impl.h"

namespace encore {

Kernel::Kernel(Device& device, std::string name, std::span<const uint32_t> spirv, std::span<const uint32_t> constants)
    : impl_(std::make_unique<Impl>()) {
  impl_->name = std::move(name);
  std::vector<vk::SpecializationMapEntry> entries;
  for (uint32_t i = 0; i < constants.size(); ++i) entries.push_back({i, i * 4, 4});
  Device::Impl& on = device.impl();
  on.guarded("creating kernel " + impl_->name, [&] {
    const vk::SpecializationInfo specialization(uint32_t(entries.size()), entries.data(), constants.size_bytes(),
                                                constants.data());
    const vk::raii::ShaderModule module(on.device, vk::ShaderModuleCreateInfo({}, spirv.size_bytes(), spirv.data()));
    const vk::PipelineShaderStageCreateInfo stage({}, vk::ShaderStageFlagBits::eCompute, *module, "main",
                                                  &specialization);
    impl_->pipeline = vk::raii::Pipeline(on.device, nullptr, vk::ComputePipelineCreateInfo({}, stage, *on.layout));
    on.setName(vk::ObjectType::ePipeline, uint64_t(static_cast<VkPipeline>(*impl_->pipeline)), impl_->name);
  });
}

Kernel::Kernel() = default;
Kernel::Kernel(Kernel&&) noexcept = default;
Kernel& Kernel::operator=(Kernel&&) noexcept = default;
Kernel::~Kernel() = default;

const std::string& Kernel::name() const { return impl_->name; }

}  // namespace encore
