// Compaction against its twin.
#include "core/reuse/compaction.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/core/twins/compaction_twin.h"
#include "tests/core/twins/reuse_buffers.h"

namespace encore {
namespace {

constexpr uint32_t kWanted = 0xffffffffu;

class CompactionTest : public testing::Test {
 protected:
  std::vector<uint32_t> places(const std::vector<uint32_t>& words) {
    const uint32_t count = uint32_t(words.size());
    const Buffer<uint32_t> buffer = twin::upload(*device_, words);
    compaction_.reserve(count);
    Commands commands(*device_);
    compaction_.recordCount(commands, buffer.address(), count, kWanted);
    commands.run();
    Buffer<uint32_t> result(*device_, compaction_.matches(count), "places");
    if (result.empty()) return {};
    compaction_.recordWrite(commands, buffer.address(), count, kWanted, result.address());
    commands.run();
    return twin::download(result);
  }

  // A share `density` of the words is the wanted one.
  std::vector<uint32_t> words(size_t count, double density) {
    std::vector<uint32_t> made(count);
    for (uint32_t& word : made) word = double(random_()) * 0x1p-32 < density ? kWanted : uint32_t(random_() % 5);
    return made;
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  Scan scan_{*device_};
  Compaction compaction_{*device_, scan_};
  std::mt19937 random_{5};
};

TEST_F(CompactionTest, AgreesWithTwin) {
  for (const size_t size : {0, 1, 2, 247, 248, 249, 496, 20'000, 1'000'000}) {
    for (const double density : {0.0, 0.001, 0.5, 1.0}) {
      const std::vector<uint32_t> made = words(size, density);
      EXPECT_TRUE(places(made) == twin::placesOf(made, kWanted)) << size << " " << density;
    }
  }
}

TEST_F(CompactionTest, ReachesBeyond128MiB) {
  std::vector<uint32_t> made(36'000'000, 0);
  for (size_t i = 0; i < made.size(); i += 1 + i / 3) made[i] = kWanted;
  made.back() = kWanted;
  EXPECT_TRUE(places(made) == twin::placesOf(made, kWanted));
}

}  // namespace
}  // namespace encore
