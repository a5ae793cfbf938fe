// Grids of shading samples: what sample_grid.h promises, checked sample by sample, and the memory they take.
#include "core/reuse/sample_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "tests/core/twins/key_table_twin.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"

namespace encore {
namespace {

bool sameBits(Vec2f a, Vec2f b) {
  return std::bit_cast<std::array<uint32_t, 2>>(a) == std::bit_cast<std::array<uint32_t, 2>>(b);
}

float normalInUnitInterval(float x) { return std::fpclassify(x) == FP_SUBNORMAL ? 0.0f : twin::inUnitInterval(x); }
Vec2f place(Vec2f uv) { return {normalInUnitInterval(uv.x), normalInUnitInterval(uv.y)}; }

uint32_t columnOf(float x, float low, float cells_per_unit, uint32_t columns) {
  const float offset = x - low;
  const float column = offset * cells_per_unit;
  return std::min(uint32_t(column), columns - 1);
}

struct Kernels {
  explicit Kernels(Device& device)
      : scan(device), sort(device, scan), table(device), builder(device, scan, sort, table) {}
  Scan scan;
  RadixSort sort;
  KeyTable table;
  SampleGridBuilder builder;
};

// The arrays of a SampleGrid on the host.
struct HostGrid {
  std::vector<GridPrimitive> primitives;
  std::vector<uint32_t> cell_starts, ids, table;
  std::vector<Vec2f> points;

  explicit HostGrid(SampleGrid& grid)
      : primitives(twin::download(grid.primitives)),
        cell_starts(twin::download(grid.cell_starts)),
        ids(twin::download(grid.ids)),
        table(twin::download(grid.table)),
        points(twin::download(grid.points)) {}
};

class SampleGridTest : public testing::Test {
 protected:
  HostGrid built(const twin::Samples& samples, float samples_per_cell) {
    SampleGrid grid;
    kernels_.builder.build(twin::uploadShading(*device_, samples), grid, samples_per_cell);
    HostGrid host(grid);
    EXPECT_EQ(grid.sample_count, samples.keys.size());
    EXPECT_EQ(grid.primitive_count, host.primitives.size());
    EXPECT_EQ(grid.cell_count + 1, std::max<size_t>(host.cell_starts.size(), 1));
    return host;
  }

  // Bounds, number and proportions of a primitive's cells. ids: of its samples, ascending.
  static void expectShape(const GridPrimitive& p, const twin::Samples& samples, const std::vector<uint32_t>& ids,
                          float samples_per_cell) {
    Vec2f low{1, 1}, high{0, 0};
    for (const uint32_t id : ids) {
      const Vec2f at = place(samples.uv[id]);
      low = {std::min(low.x, at.x), std::min(low.y, at.y)};
      high = {std::max(high.x, at.x), std::max(high.y, at.y)};
    }
    ASSERT_TRUE(sameBits(p.low, low));
    ASSERT_GE(p.columns, 1u);
    ASSERT_GE(p.rows, 1u);
    const double wanted = std::max(1.0, double(p.count) / double(samples_per_cell));
    const double cells = double(p.columns) * double(p.rows);
    ASSERT_LE(cells, wanted * 1.000001);
    ASSERT_TRUE(p.columns == 1 || high.x > low.x);
    ASSERT_TRUE(p.rows == 1 || high.y > low.y);
    ASSERT_EQ(p.cells_per_unit.x == 0, p.columns == 1);
    ASSERT_EQ(p.cells_per_unit.y == 0, p.rows == 1);
    ASSERT_TRUE(cells >= std::floor(0.4 * wanted) || (high.x == low.x && high.y == low.y));
    if (p.columns > 1 && p.rows > 1) {
      const double width = double(high.x - low.x) / p.columns, height = double(high.y - low.y) / p.rows;
      ASSERT_LE(width, 3 * height);
      ASSERT_LE(height, 3 * width);
      ASSERT_NEAR(width * double(p.cells_per_unit.x), 1, 1e-5);
      ASSERT_NEAR(height * double(p.cells_per_unit.y), 1, 1e-5);
    }
  }

  // The samples of a primitive stand in order of (cell, id), and nothing is missing.
  static void expectSamples(const HostGrid& grid, const GridPrimitive& p, const twin::Samples& samples,
                            std::vector<uint32_t> ids) {
    const auto cellOf = [&](uint32_t id) {
      const Vec2f at = place(samples.uv[id]);
      return p.first_cell + columnOf(at.y, p.low.y, p.cells_per_unit.y, p.rows) * p.columns +
             columnOf(at.x, p.low.x, p.cells_per_unit.x, p.columns);
    };
    std::stable_sort(ids.begin(), ids.end(), [&](uint32_t a, uint32_t b) { return cellOf(a) < cellOf(b); });
    uint32_t cell = p.first_cell;
    ASSERT_EQ(grid.cell_starts[cell], p.first);
    for (uint32_t i = 0; i < p.count; ++i) {
      const uint32_t at = p.first + i;
      ASSERT_EQ(grid.ids[at], ids[i]) << i;
      ASSERT_TRUE(sameBits(grid.points[at], place(samples.uv[ids[i]]))) << i;
      for (; cell < cellOf(ids[i]); ++cell) ASSERT_EQ(grid.cell_starts[cell + 1], at);
    }
    for (; cell < p.first_cell + p.columns * p.rows; ++cell) ASSERT_EQ(grid.cell_starts[cell + 1], p.first + p.count);
  }

  void expectRight(const twin::Cloud& cloud, float samples_per_cell) {
    SCOPED_TRACE(cloud.name + ", " + std::to_string(samples_per_cell) + " per cell");
    const HostGrid grid = built(cloud.samples, samples_per_cell);
    std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> expected;
    for (uint32_t id = 0; id < cloud.samples.keys.size(); ++id) {
      expected[twin::pairOf(cloud.samples.keys[id])].push_back(id);
    }
    ASSERT_EQ(grid.primitives.size(), expected.size());
    uint32_t number = 0, first = 0, first_cell = 0;
    for (const auto& [key, ids] : expected) {
      const GridPrimitive& p = grid.primitives[number];
      ASSERT_EQ(twin::pairOf(p.key), key);
      ASSERT_EQ(p.first, first);
      ASSERT_EQ(p.count, ids.size());
      ASSERT_EQ(p.first_cell, first_cell);
      expectShape(p, cloud.samples, ids, samples_per_cell);
      if (HasFatalFailure()) return;
      expectSamples(grid, p, cloud.samples, ids);
      if (HasFatalFailure()) return;
      first += p.count;
      first_cell += p.columns * p.rows;
      ++number;
    }
    expectTable(grid);
  }

  // Every primitive stands once in the table, between its key's first slot and the next empty one.
  static void expectTable(const HostGrid& grid) {
    std::vector<uint32_t> times(grid.primitives.size());
    for (const uint32_t primitive : grid.table) {
      if (primitive != kNoPrimitive) ++times.at(primitive);
    }
    EXPECT_TRUE(std::all_of(times.begin(), times.end(), [](uint32_t n) { return n == 1; }));
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  Kernels kernels_{*device_};
  twin::CloudMaker maker_{5};
};

TEST_F(SampleGridTest, OnePrimitiveOfAnySize) {
  for (const uint32_t size : {0, 1, 2, 3, 7, 8, 9, 63, 64, 65, 71, 72, 73, 1000, 4097}) {
    for (const float per_cell : {0.5f, 1.0f, 1.5f, 16.0f}) expectRight(maker_.onOnePrimitive(size), per_cell);
  }
}

TEST_F(SampleGridTest, AMillionSamplesOnOnePrimitive) { expectRight(maker_.onOnePrimitive(1'000'000), 2); }

TEST_F(SampleGridTest, CrowdsAtOnePointAndOnALine) {
  expectRight(maker_.placed("many at one point", 300'000, [](uint32_t) { return Vec2f{0.3f, 0.7f}; }), 2);
  expectRight(maker_.placed("many on a line", 300'000, [&](uint32_t) { return Vec2f{0.3f, maker_.unit()}; }), 2);
}

TEST_F(SampleGridTest, ManyPrimitives) { expectRight(maker_.onManyPrimitives(100'000), 2); }

TEST_F(SampleGridTest, OneSampleOnEachOfManyPrimitives) {
  twin::Cloud cloud{"one sample each", {}};
  for (uint32_t i = 0; i < 200'000; ++i) cloud.samples.add({i * 7919 % 5, i * 2654435761u}, maker_.uv());
  expectRight(cloud, 1);
}

TEST_F(SampleGridTest, HardShapes) {
  for (const float per_cell : {1.0f, 16.0f}) {
    for (const twin::Cloud& cloud : maker_.hardShapes(5000)) expectRight(cloud, per_cell);
  }
}

// Coordinates that all but vanish, and extents whose product or quotient is beyond what floats can hold.
TEST_F(SampleGridTest, SmallestExtents) {
  const auto power = [&](float exponent) { return std::pow(10.0f, exponent * maker_.unit()); };
  expectRight(
      maker_.placed("down to the smallest numbers", 5000, [&](uint32_t) { return Vec2f{power(-44), power(-38)}; }), 2);
  expectRight(maker_.placed("1 by 1e-29", 5000, [&](uint32_t) { return Vec2f{maker_.unit(), 1e-29f * maker_.unit()}; }),
              2);
  expectRight(maker_.placed("1e-20 by 1e-25", 5000,
                            [&](uint32_t) { return Vec2f{1e-20f * maker_.unit(), 1e-25f * maker_.unit()}; }),
              2);
}

TEST_F(SampleGridTest, ExtremesAndMixture) {
  for (const float per_cell : {1.0f, 16.0f}) {
    expectRight(maker_.extremes(20'000), per_cell);
    expectRight(maker_.mixture(20'000), per_cell);
  }
}

TEST_F(SampleGridTest, TwoBuildsAreBitIdentical) {
  const twin::Cloud cloud = maker_.mixture(50'000);
  const HostGrid a = built(cloud.samples, 2);
  built(maker_.onManyPrimitives(3000).samples, 16);  // leaves other contents in the scratch memory
  const HostGrid b = built(cloud.samples, 2);
  EXPECT_EQ(a.ids, b.ids);
  EXPECT_EQ(a.cell_starts, b.cell_starts);
  EXPECT_TRUE(std::equal(a.points.begin(), a.points.end(), b.points.begin(), b.points.end(), sameBits));
  ASSERT_EQ(a.primitives.size(), b.primitives.size());
  EXPECT_EQ(std::memcmp(a.primitives.data(), b.primitives.data(), a.primitives.size() * sizeof(GridPrimitive)), 0);
}

TEST_F(SampleGridTest, WorksWithoutSharedMemory) {
  const auto device = Device::create({.validation = true, .staging = true});
  Kernels kernels(*device);
  const twin::Cloud cloud = maker_.mixture(5000);
  SampleGrid grid;
  kernels.builder.build(twin::uploadShading(*device, cloud.samples), grid, 2);
  EXPECT_EQ(HostGrid(grid).ids, built(cloud.samples, 2).ids);
}

// The bound must hold for one primitive per sample, for one in all, and between.
TEST(SampleGridBytesTest, BoundsWhatABuildAllocates) {
  twin::CloudMaker maker(2);
  for (const uint32_t primitives : {1u, 1000u, 7000u, 65'537u}) {
    const auto device = Device::create({.validation = true});
    twin::Samples samples;
    for (uint32_t i = 0; i < 65'537; ++i) samples.add({0, i % primitives}, maker.uv());
    const ShadingSamples uploaded = twin::uploadShading(*device, samples);
    Kernels kernels(*device);
    const uint64_t n = samples.keys.size();
    kernels.sort.reserve(uint32_t(n));
    kernels.scan.reserve(uint32_t(n) + 1);
    const uint64_t before = device->allocatedBytes();
    SampleGrid grid;
    kernels.builder.build(uploaded, grid, 2);
    const uint64_t taken = device->peakAllocatedBytes() - before;
    const uint64_t bound = SampleGridBuilder::gridBytes(n) + SampleGridBuilder::scratchBytes(n);
    EXPECT_LE(taken, bound) << primitives;
    EXPECT_GE(4 * taken, bound) << primitives << ": a bound that loose is of no use for planning";
  }
}

}  // namespace
}  // namespace encore
