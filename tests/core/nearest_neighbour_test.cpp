// Nearest neighbours against brute force: the same id for every query, whatever the samples.
#include "core/reuse/nearest_neighbour.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "core/reuse/trees.h"
#include "core/scene/error.h"
#include "tests/core/twins/nearest_neighbour_twin.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"

namespace encore {
namespace {

class NearestNeighbourTest : public testing::Test {
 protected:
  std::vector<uint32_t> found(NearestNeighbour& search, const Trees& trees, const twin::Samples& queries) {
    AaSamples aa = twin::uploadAa(*device_, queries);
    Commands commands(*device_);
    search.record(commands, trees, aa);
    commands.run();
    return twin::download(aa.shade);
  }

  // Coherent and scattered queries, `count` of each, by both walks; brute force for every `stride`th.
  void expectExact(const twin::Cloud& cloud, uint32_t count, uint32_t stride = 1) {
    const Trees trees = kernels_.build(twin::uploadShading(*device_, cloud.samples), footprint_weight_);
    const twin::NearestNeighbour expected(cloud.samples, footprint_weight_);
    for (const bool coherent : {true, false}) {
      SCOPED_TRACE(cloud.name + (coherent ? ", coherent" : ", scattered"));
      twin::Samples queries = maker_.queries(cloud.samples, count, coherent);
      maker_.giveFootprints(queries, footprints_);
      expectExact(trees, expected, queries, stride);
    }
  }

  void expectExact(const Trees& trees, const twin::NearestNeighbour& expected, const twin::Samples& queries,
                   uint32_t stride) {
    const std::vector<uint32_t> ids = found(grouped_, trees, queries);
    EXPECT_TRUE(found(single_, trees, queries) == ids);
    for (size_t i = 0; i < queries.keys.size(); i += stride) {
      ASSERT_EQ(ids[i], expected.find(queries.keys[i], queries.uv[i], queries.footprints[i]))
          << i << ": key " << queries.keys[i].instance << " " << queries.keys[i].primitive_side << ", (u, v) "
          << queries.uv[i].x << " " << queries.uv[i].y << ", footprint " << queries.footprints[i];
    }
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  twin::TreeKernels kernels_{*device_};
  NearestNeighbour grouped_{*device_, NearestNeighbour::Walk::kGrouped};
  NearestNeighbour single_{*device_, NearestNeighbour::Walk::kSingle};
  twin::CloudMaker maker_{17};
  float footprint_weight_ = 0;
  twin::Footprints footprints_ = twin::Footprints::kEqual;
};

// Time and direction as parts of the distance (§5), with and without the metric, and what is no number among them.
TEST_F(NearestNeighbourTest, FurtherCoordinates) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(-1, 1);
  const auto aspects = [&](size_t count, float scale) {
    std::vector<Vec4f> values(count);
    for (Vec4f& a : values)
      a = {scale * unit(random), scale * unit(random), scale * unit(random), scale * unit(random)};
    if (count > 40) {
      values[3].x = std::numeric_limits<float>::quiet_NaN();
      values[11].w = std::numeric_limits<float>::infinity();
    }
    return values;
  };
  for (const float weight : {0.0f, 0.5f})
    for (const float scale : {0.0f, 0.01f, 1.0f, 1e6f}) {
      twin::Cloud cloud = maker_.onOnePrimitive(700);
      cloud.samples.aspects = aspects(cloud.samples.keys.size(), scale);
      maker_.giveFootprints(cloud.samples, twin::Footprints::kEqual);
      const ShadingSamples shading = twin::uploadShading(*device_, cloud.samples);  // stays: trees refer to it
      const Trees trees = kernels_.build(shading, weight);
      const twin::NearestNeighbour expected(cloud.samples, weight);
      twin::Samples queries = maker_.queries(cloud.samples, 2001, true);
      maker_.giveFootprints(queries, twin::Footprints::kEqual);
      queries.aspects = aspects(queries.keys.size(), scale);
      for (NearestNeighbour* search : {&grouped_, &single_}) {
        const std::vector<uint32_t> ids = found(*search, trees, queries);
        for (size_t i = 0; i < queries.keys.size(); ++i)
          ASSERT_EQ(ids[i], expected.find(queries.keys[i], queries.uv[i], queries.footprints[i], queries.aspects[i]))
              << i << ", weight " << weight << ", scale " << scale;
      }
      AaSamples without = twin::uploadAa(*device_, queries);
      without.aspect = {};
      Commands commands(*device_);
      EXPECT_THROW(single_.record(commands, trees, without), Error);
    }
}

TEST_F(NearestNeighbourTest, OnePrimitiveOfAnySize) {
  for (const uint32_t size : {0, 1, 2, 7, 8, 9, 16, 17, 100, 1000, 4099}) {
    expectExact(maker_.onOnePrimitive(size), 3001);
  }
}

TEST_F(NearestNeighbourTest, AMillionSamplesOnOnePrimitive) {
  expectExact(maker_.onOnePrimitive(1'000'000), 200'000, 1009);
}

TEST_F(NearestNeighbourTest, ManyPrimitives) { expectExact(maker_.onManyPrimitives(100'000), 300'000); }

TEST_F(NearestNeighbourTest, HardShapes) {
  for (const twin::Cloud& cloud : maker_.hardShapes(3000)) expectExact(cloud, 5000);
}

// Where all samples tie, or all but tie, every query could have to look at all of them.
TEST_F(NearestNeighbourTest, HardShapesOfManySamplesEnd) {
  for (const twin::Cloud& cloud : maker_.hardShapes(100'000)) expectExact(cloud, 2000, 101);
}

TEST_F(NearestNeighbourTest, AMillionSamplesAtOnePoint) {
  expectExact(maker_.placed("a million at one point", 1'000'000, [](uint32_t) { return Vec2f{0.3f, 0.7f}; }), 100'000,
              1009);
}

TEST_F(NearestNeighbourTest, ExtremesAndMixture) {
  expectExact(maker_.extremes(20'000), 20'000);
  expectExact(maker_.mixture(20'000), 20'000, 7);
}

// Cell centres of a grid are exactly as near to four samples, which can be in different leaves; a group of equal
// queries has a box of no size, so that nothing but the comparisons decides.
TEST_F(NearestNeighbourTest, GroupsOfEqualQueriesThatTie) {
  twin::Cloud cloud{"grid", {}};
  for (uint32_t i = 0; i < 64 * 64; ++i) {
    const uint32_t place = (i * i + i) / 2 % (64 * 64);  // a permutation: neighbours have unlike ids
    cloud.samples.add({4, 9}, {float(place % 64) / 64, float(place / 64) / 64});
  }
  twin::Samples queries;
  for (uint32_t cell = 0; cell < 63 * 63; ++cell) {
    const Vec2f centre{(float(cell % 63) + 0.5f) / 64, (float(cell / 63) + 0.5f) / 64};
    for (uint32_t i = 0; i < 32; ++i) queries.add({4, 9}, centre);
  }
  const Trees trees = kernels_.build(twin::uploadShading(*device_, cloud.samples));
  expectExact(trees, twin::NearestNeighbour(cloud.samples), queries, 32);
}

TEST_F(NearestNeighbourTest, NumbersOfQueriesAroundAWorkgroup) {
  const twin::Cloud cloud = maker_.mixture(100);
  for (const uint32_t count : {0, 1, 31, 32, 33, 63, 64, 65, 255, 256, 257}) expectExact(cloud, count);
}

// More than 65,535 workgroups of 64.
TEST_F(NearestNeighbourTest, FourMillionQueriesTwice) {
  const twin::Cloud cloud = maker_.onManyPrimitives(3000);
  const Trees trees = kernels_.build(twin::uploadShading(*device_, cloud.samples));
  const twin::Samples queries = maker_.queries(cloud.samples, 4'300'000, true);
  AaSamples aa = twin::uploadAa(*device_, queries);
  const auto find = [&] {
    Commands commands(*device_);
    grouped_.record(commands, trees, aa);
    commands.run();
  };
  find();
  const std::vector<uint32_t> first = twin::download(aa.shade);
  find();
  EXPECT_TRUE(twin::download(aa.shade) == first);
  const twin::NearestNeighbour expected(cloud.samples);
  for (size_t i = 0; i < queries.keys.size(); i += 101) {
    ASSERT_EQ(first[i], expected.find(queries.keys[i], queries.uv[i])) << i;
  }
}

// The same in the metric of §2.4: one cloud per way of giving footprints.
class MetricTest : public NearestNeighbourTest, public testing::WithParamInterface<twin::Footprints> {
 protected:
  void expectExactInMetric(twin::Cloud cloud, uint32_t count, float weight = 1, uint32_t stride = 1) {
    footprints_ = GetParam();
    footprint_weight_ = weight;
    maker_.giveFootprints(cloud.samples, footprints_);
    expectExact(cloud, count, stride);
  }
};
INSTANTIATE_TEST_SUITE_P(Footprints, MetricTest, testing::ValuesIn(twin::kAllFootprints));

TEST_P(MetricTest, OnePrimitiveOfAnySize) {
  for (const uint32_t size : {0, 1, 2, 9, 17, 2000}) expectExactInMetric(maker_.onOnePrimitive(size), 1001);
}

TEST_P(MetricTest, AnyWeight) {
  for (const float weight : {1e-30f, 1e-3f, 1e6f}) {
    SCOPED_TRACE(weight);
    expectExactInMetric(maker_.onOnePrimitive(1000), 1000, weight);
  }
}

TEST_P(MetricTest, ManySamplesOnOnePrimitive) { expectExactInMetric(maker_.onOnePrimitive(30'000), 2000, 1, 31); }

TEST_P(MetricTest, ManyPrimitivesAndExtremes) {
  expectExactInMetric(maker_.onManyPrimitives(3000), 10'000);
  expectExactInMetric(maker_.extremes(5000), 5000);
  expectExactInMetric(maker_.mixture(3000), 10'000, 1, 3);
}

TEST_P(MetricTest, HardShapes) {
  for (const twin::Cloud& cloud : maker_.hardShapes(500)) expectExactInMetric(cloud, 500);
}

TEST_F(NearestNeighbourTest, MetricNeedsFootprints) {
  const twin::Samples samples = maker_.onOnePrimitive(10).samples;
  const Trees trees = kernels_.build(twin::uploadShading(*device_, samples), 1);
  AaSamples aa = twin::uploadAa(*device_, samples);
  aa.footprint = {};
  Commands commands(*device_);
  EXPECT_THROW(grouped_.record(commands, trees, aa), Error);
}

// What the metric is made of is what it says it is.
TEST(FootprintTwin, IsTheFormulaOfThePaper) {
  for (float r = 0x1p-60f; r <= 0x1p60f; r *= 1.0037f) {
    EXPECT_NEAR(twin::portableLog2(r), std::log2(double(r)), 6e-7 + std::abs(std::log2(double(r))) * 6e-8) << r;
    const double other = 3 * double(r), log_ratio = std::log2(3.0);
    if (r > 1e13f) continue;  // the part is limited
    EXPECT_NEAR(twin::footprintPart(r, float(other), 2) / (2 * log_ratio * log_ratio * (10 * double(r) * r)), 1, 2e-5);
  }
  EXPECT_EQ(twin::footprintPart(0, std::numeric_limits<float>::infinity(), 1e6f), 0x1p100f);
}

}  // namespace
}  // namespace encore
