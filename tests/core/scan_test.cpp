// Exclusive scan against its twin, at sizes around its runs and beyond 128 MiB.
#include "core/reuse/scan.h"

#include <gtest/gtest.h>

#include <random>

#include "core/scene/error.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/scan_twin.h"

namespace encore {
namespace {

class ScanTest : public testing::Test {
 protected:
  std::vector<uint32_t> scanned(const std::vector<uint32_t>& words) {
    Buffer<uint32_t> buffer = twin::upload(*device_, words);
    scan_.reserve(uint32_t(words.size()));
    Commands commands(*device_);
    scan_.record(commands, buffer.address(), uint32_t(words.size()));
    commands.run();
    return twin::download(buffer);
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  Scan scan_{*device_};
};

std::vector<uint32_t> randomWords(size_t count, uint32_t mask) {
  std::mt19937 random(7);
  std::vector<uint32_t> words(count);
  for (uint32_t& word : words) word = uint32_t(random()) & mask;
  return words;
}

TEST_F(ScanTest, AgreesWithTwinAtAllSizes) {
  const size_t sizes[] = {
      0, 1, 2, 63, 64, 65, 503, 504, 505, 1007, 1008, 1009, 504 * 504 - 1, 504 * 504, 504 * 504 + 1, 1'000'000};
  for (const size_t size : sizes) {
    const std::vector<uint32_t> words = randomWords(size, 0xff);
    EXPECT_EQ(scanned(words), twin::exclusiveScan(words)) << size;
  }
}

TEST_F(ScanTest, WrapsAroundLikeUnsignedAddition) {
  const std::vector<uint32_t> words = randomWords(100'000, 0xffffffffu);
  EXPECT_EQ(scanned(words), twin::exclusiveScan(words));
}

TEST_F(ScanTest, ReachesBeyond128MiB) {
  const std::vector<uint32_t> words = randomWords(36'000'000, 1);
  EXPECT_TRUE(scanned(words) == twin::exclusiveScan(words));
}

TEST_F(ScanTest, RefusesWhatWasNotReserved) {
  const Buffer<uint32_t> words(*device_, 100'000, "words");
  Commands commands(*device_);
  EXPECT_THROW(scan_.record(commands, words.address(), 100'000), Error);
}

}  // namespace
}  // namespace encore
