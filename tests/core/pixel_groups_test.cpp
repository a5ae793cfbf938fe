// Pixel groups against brute force and the walk of trees: the same id for every query, whatever the samples.
#include "core/reuse/pixel_groups.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "core/reuse/nearest_neighbour.h"
#include "core/reuse/sample_grid_refiner.h"
#include "core/reuse/trees.h"
#include "tests/core/twins/nearest_neighbour_twin.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"

namespace encore {
namespace {

class PixelGroupsTest : public testing::Test {
 protected:
  struct Index {
    SampleGrid grid;
    Trees trees;
  };

  Index built(const twin::Samples& samples) {
    const ShadingSamples uploaded = twin::uploadShading(*device_, samples);
    Index index;
    grid_builder_.build(uploaded, index.grid, PixelGroups::kSamplesPerCell);
    refiner_.refine(index.grid, PixelGroups::kSamplesPerCell, PixelGroups::kMaxCell);
    tree_builder_.build(uploaded, index.trees);
    return index;
  }

  // Against the walk of trees, and for every `stride`th query against brute force; stride 0: not.
  void expectExact(const Index& index, const twin::NearestNeighbour& expected, const twin::Samples& queries,
                   uint32_t samples_per_pixel, uint32_t stride) {
    SCOPED_TRACE(std::to_string(samples_per_pixel) + " samples per pixel");
    AaSamples aa = twin::uploadAa(*device_, queries, samples_per_pixel);
    const auto found = [&](auto& search, const auto& in) {
      std::fill(aa.shade.host().begin(), aa.shade.host().end(), 12345u);
      aa.shade.toDevice();
      Commands commands(*device_);
      search.record(commands, in, aa);
      commands.run();
      return twin::download(aa.shade);
    };
    const std::vector<uint32_t> ids = found(groups_, index.grid);
    const std::vector<uint32_t> walked = found(walk_, index.trees);
    for (size_t i = 0; i < queries.keys.size(); ++i) {
      const uint32_t by_force = stride != 0 && i % stride == 0 ? expected.find(queries.keys[i], queries.uv[i]) : ids[i];
      ASSERT_TRUE(ids[i] == by_force && ids[i] == walked[i])
          << i << ": found " << ids[i] << ", by force " << by_force << ", walked " << walked[i] << ": key "
          << queries.keys[i].instance << " " << queries.keys[i].primitive_side << ", (u, v) " << queries.uv[i].x << " "
          << queries.uv[i].y;
    }
  }

  // Coherent and scattered queries, `count` of each.
  void expectExact(const twin::Cloud& cloud, uint32_t count, uint32_t stride = 1) {
    const Index index = built(cloud.samples);
    const twin::NearestNeighbour expected(cloud.samples);
    for (const bool coherent : {true, false}) {
      SCOPED_TRACE(cloud.name + (coherent ? ", coherent" : ", scattered"));
      expectExact(index, expected, maker_.queries(cloud.samples, count, coherent), coherent ? 64 : 9, stride);
    }
  }

  // A screen of pixels over the whole of key {0, 0}'s square, with jittered samples: the queries of one primitive
  // that fills the image.
  twin::Samples pixels(uint32_t side, uint32_t across, const std::function<Vec2f(Vec2f)>& place) {
    twin::Samples queries;
    for (uint32_t pixel = 0; pixel < side * side; ++pixel) {
      for (uint32_t s = 0; s < across * across; ++s) {
        const float x = float(pixel % side) + (float(s % across) + maker_.unit()) / float(across);
        const float y = float(pixel / side) + (float(s / across) + maker_.unit()) / float(across);
        queries.add({0, 0}, place({x / float(side), y / float(side)}));
      }
    }
    return queries;
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  Scan scan_{*device_};
  RadixSort sort_{*device_, scan_};
  KeyTable table_{*device_};
  SampleGridBuilder grid_builder_{*device_, scan_, sort_, table_};
  SampleGridRefiner refiner_{*device_, scan_, sort_};
  TreeBuilder tree_builder_{*device_, scan_, sort_, table_};
  NearestNeighbour walk_{*device_};
  PixelGroups groups_{*device_};
  twin::CloudMaker maker_{29};
};

TEST_F(PixelGroupsTest, OnePrimitiveOfAnySize) {
  for (const uint32_t size : {0, 1, 2, 7, 15, 16, 17, 18, 33, 100, 1000, 4099}) {
    expectExact(maker_.onOnePrimitive(size), 2001, 3);
  }
}

TEST_F(PixelGroupsTest, AnyNumberOfSamplesPerPixel) {
  const twin::Cloud cloud = maker_.mixture(2000);
  const Index index = built(cloud.samples);
  const twin::NearestNeighbour expected(cloud.samples);
  for (const uint32_t per_pixel : {1,  2,  3,   4,   5,   7,   8,   9,   16,  25,  31,  32,   33,   63,
                                   64, 65, 121, 127, 128, 129, 169, 255, 256, 257, 529, 1024, 2025, 4096}) {
    const uint32_t pixels = std::max(1u, 2000 / per_pixel);
    for (const bool coherent : {true, false}) {
      expectExact(index, expected, maker_.queries(cloud.samples, pixels * per_pixel, coherent), per_pixel, 7);
    }
  }
}

TEST_F(PixelGroupsTest, NumbersOfQueriesAroundAWorkgroup) {
  const twin::Cloud cloud = maker_.mixture(100);
  const Index index = built(cloud.samples);
  const twin::NearestNeighbour expected(cloud.samples);
  for (const uint32_t count : {0, 1, 31, 32, 33, 63, 64, 65, 511, 512, 513}) {
    expectExact(index, expected, maker_.queries(cloud.samples, count, true), 1, 1);
  }
}

TEST_F(PixelGroupsTest, AMillionSamplesOnOnePrimitive) {
  expectExact(maker_.onOnePrimitive(1'000'000), 50'000, 10'007);
}

TEST_F(PixelGroupsTest, ManyPrimitives) { expectExact(maker_.onManyPrimitives(60'000), 100'000, 7); }

// A pixel's samples each on another primitive.
TEST_F(PixelGroupsTest, PixelsThatSeeHundredsOfPrimitives) {
  twin::Cloud cloud{"hundreds", {}};
  for (uint32_t i = 0; i < 40'000; ++i) cloud.samples.add({0, maker_.below(600)}, maker_.uv());
  const Index index = built(cloud.samples);
  twin::Samples queries;
  for (uint32_t i = 0; i < 100 * 529; ++i) queries.add({0, i * 7919 % 601}, maker_.uv());
  expectExact(index, twin::NearestNeighbour(cloud.samples), queries, 529, 11);
}

TEST_F(PixelGroupsTest, HardShapes) {
  for (const twin::Cloud& cloud : maker_.hardShapes(3000)) expectExact(cloud, 3000, 7);
}

// Where all samples tie, or all but tie, every query could have to look at all of them.
TEST_F(PixelGroupsTest, HardShapesOfManySamplesEnd) {
  for (const twin::Cloud& cloud : maker_.hardShapes(30'000)) expectExact(cloud, 1500, 211);
}

TEST_F(PixelGroupsTest, AMillionSamplesAtOnePoint) {
  expectExact(maker_.placed("a million at one point", 1'000'000, [](uint32_t) { return Vec2f{0.3f, 0.7f}; }), 30'000,
              10'007);
}

TEST_F(PixelGroupsTest, ExtremesAndMixture) {
  expectExact(maker_.extremes(20'000), 10'000, 3);
  expectExact(maker_.mixture(20'000), 10'000, 7);
}

// A ground plane seen up to the horizon: most samples lie in a millionth of the square.
TEST_F(PixelGroupsTest, HorizonOfHalfAMillionSamples) {
  const auto onGround = [](Vec2f screen) {
    const float depth = 1 / (1e-3f + screen.y);
    return Vec2f{0.5f + (screen.x - 0.5f) * depth * 1e-3f, depth * 1e-3f};
  };
  const twin::Cloud cloud = maker_.placed("horizon", 500'000, [&](uint32_t) { return onGround(maker_.uv()); });
  expectExact(built(cloud.samples), twin::NearestNeighbour(cloud.samples), pixels(64, 5, onGround), 25, 10'007);
}

// Distances from 1 down to the smallest numbers, so that every refinement meets the next crowd.
TEST_F(PixelGroupsTest, CrowdsWithinCrowds) {
  const auto crowd = [&](float decades) { return std::pow(10.0f, -decades * maker_.unit()); };
  expectExact(maker_.placed("30 decades in u", 20'000, [&](uint32_t) { return Vec2f{crowd(30), maker_.unit()}; }), 5000,
              101);
  expectExact(maker_.placed("30 decades in both", 20'000, [&](uint32_t) { return Vec2f{crowd(30), crowd(30)}; }), 1500,
              101);
  expectExact(maker_.placed("44 decades in both", 20'000, [&](uint32_t) { return Vec2f{crowd(44), crowd(44)}; }), 1500,
              101);
  expectExact(maker_.placed("crowds at many places", 60'000,
                            [&](uint32_t) {
                              const float at = float(maker_.below(5)) * 0.2f;
                              return Vec2f{at + 1e-3f * crowd(6), float(maker_.below(7)) * 0.1f + crowd(8) * 1e-2f};
                            }),
              1500, 101);
}

// All samples at the two ends of a strip; queries between them see only empty cells.
TEST_F(PixelGroupsTest, LongEmptyStrip) {
  const twin::Cloud cloud = maker_.placed("strip", 30'000, [&](uint32_t i) {
    return Vec2f{1e-4f * maker_.unit(), (i % 2 ? 0.9f : 0.0f) + 0.1f * maker_.unit()};
  });
  const Index index = built(cloud.samples);
  twin::Samples queries;
  for (uint32_t i = 0; i < 1000; ++i) queries.add({0, 0}, {1e-4f * maker_.unit(), maker_.unit()});
  expectExact(index, twin::NearestNeighbour(cloud.samples), queries, 16, 101);
}

// Cell centres of a regular grid are exactly as near to four samples; a group of equal queries has a box of no
// size, so that nothing but the comparisons decides.
TEST_F(PixelGroupsTest, GroupsOfEqualQueriesThatTie) {
  twin::Cloud cloud{"regular", {}};
  for (uint32_t i = 0; i < 64 * 64; ++i) {
    const uint32_t place = (i * i + i) / 2 % (64 * 64);  // a permutation: neighbours have unlike ids
    cloud.samples.add({4, 9}, {float(place % 64) / 64, float(place / 64) / 64});
  }
  twin::Samples queries;
  for (uint32_t cell = 0; cell < 63 * 63; ++cell) {
    const Vec2f centre{(float(cell % 63) + 0.5f) / 64, (float(cell / 63) + 0.5f) / 64};
    for (uint32_t i = 0; i < 32; ++i) queries.add({4, 9}, centre);
  }
  expectExact(built(cloud.samples), twin::NearestNeighbour(cloud.samples), queries, 32, 32);
}

TEST_F(PixelGroupsTest, PixelsOnOneBigPrimitive) {
  const auto skewed = [](Vec2f p) { return Vec2f{p.x * (0.3f + 0.7f * p.x), p.y * std::sqrt(p.y)}; };
  const twin::Cloud cloud = maker_.placed("skewed", 20'000, [&](uint32_t) { return skewed(maker_.uv()); });
  const Index index = built(cloud.samples);
  const twin::NearestNeighbour expected(cloud.samples);
  for (const uint32_t across : {1, 4, 11})
    expectExact(index, expected, pixels(100, across, skewed), across * across, 997);
}

// More than 65,535 workgroups, and arrays larger than 128 MiB.
TEST_F(PixelGroupsTest, SeventeenMillionQueries) {
  const twin::Cloud cloud = maker_.onManyPrimitives(30'000);
  const Index index = built(cloud.samples);
  const twin::Samples few = maker_.queries(cloud.samples, 100'000, true);
  twin::Samples queries;
  for (uint32_t i = 0; i < 170; ++i) {
    queries.keys.insert(queries.keys.end(), few.keys.begin(), few.keys.end());
    queries.uv.insert(queries.uv.end(), few.uv.begin(), few.uv.end());
  }
  AaSamples aa = twin::uploadAa(*device_, queries, 10);
  Commands commands(*device_);
  groups_.record(commands, index.grid, aa);
  commands.run();
  const std::vector<uint32_t> ids = twin::download(aa.shade);
  for (uint32_t i = 1; i < 170; ++i) {
    ASSERT_TRUE(std::equal(ids.begin(), ids.begin() + 100'000, ids.begin() + i * 100'000)) << i;
  }
  const twin::NearestNeighbour expected(cloud.samples);
  for (uint32_t i = 0; i < 100'000; i += 3) ASSERT_EQ(ids[i], expected.find(queries.keys[i], queries.uv[i])) << i;
}

TEST_F(PixelGroupsTest, WorksWithoutSharedMemory) {
  const auto device = Device::create({.validation = true, .staging = true});
  Scan scan(*device);
  RadixSort sort(*device, scan);
  KeyTable table(*device);
  SampleGridBuilder builder(*device, scan, sort, table);
  PixelGroups groups(*device);
  const twin::Cloud cloud = maker_.mixture(3000);
  SampleGrid grid;
  builder.build(twin::uploadShading(*device, cloud.samples), grid, PixelGroups::kSamplesPerCell);
  const twin::Samples queries = maker_.queries(cloud.samples, 3000, true);
  AaSamples aa = twin::uploadAa(*device, queries, 25);
  Commands commands(*device);
  groups.record(commands, grid, aa);
  commands.run();
  const std::vector<uint32_t> ids = twin::download(aa.shade);
  const twin::NearestNeighbour expected(cloud.samples);
  for (uint32_t i = 0; i < 3000; ++i) ASSERT_EQ(ids[i], expected.find(queries.keys[i], queries.uv[i])) << i;
}

// The bound must hold for one primitive per sample, for crowds, and for what needs no refinement.
TEST(PixelGroupsBytesTest, BoundsWhatAnIndexAllocates) {
  twin::CloudMaker maker(2);
  const uint32_t n = 65'537;
  const auto crowd = [&] { return std::pow(10.0f, -12 * maker.unit()); };
  twin::Samples alone;
  for (uint32_t i = 0; i < n; ++i) alone.add({0, i}, maker.uv());
  const std::vector<twin::Samples> cases = {
      alone, maker.onOnePrimitive(n).samples,
      maker.placed("crowds", n, [&](uint32_t) { return Vec2f{crowd(), crowd()}; }).samples,
      maker.placed("half a crowd", n, [&](uint32_t i) { return i % 2 ? maker.uv() : 0.001f * maker.uv(); }).samples};
  for (const twin::Samples& samples : cases) {
    const auto device = Device::create({.validation = true});
    const ShadingSamples uploaded = twin::uploadShading(*device, samples);
    Scan scan(*device);
    RadixSort sort(*device, scan);
    KeyTable table(*device);
    SampleGridBuilder builder(*device, scan, sort, table);
    SampleGridRefiner refiner(*device, scan, sort);
    sort.reserve(n);
    scan.reserve(2 * n);
    const uint64_t before = device->allocatedBytes();
    SampleGrid grid;
    builder.build(uploaded, grid, PixelGroups::kSamplesPerCell);
    refiner.refine(grid, PixelGroups::kSamplesPerCell, PixelGroups::kMaxCell);
    const uint64_t taken = device->peakAllocatedBytes() - before;
    EXPECT_LE(taken, PixelGroups::bytes(n)) << double(taken) / n << " bytes per sample";
    EXPECT_GE(8 * taken, PixelGroups::bytes(n)) << "a bound that loose is of no use for planning";
  }
}

}  // namespace
}  // namespace encore
