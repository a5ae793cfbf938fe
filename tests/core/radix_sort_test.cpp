// Stable radix sort against its twin: sizes, distributions, bit ranges, keys of two words.
#include "core/reuse/radix_sort.h"

#include <gtest/gtest.h>

#include <array>
#include <functional>
#include <random>

#include "core/scene/error.h"
#include "tests/core/twins/radix_sort_twin.h"
#include "tests/core/twins/reuse_buffers.h"

namespace encore {
namespace {

constexpr BitRange kAllBits{0, 32};

class RadixSortTest : public testing::Test {
 protected:
  std::vector<uint32_t> valuesOf(uint32_t count) {
    Buffer<uint32_t> result(*device_, count, "result");
    Commands commands(*device_);
    sort_.recordCopy(commands, count, result.address());
    commands.run();
    return twin::download(result);
  }

  // 0, 1, 2, … sorted by one word.
  std::vector<uint32_t> sorted(const std::vector<uint32_t>& words, BitRange bits) {
    const uint32_t count = uint32_t(words.size());
    const Buffer<uint32_t> buffer = twin::upload(*device_, words);
    sort_.reserve(count);
    Commands commands(*device_);
    sort_.recordStart(commands, count);
    sort_.recordBy(commands, count, {buffer.address(), 1, 0}, bits);
    commands.run();
    return valuesOf(count);
  }

  void expectSorted(const std::vector<uint32_t>& words, BitRange bits, const std::string& what) {
    std::vector<uint32_t> expected(words.size());
    for (uint32_t i = 0; i < expected.size(); ++i) expected[i] = i;
    twin::sortBy(expected, words, 1, 0, bits);
    EXPECT_TRUE(sorted(words, bits) == expected) << what;
  }

  std::vector<uint32_t> words(size_t count, const std::function<uint32_t(size_t)>& f) {
    std::vector<uint32_t> made(count);
    for (size_t i = 0; i < count; ++i) made[i] = f(i);
    return made;
  }

  uint32_t random() { return uint32_t(random_()); }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  Scan scan_{*device_};
  RadixSort sort_{*device_, scan_};
  std::mt19937 random_{11};
};

TEST_F(RadixSortTest, AgreesWithTwinAtAllSizes) {
  for (const size_t size : {0, 1, 2, 7, 64, 2055, 2056, 2057, 65'536, 300'000}) {
    expectSorted(words(size, [&](size_t) { return random(); }), kAllBits, std::to_string(size));
  }
}

TEST_F(RadixSortTest, AgreesWithTwinOnHardKeys) {
  constexpr size_t kCount = 50'000;
  expectSorted(words(kCount, [](size_t) { return 0xdeadbeefu; }), kAllBits, "all equal");
  expectSorted(words(kCount, [](size_t i) { return uint32_t(i); }), kAllBits, "sorted");
  expectSorted(words(kCount, [](size_t i) { return ~uint32_t(i); }), kAllBits, "reversed");
  expectSorted(words(kCount, [](size_t i) { return i % 2 ? 0xffffffffu : 0u; }), kAllBits, "two keys");
  expectSorted(words(kCount, [](size_t i) { return uint32_t(i / 1000); }), kAllBits, "runs");
  expectSorted(words(kCount, [&](size_t) { return 1u << (random() % 32); }), kAllBits, "single bits");
}

TEST_F(RadixSortTest, SortsOnlyByTheBitsAskedFor) {
  const std::vector<uint32_t> random_words = words(20'000, [&](size_t) { return random(); });
  for (const BitRange bits : {BitRange{0, 0}, {0, 1}, {31, 1}, {5, 9}, {3, 10}, {17, 15}, {0, 19}, {4, 28}}) {
    expectSorted(random_words, bits, std::to_string(bits.first) + " + " + std::to_string(bits.count));
  }
}

TEST_F(RadixSortTest, SortsKeysOfTwoWordsFromAGivenOrder) {
  constexpr uint32_t kCount = 100'000;
  const std::vector<uint32_t> keys = words(2 * kCount, [&](size_t i) { return i % 2 ? random() : random() % 5; });
  std::vector<uint32_t> order(kCount);
  for (uint32_t i = 0; i < kCount; ++i) order[i] = kCount - 1 - i;
  const Buffer<uint32_t> device_keys = twin::upload(*device_, keys), device_order = twin::upload(*device_, order);
  sort_.reserve(kCount);
  Commands commands(*device_);
  sort_.recordStart(commands, kCount, device_order.address());
  sort_.recordBy(commands, kCount, {device_keys.address(), 2, 1}, kAllBits);
  sort_.recordBy(commands, kCount, {device_keys.address(), 2, 0}, {0, 3});
  commands.run();
  twin::sortBy(order, keys, 2, 1, kAllBits);
  twin::sortBy(order, keys, 2, 0, {0, 3});
  EXPECT_TRUE(valuesOf(kCount) == order);
}

TEST_F(RadixSortTest, FindsVaryingBits) {
  for (const uint32_t mask : {0u, 1u, 0x80000000u, 0x00ffff00u, 0xffffffffu}) {
    std::vector<uint32_t> keys = words(2 * 5000, [](size_t i) { return i % 2 ? 0x12345678u : 0xfedcba98u; });
    for (size_t i = 2000; i < 3000; ++i) keys[i] ^= random() & mask;
    const Buffer<uint32_t> buffer = twin::upload(*device_, keys);
    Commands commands(*device_);
    sort_.recordVaryingBits(commands, buffer.address(), 5000, 0);
    sort_.recordVaryingBits(commands, buffer.address(), 1, 1);
    commands.run();
    EXPECT_EQ(sort_.varyingBits(0)[0], twin::varyingBits(keys, 0)) << mask;
    EXPECT_EQ(sort_.varyingBits(0)[1], twin::varyingBits(keys, 1)) << mask;
    EXPECT_EQ(sort_.varyingBits(1)[0], 0u) << mask;
    EXPECT_EQ(sort_.varyingBits(1)[1], 0u) << mask;
  }
}

TEST(BitRangeTest, SpansTheBitsThatAreSet) {
  for (const auto& [mask, first, count] : {std::array{0u, 0u, 0u},
                                           {1u, 0u, 1u},
                                           {0x80000000u, 31u, 1u},
                                           {0xffffffffu, 0u, 32u},
                                           {0x00100800u, 11u, 10u}}) {
    EXPECT_EQ(bitRangeOf(mask).first, first) << mask;
    EXPECT_EQ(bitRangeOf(mask).count, count) << mask;
  }
}

// Beyond 128 MiB and 65,535 workgroups. Equal keys must keep their order, so there is one right answer.
TEST_F(RadixSortTest, SortsManyKeys) {
  constexpr uint32_t kCount = 36'000'000;
  const std::vector<uint32_t> keys = words(kCount, [](size_t i) { return uint32_t(i * 2654435761u) >> 14; });
  const std::vector<uint32_t> result = sorted(keys, {0, 18});
  ASSERT_EQ(result.size(), kCount);
  size_t errors = 0;
  for (size_t i = 1; i < result.size(); ++i) {
    const uint32_t a = result[i - 1], b = result[i];
    errors += a >= kCount || b >= kCount || keys[a] > keys[b] || (keys[a] == keys[b] && a >= b);
  }
  EXPECT_EQ(errors, 0u);  // strictly ascending by (key, value): so no value occurs twice
}

TEST_F(RadixSortTest, RefusesMoreThanItCanNumber) { EXPECT_THROW(sort_.reserve(kMaxSortValues + 1), Error); }

}  // namespace
}  // namespace encore
