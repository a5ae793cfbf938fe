// Storage buffers, mapped where memory is shared, with a host copy elsewhere.
#include "core/vulkan/device_impl.h"

namespace encore {
namespace {

using MemoryFlag = vk::MemoryPropertyFlagBits;

void checkSize(const Device::Impl& device, size_t bytes, const std::string& name) {
  if (bytes <= device.max_buffer_bytes && bytes <= device.info.memory_bytes) return;
  throw Error(ErrorKind::Memory,
              "Buffer " + name + " needs " + std::to_string(bytes) + " bytes, and " + device.info.name +
                  " allocates at most " + std::to_string(std::min(device.max_buffer_bytes, device.info.memory_bytes)),
              "", "Render with a smaller --memory");
}

vk::raii::DeviceMemory allocate(Device::Impl& device, const vk::MemoryRequirements& needs, int type,
                                const std::string& name) {
  const std::string failed = "Buffer " + name + ": " + device.info.name + " cannot give " + std::to_string(needs.size) +
                             " bytes, with " + std::to_string(device.allocated_bytes) + " bytes in use";
  if (type < 0) throw Error(ErrorKind::Memory, failed + ": no fitting memory type");
  const vk::MemoryAllocateFlagsInfo flags(vk::MemoryAllocateFlagBits::eDeviceAddress);
  vk::MemoryAllocateInfo info(needs.size, uint32_t(type));
  info.pNext = &flags;
  try {
    return vk::raii::DeviceMemory(device.device, info);
  } catch (const vk::SystemError& error) {
    device.throwIfInvalid("allocating buffer " + name);
    throw Error(ErrorKind::Memory, failed + " (" + error.what() + ")", "", "Render with a smaller --memory");
  }
}

}  // namespace

RawBuffer::Impl::Impl(Device::Impl& owner, size_t size, std::string_view buffer_name)
    : device(owner), name(buffer_name), bytes(size), padded_bytes((size + 3) / 4 * 4) {
  checkSize(device, size, name);
  device.guarded("creating buffer " + name, [this] {
    using Usage = vk::BufferUsageFlagBits;
    buffer = vk::raii::Buffer(device.device, vk::BufferCreateInfo({}, padded_bytes,
                                                                  Usage::eStorageBuffer | Usage::eShaderDeviceAddress |
                                                                      Usage::eTransferSrc | Usage::eTransferDst));
    const vk::MemoryRequirements needs = buffer.getMemoryRequirements();
    vk::MemoryPropertyFlags wanted = MemoryFlag::eDeviceLocal;
    if (!device.staging) wanted |= MemoryFlag::eHostVisible | MemoryFlag::eHostCoherent | MemoryFlag::eHostCached;
    memory = allocate(device, needs, device.memoryType(needs.memoryTypeBits, wanted), name);
    buffer.bindMemory(*memory, 0);
    if (!device.staging) mapped = static_cast<std::byte*>(memory.mapMemory(0, VK_WHOLE_SIZE));
    address = device.device.getBufferAddress(*buffer);
    device.setName(vk::ObjectType::eBuffer, uint64_t(static_cast<VkBuffer>(*buffer)), name);
    allocation = needs.size;
  });
  device.allocated_bytes += allocation;
  device.peak_bytes = std::max(device.peak_bytes, device.allocated_bytes);
}

RawBuffer::Impl::~Impl() { device.allocated_bytes -= allocation; }

HostCopy& RawBuffer::Impl::hostCopy() {
  if (host_copy.data) return host_copy;
  device.guarded("creating the host copy of buffer " + name, [this] {
    HostCopy made;
    made.buffer = vk::raii::Buffer(device.device, vk::BufferCreateInfo({}, padded_bytes,
                                                                       vk::BufferUsageFlagBits::eTransferSrc |
                                                                           vk::BufferUsageFlagBits::eTransferDst));
    const vk::MemoryRequirements needs = made.buffer.getMemoryRequirements();
    const vk::MemoryPropertyFlags visible = MemoryFlag::eHostVisible | MemoryFlag::eHostCoherent;
    int type = device.memoryType(needs.memoryTypeBits, visible | MemoryFlag::eHostCached);
    if (type < 0) type = device.memoryType(needs.memoryTypeBits, visible);  // which every device has
    made.memory = allocate(device, needs, type, name);
    made.buffer.bindMemory(*made.memory, 0);
    made.data = static_cast<std::byte*>(made.memory.mapMemory(0, VK_WHOLE_SIZE));
    host_copy = std::move(made);
  });
  return host_copy;
}

void RawBuffer::Impl::copy(size_t offset, size_t count, bool to_device) {
  if (offset > bytes || count > bytes - offset) {
    throw Error(ErrorKind::Internal, "Copy of " + std::to_string(count) + " bytes at " + std::to_string(offset) +
                                         " is outside buffer " + name + " of " + std::to_string(bytes) + " bytes");
  }
  if (mapped || count == 0) return;
  device.guarded("copying buffer " + name, [&] {
    const vk::raii::Buffer& host = hostCopy().buffer;
    vk::raii::CommandBuffers commands(device.device, {*device.command_pool, vk::CommandBufferLevel::ePrimary, 1});
    commands[0].begin({vk::CommandBufferUsageFlagBits::eOneTimeSubmit});
    commands[0].copyBuffer(to_device ? *host : *buffer, to_device ? *buffer : *host,
                           vk::BufferCopy(offset, offset, count));
    const vk::MemoryBarrier2 barrier(vk::PipelineStageFlagBits2::eTransfer, vk::AccessFlagBits2::eTransferWrite,
                                     vk::PipelineStageFlagBits2::eHost, vk::AccessFlagBits2::eHostRead);
    commands[0].pipelineBarrier2(vk::DependencyInfo({}, barrier));
    commands[0].end();
    device.submitAndWait(*commands[0]);
  });
}

RawBuffer::RawBuffer(Device& device, size_t bytes, std::string_view name)
    : impl_(bytes == 0 ? nullptr : std::make_unique<Impl>(device.impl(), bytes, name)) {}
RawBuffer::RawBuffer() = default;
RawBuffer::RawBuffer(RawBuffer&&) noexcept = default;
RawBuffer& RawBuffer::operator=(RawBuffer&&) noexcept = default;
RawBuffer::~RawBuffer() = default;

std::byte* RawBuffer::host() const {
  if (!impl_) return nullptr;
  return impl_->mapped ? impl_->mapped : impl_->hostCopy().data;
}
size_t RawBuffer::bytes() const { return impl_ ? impl_->bytes : 0; }
uint64_t RawBuffer::address() const { return impl_ ? impl_->address : 0; }
void RawBuffer::toDevice(size_t offset, size_t bytes) {
  if (impl_) impl_->copy(offset, bytes, true);
}
void RawBuffer::toHost(size_t offset, size_t bytes) {
  if (impl_) impl_->copy(offset, bytes, false);
}

}  // namespace encore
