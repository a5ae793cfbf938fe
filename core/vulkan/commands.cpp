// Recording, submission and timing of dispatches.
#include <array>
#include <cstring>

#include "core/vulkan/device_impl.h"

namespace encore {
namespace {

constexpr uint32_t kQueriesPerPool = 256;  // two per timed command

// x * y workgroups that cover `groups` with x and y within the device's limits and little excess.
std::pair<uint32_t, uint32_t> spreadGroups(uint64_t groups, const vk::PhysicalDeviceLimits& limits,
                                           const std::string& kernel) {
  const uint64_t rows = (groups + limits.maxComputeWorkGroupCount[0] - 1) / limits.maxComputeWorkGroupCount[0];
  if (rows > limits.maxComputeWorkGroupCount[1]) {
    throw Error(ErrorKind::Internal, "Kernel " + kernel + ": " + std::to_string(groups) +
                                         " workgroups are more than the device can be given at once");
  }
  return {uint32_t((groups + rows - 1) / rows), uint32_t(rows)};
}

}  // namespace

struct Commands::Impl {
  explicit Impl(Device::Impl& owner)
      : device(owner), buffers(device.device, {*device.command_pool, vk::CommandBufferLevel::ePrimary, 1}) {}

  const vk::raii::CommandBuffer& commands() const { return buffers[0]; }

  // Starts recording; makes the writes of what was recorded before visible to what follows.
  void prepare() {
    if (!recording) {
      commands().begin({vk::CommandBufferUsageFlagBits::eOneTimeSubmit});
      recording = true;
      return;
    }
    using Stage = vk::PipelineStageFlagBits2;
    using Access = vk::AccessFlagBits2;
    const vk::MemoryBarrier2 barrier(Stage::eComputeShader | Stage::eAllTransfer, Access::eMemoryWrite,
                                     Stage::eComputeShader | Stage::eAllTransfer,
                                     Access::eMemoryRead | Access::eMemoryWrite);
    commands().pipelineBarrier2(vk::DependencyInfo({}, barrier));
  }

  void timestamp(uint32_t query, vk::PipelineStageFlagBits2 stage) {
    if (device.timestamp_bits == 0) return;
    const uint32_t pool = query / kQueriesPerPool;
    if (pool == pools.size()) {
      pools.emplace_back(device.device, vk::QueryPoolCreateInfo({}, vk::QueryType::eTimestamp, kQueriesPerPool));
    }
    if (query % kQueriesPerPool == 0) commands().resetQueryPool(*pools[pool], 0, kQueriesPerPool);
    commands().writeTimestamp2(stage, *pools[pool], query % kQueriesPerPool);
  }

  // Records `record` between two timestamps that count as `name`.
  template <class F>
  void timed(const std::string& name, F&& record) {
    device.guarded("recording " + name, [&] {
      prepare();
      const uint32_t query = uint32_t(names.size()) * 2;
      timestamp(query, vk::PipelineStageFlagBits2::eTopOfPipe);
      record();
      timestamp(query + 1, vk::PipelineStageFlagBits2::eAllCommands);
      names.push_back(name);
    });
  }

  void finish() {
    using Stage = vk::PipelineStageFlagBits2;
    const vk::MemoryBarrier2 barrier(Stage::eAllCommands, vk::AccessFlagBits2::eMemoryWrite, Stage::eHost,
                                     vk::AccessFlagBits2::eHostRead | vk::AccessFlagBits2::eHostWrite);
    commands().pipelineBarrier2(vk::DependencyInfo({}, barrier));
    commands().end();
    device.submitAndWait(*commands());
  }

  std::vector<uint64_t> readTimestamps() const {
    std::vector<uint64_t> ticks;
    const uint32_t queries = uint32_t(names.size()) * 2;
    for (uint32_t first = 0; first < queries && device.timestamp_bits > 0; first += kQueriesPerPool) {
      const uint32_t count = std::min(kQueriesPerPool, queries - first);
      const auto results = pools[first / kQueriesPerPool].getResults<uint64_t>(
          0, count, count * sizeof(uint64_t), sizeof(uint64_t),
          vk::QueryResultFlagBits::e64 | vk::QueryResultFlagBits::eWait);
      ticks.insert(ticks.end(), results.second.begin(), results.second.end());
    }
    ticks.resize(queries, 0);
    return ticks;
  }

  // Ticks wrap around at the queue's number of valid bits.
  void addTimings() {
    const uint64_t mask = device.timestamp_bits >= 64 ? ~0ull : (1ull << device.timestamp_bits) - 1;
    const std::vector<uint64_t> ticks = readTimestamps();
    for (size_t i = 0; i < names.size(); ++i) {
      KernelTiming& timing = device.timings[names[i]];
      timing.dispatches += 1;
      timing.seconds += double((ticks[2 * i + 1] - ticks[2 * i]) & mask) * device.limits.timestampPeriod * 1e-9;
    }
  }

  void clear() {
    commands().reset();
    recording = false;
    names.clear();
  }

  Device::Impl& device;
  vk::raii::CommandBuffers buffers;
  std::vector<vk::raii::QueryPool> pools;  // query q is number q % kQueriesPerPool of pool q / kQueriesPerPool
  std::vector<std::string> names;          // of the commands recorded; command i has queries 2i and 2i + 1
  bool recording = false;
};

Commands::Commands(Device& device) : impl_(std::make_unique<Impl>(device.impl())) {}
Commands::~Commands() = default;

void Commands::dispatchBytes(const Kernel& kernel, uint64_t groups, std::span<const std::byte> arguments) {
  if (groups == 0) return;
  if (!kernel.impl()) throw Error(ErrorKind::Internal, "A kernel that was never created cannot be dispatched");
  const auto [x, y] = spreadGroups(groups, impl_->device.limits, kernel.name());
  // All of the range is pushed, so that a kernel never sees undefined bytes.
  std::array<std::byte, kPushConstantBytes> push{};
  std::memcpy(push.data(), arguments.data(), arguments.size());
  impl_->timed(kernel.name(), [&, x = x, y = y] {
    const vk::raii::CommandBuffer& commands = impl_->commands();
    commands.bindPipeline(vk::PipelineBindPoint::eCompute, *kernel.impl()->pipeline);
    commands.pushConstants<std::byte>(*impl_->device.layout, vk::ShaderStageFlagBits::eCompute, 0, push);
    commands.dispatch(x, y, 1);
  });
}

void Commands::fill(RawBuffer& buffer, uint32_t value) {
  if (buffer.bytes() == 0) return;
  impl_->timed("fill",
               [&] { impl_->commands().fillBuffer(*buffer.impl()->buffer, 0, buffer.impl()->padded_bytes, value); });
}

void Commands::run() {
  if (!impl_->recording) return;
  try {
    impl_->device.guarded("running commands", [this] {
      impl_->device.throwIfInvalid("recording commands");
      impl_->finish();
      impl_->addTimings();
    });
  } catch (...) {
    impl_->clear();
    throw;
  }
  impl_->clear();
}

}  // namespace encore
