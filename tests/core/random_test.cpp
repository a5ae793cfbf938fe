// core/scene/random.h: stratification of the sequence, independence of seeds and uniformity of the hash.
#include "core/scene/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <set>
#include <vector>

namespace encore {
namespace {

constexpr uint32_t kSeeds[] = {0u, 1u, 2u, 12345u, 0x80000000u, 0xffffffffu};

// Chi-squared statistic of counts against the same expectation for each.
double chiSquared(const std::vector<uint32_t>& counts, double expected) {
  double sum = 0;
  for (uint32_t count : counts) sum += (count - expected) * (count - expected) / expected;
  return sum;
}

// True if the points first, …, first + 2^k - 1 lie one in each elementary interval of every shape of area 2^-k.
bool isNet(uint32_t first, uint32_t k, uint32_t seed) {
  for (uint32_t a = 0; a <= k; ++a) {
    const uint32_t columns = 1u << a, rows = 1u << (k - a);
    std::vector<uint32_t> counts(size_t{1} << k);
    for (uint32_t i = 0; i < 1u << k; ++i) {
      const Vec2f p = sobol2(first + i, seed);
      if (++counts[uint32_t(p.x * float(columns)) * rows + uint32_t(p.y * float(rows))] > 1) return false;
    }
  }
  return true;
}

TEST(Sobol2, EveryPowerOfTwoPrefixIsANet) {
  for (uint32_t seed : kSeeds)
    for (uint32_t k = 0; k <= 8; ++k) EXPECT_TRUE(isNet(0, k, seed)) << "seed " << seed << ", 2^" << k << " points";
  EXPECT_TRUE(isNet(0, 12, 7));
}

TEST(Sobol2, EveryAlignedBlockIsANet) {
  for (uint32_t seed : kSeeds)
    for (uint32_t k = 0; k <= 8; ++k)
      for (uint32_t block : {1u, 5u, 1000u}) EXPECT_TRUE(isNet(block << k, k, seed)) << seed << " " << k;
}

TEST(Sobol2, LiesInTheUnitSquare) {
  for (uint32_t seed = 0; seed < 64; ++seed)
    for (uint32_t i = 0; i < 4096; ++i) {
      const Vec2f p = sobol2(i * 104729u, seed);
      ASSERT_TRUE(p.x >= 0 && p.x < 1 && p.y >= 0 && p.y < 1) << i << " " << seed;
    }
}

TEST(Sobol2, UnscrambledMatrixIsPascalsTriangle) {
  // Column j of the second dimension's generator, top bit first, holds the binomials (j over i) mod 2 (Sobol' 1967).
  uint32_t column = 0x80000000u;
  for (uint32_t j = 0; j < 32; ++j, column ^= column >> 1)
    for (uint32_t i = 0; i <= 31; ++i) {
      const bool odd = (i & j) == i;  // Lucas' theorem
      ASSERT_EQ((column >> (31 - i)) & 1u, odd ? 1u : 0u) << i << " " << j;
    }
}

TEST(OwenScramble, IsAPermutationThatKeepsBinaryPrefixes) {
  for (uint32_t seed : kSeeds)
    for (uint32_t bits = 1; bits <= 10; ++bits) {
      std::set<uint32_t> prefixes;
      for (uint32_t i = 0; i < 1u << bits; ++i) {
        const uint32_t x = i << (32 - bits), rest = (1u << (32 - bits)) - 1;
        const uint32_t prefix = owenScramble(x, seed) >> (32 - bits);
        // What lies below a prefix does not change where the prefix goes.
        ASSERT_EQ(prefix, owenScramble(x | rest, seed) >> (32 - bits));
        prefixes.insert(prefix);
      }
      EXPECT_EQ(prefixes.size(), size_t{1} << bits);
    }
}

// Pairs the i-th points of two seeds and counts them in 4 × 4 cells. Where each run of four indices is an
// independent random permutation of the four strata, a cell's variance is 3/4 of its mean, and the statistic's
// mean is 12 (exact Owen scrambling simulated: 11.9, with 1 % above 38). Unshuffled it would be 3 × 256.
TEST(Sobol2, SeedsAreDecorrelated) {
  constexpr uint32_t kPairs = 400, kPoints = 256;
  double sum[4] = {};
  uint32_t far_out = 0;
  for (uint32_t pair = 0; pair < kPairs; ++pair) {
    std::vector<uint32_t> counts[4];
    for (auto& table : counts) table.assign(16, 0);
    for (uint32_t i = 0; i < kPoints; ++i) {
      const Vec2f a = sobol2(i, pair), b = sobol2(i, pair + 1);
      const uint32_t from[2] = {uint32_t(a.x * 4), uint32_t(a.y * 4)}, to[2] = {uint32_t(b.x * 4), uint32_t(b.y * 4)};
      for (uint32_t c = 0; c < 4; ++c) ++counts[c][from[c / 2] * 4 + to[c % 2]];
    }
    for (uint32_t c = 0; c < 4; ++c) {
      const double statistic = chiSquared(counts[c], kPoints / 16.0);
      sum[c] += statistic;
      far_out += statistic > 38;
    }
  }
  for (double total : sum) EXPECT_NEAR(total / kPairs, 12, 1);
  EXPECT_LT(far_out, 4 * kPairs * 3 / 100);
}

TEST(Sobol2, FixedIndexIsUniformOverSeeds) {
  for (uint32_t index : {0u, 1u, 37u}) {
    std::vector<uint32_t> x(64), y(64), both(64);
    for (uint32_t seed = 0; seed < 64 * 256; ++seed) {
      const Vec2f p = sobol2(index, seed);
      ++x[uint32_t(p.x * 64)], ++y[uint32_t(p.y * 64)];
      ++both[uint32_t(p.x * 8) * 8 + uint32_t(p.y * 8)];
    }
    // 63 degrees of freedom: mean 63, deviation 11.
    EXPECT_LT(chiSquared(x, 256), 63 + 6 * 11) << index;
    EXPECT_LT(chiSquared(y, 256), 63 + 6 * 11) << index;
    EXPECT_LT(chiSquared(both, 256), 63 + 6 * 11) << index;
  }
}

TEST(Sobol2, IntegratesBetterThanChance) {
  // A smooth integrand: the error of scrambled nets falls as n^-3/2, that of random points as n^-1/2.
  double squared = 0;
  constexpr uint32_t kPoints = 256, kRuns = 64;
  for (uint32_t seed = 0; seed < kRuns; ++seed) {
    double mean = 0;
    for (uint32_t i = 0; i < kPoints; ++i) {
      const Vec2f p = sobol2(i, seed);
      mean += std::sin(kPi * p.x) * std::exp(p.y) / kPoints;
    }
    const double exact = 2 / double(kPi) * (std::exp(1.0) - 1);
    squared += (mean - exact) * (mean - exact) / kRuns;
  }
  EXPECT_LT(std::sqrt(squared), 0.1 * 0.63 / std::sqrt(double(kPoints)));  // 0.63: the integrand's deviation
}

TEST(Pcg4d, EveryLaneIsUniformOnCounters) {
  for (uint32_t lane = 0; lane < 4; ++lane) {
    std::vector<uint32_t> counts(256);
    for (uint32_t x = 0; x < 32; ++x)
      for (uint32_t y = 0; y < 32; ++y)
        for (uint32_t z = 0; z < 64; ++z) ++counts[uint32_t(toUnit(pcg4d(x, y, z, 3)[lane]) * 256)];
    EXPECT_LT(chiSquared(counts, 256), 255 + 6 * 22.6) << lane;  // 255 degrees of freedom
    EXPECT_GT(chiSquared(counts, 256), 255 - 6 * 22.6) << lane;
  }
}

TEST(Pcg4d, NeighbouringCountersAreUncorrelated) {
  constexpr uint32_t kCount = 16384;
  for (uint32_t argument = 0; argument < 4; ++argument)
    for (uint32_t lane = 0; lane < 4; ++lane) {
      double sum = 0;
      for (uint32_t i = 0; i < kCount; ++i) {
        uint32_t a[4] = {i, i >> 3, 5, 9}, b[4] = {i, i >> 3, 5, 9};
        b[argument] += 1;
        sum +=
            (toUnit(pcg4d(a[0], a[1], a[2], a[3])[lane]) - 0.5) * (toUnit(pcg4d(b[0], b[1], b[2], b[3])[lane]) - 0.5);
      }
      EXPECT_LT(std::abs(sum * 12 / kCount), 6 / std::sqrt(double(kCount))) << argument << " " << lane;
    }
}

TEST(ToUnit, StaysBelowOne) {
  EXPECT_EQ(toUnit(0), 0.0f);
  EXPECT_LT(toUnit(0xffffffffu), 1.0f);
  EXPECT_EQ(toUnit(0x80000000u), 0.5f);
}

}  // namespace
}  // namespace encore
