// Device choice, buffers, kernels and commands, with the validation layer on.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <numeric>

#include "core/scene/error.h"
#include "core/vulkan/device.h"
#include "core/vulkan/device_impl.h"
#include "kernels/vulkan/self_test.h"

namespace encore {
namespace {

// Arguments of shaders/vulkan/self_test.comp: values[i] = member number `turns` of the sequence from i.
struct Arguments {
  uint64_t values;
  uint32_t count, turns;
};

uint32_t sequence(uint32_t value, uint32_t turns) {
  for (uint32_t i = 0; i < turns; ++i) value = value * 1664525u + 1013904223u;
  return value;
}

// Message of the Error of this kind that f throws.
template <class F>
std::string errorOf(ErrorKind kind, F&& f) {
  try {
    f();
  } catch (const Error& error) {
    EXPECT_EQ(int(error.kind()), int(kind)) << error.what();
    return error.what();
  }
  ADD_FAILURE() << "no Error";
  return {};
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

// Sets an environment variable for its lifetime.
class ScopedVariable {
 public:
  ScopedVariable(const char* name, const std::string& value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old;
    setenv(name, value.c_str(), 1);
  }
  ~ScopedVariable() { old_.empty() ? unsetenv(name_) : setenv(name_, old_.c_str(), 1); }

 private:
  const char* name_;
  std::string old_;
};

TEST(DeviceChoice, ListsWhatCreateChooses) {
  const std::vector<DeviceInfo> devices = Device::list();
  ASSERT_FALSE(devices.empty());
  const auto device = Device::create({.validation = true});
  const auto found = std::find_if(devices.begin(), devices.end(),
                                  [&](const DeviceInfo& info) { return info.name == device->info().name; });
  ASSERT_NE(found, devices.end());
  EXPECT_EQ(found->cpu, device->info().cpu);
  EXPECT_FALSE(device->info().driver.empty());
  EXPECT_GT(device->info().subgroup_size, 0u);
  EXPECT_GT(device->info().memory_bytes, 0u);
  const bool any_gpu = std::any_of(devices.begin(), devices.end(), [](const DeviceInfo& i) { return !i.cpu; });
  EXPECT_TRUE(any_gpu || device->info().cpu);
}

TEST(DeviceChoice, IsForcedByIndexOrPartOfName) {
  const std::vector<DeviceInfo> devices = Device::list();
  ASSERT_FALSE(devices.empty());
  EXPECT_EQ(Device::create({.select = "0", .validation = true})->info().name, devices[0].name);
  std::string part = devices[0].name.substr(0, 5);
  for (char& c : part) c = char(std::toupper(static_cast<unsigned char>(c)));
  EXPECT_EQ(Device::create({.select = part, .validation = true})->info().name, devices[0].name);
}

TEST(DeviceChoice, IsForcedByTheEnvironmentUnlessOptionsSayOtherwise) {
  const ScopedVariable variable("ENCORE_DEVICE", "no such device");
  EXPECT_TRUE(contains(errorOf(ErrorKind::Device, [] { Device::create(); }), "no such device"));
  EXPECT_EQ(Device::create({.select = "0"})->info().name, Device::list()[0].name);
}

TEST(DeviceChoice, UnknownNameOrIndexSaysWhatThereIs) {
  for (const char* select : {"imaginary", "999"}) {
    const std::string message = errorOf(ErrorKind::Device, [&] { Device::create({.select = select}); });
    EXPECT_TRUE(contains(message, select)) << message;
    EXPECT_TRUE(contains(message, Device::list()[0].name)) << message;
  }
}

TEST(DeviceChoice, NoDriverSaysWhatToInstall) {
  const ScopedVariable drivers("VK_ICD_FILENAMES", "/nonexistent/driver.json");
  const ScopedVariable new_name("VK_DRIVER_FILES", "/nonexistent/driver.json");
  EXPECT_TRUE(Device::list().empty());
  const std::string message = errorOf(ErrorKind::Device, [] { Device::create(); });
  EXPECT_TRUE(contains(message, "mesa-vulkan-drivers")) << message;
}

TEST(DeviceChoice, NamesMissingSubgroupOperations) {
  using Operation = vk::SubgroupFeatureFlagBits;
  const vk::ShaderStageFlags compute = vk::ShaderStageFlagBits::eCompute;
  const vk::SubgroupFeatureFlags all =
      Operation::eBasic | Operation::eVote | Operation::eBallot | Operation::eArithmetic | Operation::eShuffle;
  EXPECT_EQ(missingSubgroupOperations(compute | vk::ShaderStageFlagBits::eFragment, all), "");
  EXPECT_EQ(missingSubgroupOperations(compute, all & ~vk::SubgroupFeatureFlags(Operation::eBallot)),
            "no subgroup ballot");
  EXPECT_EQ(missingSubgroupOperations(compute, Operation::eBasic), "no subgroup vote, ballot, arithmetic");
  EXPECT_TRUE(contains(missingSubgroupOperations(vk::ShaderStageFlagBits::eFragment, all), "compute"));
}

// Both kinds of memory: shared, and host copies that are moved.
class BufferTest : public testing::TestWithParam<bool> {
 protected:
  std::shared_ptr<Device> device = Device::create({.validation = true, .staging = GetParam()});
};
INSTANTIATE_TEST_SUITE_P(Memory, BufferTest, testing::Bool(),
                         [](const auto& memory) { return memory.param ? "Staging" : "Shared"; });

TEST_P(BufferTest, KernelsSeeWhatTheHostWroteAndBack) {
  EXPECT_FALSE(GetParam() && device->info().shared_memory);
  Buffer<uint32_t> values(*device, 1000, "values");
  std::iota(values.host().begin(), values.host().end(), 7u);
  values.toDevice();
  const Kernel kernel(*device, "sequence", kSelfTestSpirv);
  Commands commands(*device);
  // Elements 100 to 299 only.
  commands.dispatch(kernel, groupsFor(200, 64), Arguments{values.address(100), 200, 3});
  commands.run();
  std::fill(values.host().begin(), values.host().begin() + (device->info().shared_memory ? 0 : 1000), 0u);
  values.toHost();
  for (uint32_t i = 0; i < 1000; ++i) {
    ASSERT_EQ(values.host()[i], i >= 100 && i < 300 ? sequence(i - 100, 3) : i + 7) << i;
  }
}

TEST_P(BufferTest, PartsAreCopiedAlone) {
  Buffer<uint32_t> values(*device, 100, "values");
  Commands commands(*device);
  commands.fill(values.raw(), 5);
  commands.run();
  values.toHost();
  EXPECT_TRUE(std::all_of(values.host().begin(), values.host().end(), [](uint32_t v) { return v == 5; }));
  std::fill(values.host().begin(), values.host().end(), 6u);
  values.toDevice(10, 20);
  values.toHost();
  for (uint32_t i = 0; i < 100 && GetParam(); ++i) ASSERT_EQ(values.host()[i], i >= 10 && i < 30 ? 6u : 5u) << i;
  errorOf(ErrorKind::Internal, [&] { values.toDevice(90, 11); });
  errorOf(ErrorKind::Internal, [&] { values.toHost(101, 0); });
}

TEST_P(BufferTest, EmptyOnesAreLegal) {
  Buffer<uint32_t> none(*device, 0, "none");
  EXPECT_TRUE(none.empty());
  EXPECT_TRUE(none.host().empty());
  EXPECT_EQ(none.address(), 0u);
  none.toDevice();
  none.toHost();
  const Kernel kernel(*device, "nothing", kSelfTestSpirv);
  Commands commands(*device);
  commands.fill(none.raw(), 1);
  commands.dispatch(kernel, 0, Arguments{0, 0, 0});
  commands.run();
  EXPECT_TRUE(device->timings().empty());
}

TEST_P(BufferTest, BytesAreCounted) {
  EXPECT_EQ(device->allocatedBytes(), 0u);
  EXPECT_EQ(device->peakAllocatedBytes(), 0u);
  {
    Buffer<uint32_t> a(*device, 1 << 20, "a");
    Buffer<uint32_t> b(std::move(a));
    EXPECT_GE(device->allocatedBytes(), 4u << 20);
    EXPECT_LT(device->allocatedBytes(), 5u << 20);
    b.reserve(*device, 10, "b");  // large enough already
    EXPECT_EQ(b.size(), 1u << 20);
    b.reserve(*device, 2 << 20, "b");
    EXPECT_EQ(b.size(), 2u << 20);
  }
  EXPECT_EQ(device->allocatedBytes(), 0u);
  EXPECT_GE(device->peakAllocatedBytes(), 8u << 20);
  EXPECT_LT(device->peakAllocatedBytes(), 9u << 20);
}

TEST_P(BufferTest, OddSizesAreFilledToTheEnd) {
  Buffer<uint8_t> bytes(*device, 7, "bytes");
  Commands commands(*device);
  commands.fill(bytes.raw(), 0x04030201);
  commands.run();
  bytes.toHost();
  for (uint32_t i = 0; i < 7; ++i) EXPECT_EQ(bytes.host()[i], i % 4 + 1);
}

class CommandsTest : public testing::Test {
 protected:
  std::shared_ptr<Device> device = Device::create({.validation = true});
};

TEST_F(CommandsTest, TooLargeABufferIsAMemoryErrorWithNameAndBytes) {
  const std::string message =
      errorOf(ErrorKind::Memory, [&] { Buffer<uint8_t>(*device, size_t(1) << 50, "enormous"); });
  EXPECT_TRUE(contains(message, "enormous")) << message;
  EXPECT_TRUE(contains(message, std::to_string(size_t(1) << 50))) << message;
  EXPECT_EQ(device->allocatedBytes(), 0u);
}

TEST_F(CommandsTest, AnyNumberOfGroups) {
  const uint32_t local = 1;  // more groups in x than most devices take: 65,535
  for (const uint32_t count : {1u, 65535u, 65536u, 65537u, 200001u}) {
    Buffer<uint32_t> values(*device, count + 1, "values");
    const Kernel kernel(*device, "sequence", kSelfTestSpirv, {{local}});
    Commands commands(*device);
    commands.fill(values.raw(), 42);
    commands.dispatch(kernel, groupsFor(count, local), Arguments{values.address(), count, 1});
    commands.run();
    values.toHost();
    for (uint32_t i = 0; i < count; ++i) ASSERT_EQ(values.host()[i], sequence(i, 1)) << i << " of " << count;
    ASSERT_EQ(values.host()[count], 42u);
  }
}

TEST_F(CommandsTest, SpecialisationSetsTheWorkgroupSize) {
  for (const uint32_t local : {8u, 32u, 128u}) {
    Buffer<uint32_t> values(*device, 1000, "values");
    const Kernel kernel(*device, "sequence", kSelfTestSpirv, {{local}});
    Commands commands(*device);
    commands.fill(values.raw(), 0xffffffff);
    commands.dispatch(kernel, 2, Arguments{values.address(), 1000, 0});  // writes i to the first 2 * local
    commands.run();
    values.toHost();
    for (uint32_t i = 0; i < 1000; ++i) ASSERT_EQ(values.host()[i], i < 2 * local ? i : 0xffffffff) << local;
  }
}

TEST_F(CommandsTest, LaterDispatchesSeeEarlierOnes) {
  Buffer<uint32_t> values(*device, 1 << 16, "values");
  const Kernel kernel(*device, "sequence", kSelfTestSpirv);
  Commands commands(*device);
  for (uint32_t turns = 0; turns < 20; ++turns) {
    commands.fill(values.raw(), 0);
    commands.dispatch(kernel, groupsFor(values.size(), 64), Arguments{values.address(), 1 << 16, turns});
  }
  commands.run();
  values.toHost();
  for (uint32_t i = 0; i < values.size(); ++i) ASSERT_EQ(values.host()[i], sequence(i, 19));
}

TEST_F(CommandsTest, TimingsCountEveryDispatchByName) {
  Buffer<uint32_t> values(*device, 4096, "values");
  const Kernel longer(*device, "longer", kSelfTestSpirv), shorter(*device, "shorter", kSelfTestSpirv);
  Commands commands(*device);
  for (int run = 0; run < 2; ++run) {
    for (int i = 0; i < 300; ++i) {  // more than one pool of queries
      commands.dispatch(shorter, 1, Arguments{values.address(), 64, 1});
    }
    commands.dispatch(longer, groupsFor(4096, 64), Arguments{values.address(), 4096, 20'000});
    commands.run();
  }
  EXPECT_EQ(device->timings().at("shorter").dispatches, 600u);
  EXPECT_EQ(device->timings().at("longer").dispatches, 2u);
  EXPECT_GT(device->timings().at("longer").seconds, 0);
  EXPECT_GT(device->timings().at("longer").seconds / 2, device->timings().at("shorter").seconds / 600);
  EXPECT_LT(device->timings().at("longer").seconds, 60);
  device->resetTimings();
  EXPECT_TRUE(device->timings().empty());
}

TEST_F(CommandsTest, LoopsBeyond65535TurnsEnd) {
  Buffer<uint32_t> values(*device, 16, "values");
  const Kernel kernel(*device, "sequence", kSelfTestSpirv);
  Commands commands(*device);
  commands.dispatch(kernel, 1, Arguments{values.address(), 16, 150'000});
  commands.run();
  values.toHost();
  for (uint32_t i = 0; i < 16; ++i) EXPECT_EQ(values.host()[i], sequence(i, 150'000));
}

TEST_F(CommandsTest, MisuseIsAnError) {
  Commands commands(*device);
  errorOf(ErrorKind::Internal, [&] { commands.dispatch(Kernel(), 1, Arguments{}); });
  const Kernel kernel(*device, "sequence", kSelfTestSpirv);
  errorOf(ErrorKind::Internal, [&] { commands.dispatch(kernel, uint64_t(1) << 62, Arguments{}); });
  commands.run();  // nothing was recorded
  EXPECT_TRUE(device->timings().empty());
}

TEST_F(CommandsTest, ValidationCatchesWhatIsNotSpirv) {
  const std::vector<uint32_t> garbage = {0x07230203, 0x00010600, 0, 1, 0, 0xffffffff};
  const std::string message = errorOf(ErrorKind::Device, [&] { const Kernel kernel(*device, "garbage", garbage); });
  EXPECT_TRUE(contains(message, "garbage")) << message;
  EXPECT_TRUE(contains(message, "alidation")) << message;
}

TEST_F(CommandsTest, ValidationCatchesAKernelThatDiedBeforeTheRun) {
  Buffer<uint32_t> values(*device, 1, "values");
  Commands commands(*device);
  {
    const Kernel kernel(*device, "short_lived", kSelfTestSpirv);
    commands.dispatch(kernel, 1, Arguments{values.address(), 1, 5});
  }
  const std::string message = errorOf(ErrorKind::Device, [&] { commands.run(); });
  EXPECT_TRUE(contains(message, "short_lived")) << message;
}

TEST_F(CommandsTest, ValidationMessagesAreNotCarriedOver) {
  const std::vector<uint32_t> garbage(8, 0);
  errorOf(ErrorKind::Device, [&] { const Kernel kernel(*device, "garbage", garbage); });
  Buffer<uint32_t> values(*device, 1, "values");
  const Kernel kernel(*device, "sequence", kSelfTestSpirv);
  Commands commands(*device);
  commands.dispatch(kernel, 1, Arguments{values.address(), 1, 5});
  commands.run();
  values.toHost();
  EXPECT_EQ(values.host()[0], sequence(0, 5));
}

// By name, code and constants, for as long as each use asks for them.
TEST_F(CommandsTest, KernelsOfAStoreAreMadeOnce) {
  KernelStore store;
  const auto pipelineOf = [](const Kernel& kernel) { return kernel.impl(); };
  const Kernel::Impl* first = nullptr;
  {
    const KernelStore::Use use(*device, store);
    const Kernel kernel(*device, "sequence", kSelfTestSpirv, {{64}}),
        other(*device, "sequence", kSelfTestSpirv, {{32}});
    const Kernel again(*device, "sequence", kSelfTestSpirv, {{64}}), named(*device, "named", kSelfTestSpirv, {{64}});
    first = pipelineOf(kernel);
    EXPECT_EQ(pipelineOf(again), first);
    EXPECT_NE(pipelineOf(other), first);
    EXPECT_EQ(named.name(), "named");
    EXPECT_EQ(store.made(), 3u);
  }
  EXPECT_EQ(store.size(), 3u);
  {
    const KernelStore::Use use(*device, store);
    const Kernel kernel(*device, "sequence", kSelfTestSpirv, {{64}});
    EXPECT_EQ(pipelineOf(kernel), first);
    EXPECT_EQ(store.made(), 0u);
    Buffer<uint32_t> values(*device, 1, "values");
    Commands commands(*device);
    commands.dispatch(kernel, 1, Arguments{values.address(), 1, 5});
    commands.run();
    values.toHost();
    EXPECT_EQ(values.host()[0], sequence(0, 5));
  }
  EXPECT_EQ(store.size(), 1u) << "what the last use did not ask for is gone";
  const Kernel own(*device, "sequence", kSelfTestSpirv, {{64}});
  EXPECT_NE(pipelineOf(own), first) << "no store is in use";
}

}  // namespace
}  // namespace encore
