// Failed samples against the sequential algorithm of §2.3.
#include <gtest/gtest.h>

#include <random>

#include "core/reuse/reuse.h"
#include "core/scene/error.h"
#include "tests/core/twins/failures_twin.h"
#include "tests/core/twins/reuse_buffers.h"

namespace encore {
namespace {

using Share = ReuseKernels::Share;

struct Batch {
  twin::Samples samples;
  std::vector<uint32_t> cells;
  std::vector<uint32_t> shade;
};

class FailuresTest : public testing::Test {
 protected:
  // A share `density` of the slots has failed, on few or many keys.
  Batch batch(uint32_t slots, double density, uint32_t keys) {
    Batch made;
    for (uint32_t i = 0; i < slots; ++i) {
      const bool failed = double(random_()) * 0x1p-32 < density;
      const uint32_t key = uint32_t(random_() % keys);
      const bool none = !failed && random_() % 2;
      made.samples.add({none ? kNoInstance : key % 3, key * 0x01000193u}, {});
      made.cells.push_back(uint32_t(random_() % 7) * 0x24924925u);
      made.shade.push_back(failed ? kShadeNotFound : none ? kShadeNone : uint32_t(random_() % 1000));
    }
    return made;
  }

  void expectServed(const Batch& input, uint32_t samples_per_pixel, uint32_t first_shade, Share share) {
    expectServed(*device_, kernels_, input, samples_per_pixel, first_shade, share);
  }

  static void expectServed(Device& device, ReuseKernels& kernels, const Batch& input, uint32_t samples_per_pixel,
                           uint32_t first_shade, Share share) {
    AaSamples aa = twin::uploadAa(device, input.samples, samples_per_pixel);
    std::copy(input.shade.begin(), input.shade.end(), aa.shade.host().begin());
    aa.shade.toDevice();
    if (share == Share::InCell) aa.cell = twin::upload(device, input.cells);
    const std::vector<uint32_t> heads = kernels.serveFailures(aa, first_shade, share);
    std::vector<uint32_t> shade = input.shade;
    const auto expected =
        twin::serveFailures(input.samples.keys, input.cells, samples_per_pixel, first_shade, share, shade);
    EXPECT_TRUE(heads == expected) << heads.size() << " heads, and not " << expected.size();
    EXPECT_TRUE(twin::download(aa.shade) == shade);
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  ReuseKernels kernels_{*device_};
  std::mt19937 random_{23};
};

TEST_F(FailuresTest, AgreesWithTwin) {
  for (const uint32_t slots : {0, 1, 2, 64, 1000, 200'000}) {
    for (const uint32_t samples_per_pixel : {1, 4, 121, 1000}) {
      for (const double density : {0.0, 0.02, 1.0}) {
        SCOPED_TRACE(std::to_string(slots) + " slots, " + std::to_string(samples_per_pixel) + " per pixel, " +
                     std::to_string(density));
        expectServed(batch(slots, density, 50), samples_per_pixel, 77, Share::InPixel);
      }
    }
  }
}

TEST_F(FailuresTest, AgreesWithTwinOnFewAndManyKeys) {
  for (const uint32_t keys : {1, 2, 1'000'000}) {
    SCOPED_TRACE(keys);
    expectServed(batch(100'000, 0.3, keys), 16, 0, Share::InPixel);
  }
}

TEST_F(FailuresTest, AllSamplesInOneGroup) {
  Batch input = batch(50'000, 1, 1);
  expectServed(input, 50'000, 5, Share::InPixel);
}

TEST_F(FailuresTest, KeysAtTheEndsOfTheirRange) {
  Batch input = batch(5000, 0.5, 10);
  const uint32_t ends[] = {0, 1, 0x80000000u, 0xfffffffeu};
  for (SurfaceKey& key : input.samples.keys) {
    if (key.instance != kNoInstance) key = {ends[random_() % 4], random_() % 2 ? 0xffffffffu : ends[random_() % 4]};
  }
  expectServed(input, 9, 1u << 31, Share::InPixel);
}

TEST_F(FailuresTest, WithoutSharingEverySampleIsAHead) {
  for (const double density : {0.0, 0.1, 1.0}) expectServed(batch(30'000, density, 3), 25, 1000, Share::Nothing);
}

TEST_F(FailuresTest, InCellsAgreesWithTwin) {
  for (const uint32_t slots : {0, 1, 700, 200'000}) {
    for (const uint32_t samples_per_pixel : {1, 4, 121, 0x2000000}) {
      for (const double density : {0.02, 1.0}) {
        SCOPED_TRACE(std::to_string(slots) + " slots, " + std::to_string(samples_per_pixel) + " per pixel, " +
                     std::to_string(density));
        expectServed(batch(slots, density, 20), samples_per_pixel, 3, Share::InCell);
      }
    }
  }
}

TEST_F(FailuresTest, InCellsNeedsCells) {
  const Batch input = batch(100, 1, 5);
  AaSamples aa = twin::uploadAa(*device_, input.samples, 4);
  EXPECT_THROW(kernels_.serveFailures(aa, 0, Share::InCell), Error);
}

// Blocks served one by one have the heads that they have when served together.
TEST_F(FailuresTest, GroupsDoNotDependOnBatches) {
  constexpr uint32_t kPerPixel = 4, kPerBlock = kBlockArea * kPerPixel, kBlocks = 5;
  const Batch whole = batch(kBlocks * kPerBlock, 0.8, 12);
  const auto served = [&](uint32_t first_block, uint32_t blocks, uint32_t first_shade, Share share) {
    Batch part;
    for (uint32_t i = first_block * kPerBlock; i < (first_block + blocks) * kPerBlock; ++i) {
      part.samples.add(whole.samples.keys[i], {});
      part.cells.push_back(whole.cells[i]);
      part.shade.push_back(whole.shade[i]);
    }
    AaSamples aa = twin::uploadAa(*device_, part.samples, kPerPixel);
    aa.shade = twin::upload(*device_, part.shade);
    aa.cell = twin::upload(*device_, part.cells);
    std::vector<uint32_t> heads = kernels_.serveFailures(aa, first_shade, share);
    return std::pair(heads, twin::download(aa.shade));
  };
  for (const Share share : {Share::Nothing, Share::InPixel, Share::InCell}) {
    const auto [heads, shade] = served(0, kBlocks, 1000, share);
    EXPECT_GT(heads.size(), 100u);
    std::vector<uint32_t> joined_heads, joined_shade;
    for (const auto& [first, blocks] : {std::pair{0u, 1u}, {1u, 3u}, {4u, 1u}}) {
      const auto [part_heads, part_shade] = served(first, blocks, 1000 + uint32_t(joined_heads.size()), share);
      for (const uint32_t head : part_heads) joined_heads.push_back(first * kPerBlock + head);
      joined_shade.insert(joined_shade.end(), part_shade.begin(), part_shade.end());
    }
    EXPECT_TRUE(joined_heads == heads);
    EXPECT_TRUE(joined_shade == shade);
  }
}

// Keys that differ in any one word, cell or unit only, in an order without runs.
TEST_F(FailuresTest, GroupsWithoutRuns) {
  Batch input;
  for (uint32_t i = 0; i < 300'000; ++i) {
    const uint32_t scattered = i * 2654435761u;
    input.samples.add({(scattered >> 8) % 2, (scattered >> 9) % 3}, {});
    input.cells.push_back((scattered >> 12) % 2);
    input.shade.push_back(kShadeNotFound);
  }
  for (const Share share : {Share::InPixel, Share::InCell}) expectServed(input, 7, 0, share);
}

TEST_F(FailuresTest, AMillionSlotsTwice) {
  const Batch input = batch(1'000'000, 0.15, 5000);
  expectServed(input, 64, 2'000'000, Share::InPixel);
  expectServed(input, 64, 2'000'000, Share::InPixel);
}

TEST_F(FailuresTest, WorksWithoutSharedMemory) {
  const auto device = Device::create({.validation = true, .staging = true});
  ReuseKernels kernels(*device);
  expectServed(*device, kernels, batch(10'000, 0.2, 40), 8, 3, Share::InPixel);
}

TEST_F(FailuresTest, RefusesShadesThatCannotBeNumbered) {
  const Batch input = batch(100, 1, 5);
  AaSamples aa = twin::uploadAa(*device_, input.samples, 4);
  std::copy(input.shade.begin(), input.shade.end(), aa.shade.host().begin());
  aa.shade.toDevice();
  EXPECT_THROW(kernels_.serveFailures(aa, kShadeNone - 50), Error);
}

TEST(FailureBytesTest, BoundsWhatServingAllocates) {
  for (const uint32_t slots : {1000u, 131'073u}) {
    const auto device = Device::create({.validation = true});
    twin::Samples samples;
    for (uint32_t i = 0; i < slots; ++i) samples.add({i % 3, i * 2654435761u}, {});
    AaSamples aa = twin::uploadAa(*device, samples, 3);
    std::fill(aa.shade.host().begin(), aa.shade.host().end(), kShadeNotFound);
    aa.shade.toDevice();
    const uint64_t before = device->allocatedBytes();
    ReuseKernels kernels(*device);
    EXPECT_EQ(kernels.serveFailures(aa, 0).size(), slots);
    EXPECT_LE(device->peakAllocatedBytes() - before, ReuseKernels::failureBytes(slots)) << slots;
  }
}

}  // namespace
}  // namespace encore
