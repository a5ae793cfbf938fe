// Filter weights: their formulas, their reach, and the kernels' own.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "core/film/film.h"
#include "kernels/film/filter_values.h"

namespace encore {
namespace {

constexpr FilterKind kFilters[] = {FilterKind::Box, FilterKind::Gaussian, FilterKind::Mitchell,
                                   FilterKind::BlackmanHarris};

// Textbook formulas in double precision, x in pixels inside the radius.
double textbookWeight(FilterKind kind, double radius, double x) {
  const double t = std::abs(x) / radius, s = 2 * t, pi = 3.14159265358979323846;
  switch (kind) {
    case FilterKind::Box:
      return 1;
    case FilterKind::Gaussian:
      return std::exp(-4.5 * t * t) - std::exp(-4.5);
    case FilterKind::Mitchell:
      return s < 1 ? (7 * s * s * s - 12 * s * s + 16.0 / 3) / 6
                   : (-7.0 / 3 * s * s * s + 12 * s * s - 20 * s + 32.0 / 3) / 6;
    default:
      return 0.35875 + 0.48829 * std::cos(pi * t) + 0.14128 * std::cos(2 * pi * t) + 0.01168 * std::cos(3 * pi * t);
  }
}

TEST(Filter, FollowsItsFormulaInsideTheRadius) {
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.0f, 1.5f, 2.0f, 2.7f, 8.0f}) {
      for (int i = -999; i <= 999; ++i) {
        const float x = radius * float(i) / 1000;
        ASSERT_NEAR(filterWeight(kind, radius, x), textbookWeight(kind, double(radius), double(x)), 2e-6)
            << int(kind) << " " << radius << " " << x;
      }
    }
  }
}

TEST(Filter, IsZeroAtAndBeyondTheRadius) {
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.5f, 2.7f}) {
      for (const float beyond : {1.0f, 1.0001f, 2.0f, 100.0f}) {
        EXPECT_EQ(filterWeight(kind, radius, -radius * beyond), 0.0f);
        const bool half_open = kind == FilterKind::Box && beyond == 1.0f;
        EXPECT_EQ(filterWeight(kind, radius, radius * beyond), half_open ? 1.0f : 0.0f);
      }
    }
  }
}

TEST(Filter, PadCoversTheReachAndNoMore) {
  EXPECT_EQ(filterPad(0.25f), 0u);
  EXPECT_EQ(filterPad(0.5f), 0u);
  EXPECT_EQ(filterPad(0.51f), 1u);
  EXPECT_EQ(filterPad(1.5f), 1u);
  EXPECT_EQ(filterPad(2.0f), 2u);
  EXPECT_EQ(filterPad(2.7f), 3u);
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.0f, 1.5f, 2.0f, 2.7f}) {
      for (int i = 0; i < 4096; ++i) {  // the first pixels that pad leaves out, left and right
        const float beyond = float(filterPad(radius)) + 1, position = float(i) / 4096;
        ASSERT_EQ(filterWeight(kind, radius, beyond + 0.5f - position), 0.0f);
        ASSERT_EQ(filterWeight(kind, radius, -beyond + 0.5f - position), 0.0f);
      }
    }
  }
}

TEST(Filter, KernelsHaveTheSameWeightsToTheLastBit) {
  const auto device = Device::create({.validation = true});
  const uint32_t count = 20000;
  Buffer<float> distances(*device, count, "distances"), weights(*device, count, "weights");
  for (const FilterKind kind : kFilters) {
    for (const float radius : {0.5f, 1.5f, 2.7f}) {
      for (uint32_t i = 0; i < count; ++i) distances.host()[i] = radius * (float(i) / (count / 2) - 1) * 1.1f;
      distances.host()[0] = radius;
      distances.host()[1] = -radius;
      distances.toDevice();
      const Kernel kernel(
          *device, "filter_values", kFilterValuesSpirv,
          {{uint32_t(kind), std::bit_cast<uint32_t>(radius), std::bit_cast<uint32_t>(1 / radius), filterPad(radius)}});
      struct Arguments {
        uint64_t distances, weights;
        uint32_t count;
      };
      Commands commands(*device);
      commands.dispatch(kernel, groupsFor(count, 64), Arguments{distances.address(), weights.address(), count});
      commands.run();
      weights.toHost();
      for (uint32_t i = 0; i < count; ++i) {
        const float expected = filterWeight(kind, radius, distances.host()[i]);
        ASSERT_EQ(std::bit_cast<uint32_t>(weights.host()[i]), std::bit_cast<uint32_t>(expected))
            << int(kind) << " " << radius << " " << distances.host()[i] << " " << weights.host()[i] << " " << expected;
      }
    }
  }
}

}  // namespace
}  // namespace encore
