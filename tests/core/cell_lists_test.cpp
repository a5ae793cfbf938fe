// Cell lists against brute force and the trees: the same id for every query, whatever the samples.
#include "core/reuse/cell_lists.h"

#include <gtest/gtest.h>

#include "core/reuse/nearest_neighbour.h"
#include "tests/core/twins/nearest_neighbour_twin.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"

namespace encore {
namespace {

class CellListsTest : public testing::Test {
 protected:
  CellLists build(const twin::Cloud& cloud) {
    CellLists lists;
    builder_.build(twin::uploadShading(*device_, cloud.samples), lists);
    return lists;
  }

  template <class Search, class Index>
  std::vector<uint32_t> found(Search& search, const Index& index, const twin::Samples& queries) {
    AaSamples aa = twin::uploadAa(*device_, queries);
    Commands commands(*device_);
    search.record(commands, index, aa);
    commands.run();
    return twin::download(aa.shade);
  }

  // Coherent and scattered queries, `count` of each; brute force for every `stride`th, the trees for all.
  CellLists expectExact(const twin::Cloud& cloud, uint32_t count, uint32_t stride = 1) {
    CellLists lists = build(cloud);
    Trees trees;
    trees_.build(twin::uploadShading(*device_, cloud.samples), trees);
    const twin::NearestNeighbour expected(cloud.samples);
    for (const bool coherent : {true, false}) {
      SCOPED_TRACE(cloud.name + (coherent ? ", coherent" : ", scattered"));
      const twin::Samples queries = maker_.queries(cloud.samples, count, coherent);
      const std::vector<uint32_t> ids = found(search_, lists, queries);
      EXPECT_TRUE(found(by_tree_, trees, queries) == ids);
      expectExact(expected, queries, ids, stride);
    }
    return lists;
  }

  void expectExact(const twin::NearestNeighbour& expected, const twin::Samples& queries,
                   const std::vector<uint32_t>& ids, uint32_t stride) {
    for (size_t i = 0; i < queries.keys.size(); i += stride) {
      ASSERT_EQ(ids[i], expected.find(queries.keys[i], queries.uv[i]))
          << i << ": key " << queries.keys[i].instance << " " << queries.keys[i].primitive_side << ", (u, v) "
          << queries.uv[i].x << " " << queries.uv[i].y;
    }
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  Scan scan_{*device_};
  RadixSort sort_{*device_, scan_};
  KeyTable table_{*device_};
  TreeBuilder trees_{*device_, scan_, sort_, table_};
  SampleGridBuilder grids_{*device_, scan_, sort_, table_};
  CellListBuilder builder_{*device_, scan_, table_, grids_, trees_};
  CellListSearch search_{*device_};
  NearestNeighbour by_tree_{*device_, NearestNeighbour::Walk::kSingle};
  twin::CloudMaker maker_{29};
};

TEST_F(CellListsTest, OnePrimitiveOfAnySize) {
  for (const uint32_t size : {0, 1, 2, 7, 8, 9, 16, 17, 100, 1000, 4099}) {
    expectExact(maker_.onOnePrimitive(size), 1501);
  }
}

// An even density needs trees at most beside its border, and short lists.
TEST_F(CellListsTest, AMillionSamplesOnOnePrimitive) {
  const CellLists lists = expectExact(maker_.onOnePrimitive(1'000'000), 50'000, 1009);
  EXPECT_LT(lists.leaves_by_tree, 1000);
  EXPECT_LT(lists.entry_count, 8 * lists.node_count);
}

TEST_F(CellListsTest, ManyPrimitives) { expectExact(maker_.onManyPrimitives(50'000), 100'000, 7); }

TEST_F(CellListsTest, HardShapes) {
  for (const twin::Cloud& cloud : maker_.hardShapes(1000)) expectExact(cloud, 3000);
}

TEST_F(CellListsTest, HardShapesOfManySamplesEnd) {
  for (const twin::Cloud& cloud : maker_.hardShapes(30'000)) expectExact(cloud, 1000, 101);
}

TEST_F(CellListsTest, AMillionSamplesAtOnePoint) {
  expectExact(maker_.placed("a million at one point", 1'000'000, [](uint32_t) { return Vec2f{0.3f, 0.7f}; }), 100'000,
              1009);
}

TEST_F(CellListsTest, ExtremesAndMixture) {
  expectExact(maker_.extremes(20'000), 20'000);
  expectExact(maker_.mixture(20'000), 20'000, 7);
}

// Densities that vary by a million and more, in one and in both coordinates.
TEST_F(CellListsTest, ExponentialDensities) {
  const auto falling = [this] { return std::exp2(-20 * maker_.unit()); };
  expectExact(maker_.placed("falling in u", 30'000, [&](uint32_t) { return Vec2f{falling(), maker_.unit()}; }), 2000,
              7);
  expectExact(maker_.placed("falling in both", 30'000, [&](uint32_t) { return Vec2f{falling(), falling()}; }), 2000, 7);
}

}  // namespace
}  // namespace encore
