// Trees against their twin, bit by bit, and the memory they take.
#include "core/reuse/trees.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstring>

#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"
#include "tests/core/twins/trees_twin.h"

namespace encore {
namespace {

bool sameBits(Vec2f a, Vec2f b) {
  return std::bit_cast<std::array<uint32_t, 2>>(a) == std::bit_cast<std::array<uint32_t, 2>>(b);
}

// The arrays of a Trees on the host.
struct HostTrees {
  std::vector<TreePrimitive> primitives;
  std::vector<TreeNode> nodes;
  std::vector<uint32_t> lowest_ids, ids;
  std::vector<Vec2f> points;

  explicit HostTrees(Trees& trees)
      : primitives(twin::download(trees.primitives)),
        nodes(twin::download(trees.nodes)),
        lowest_ids(twin::download(trees.lowest_ids)),
        ids(twin::download(trees.ids)),
        points(twin::download(trees.points)) {}
};

class TreesTest : public testing::Test {
 protected:
  HostTrees built(const twin::Samples& samples) {
    Trees trees = kernels_.build(twin::uploadShading(*device_, samples));
    EXPECT_EQ(trees.sample_count, samples.keys.size());
    EXPECT_EQ(trees.primitive_count, trees.primitives.size());
    return HostTrees(trees);
  }

  void expectTree(const twin::Tree& expected, const HostTrees& trees, size_t primitive, const twin::Samples& samples) {
    const TreePrimitive& p = trees.primitives[primitive];
    ASSERT_EQ(twin::pairOf(p.key), twin::pairOf(expected.key));
    ASSERT_EQ(p.count, expected.ids.size());
    ASSERT_EQ(p.depth(), expected.depth);
    ASSERT_EQ(p.uLevels(), expected.u_levels);
    for (uint32_t i = 0; i < p.count; ++i) {
      ASSERT_EQ(trees.ids[p.first + i], expected.ids[i]) << i;
      ASSERT_TRUE(sameBits(trees.points[p.first + i], twin::inUnitSquare(samples.uv[expected.ids[i]]))) << i;
    }
    for (size_t j = 1; j < expected.nodes.size(); ++j) {
      const TreeNode& node = trees.nodes[p.first_node + j];
      ASSERT_TRUE(sameBits(node.low, expected.nodes[j].box.low)) << j;
      ASSERT_TRUE(sameBits(node.high, expected.nodes[j].box.high)) << j;
      ASSERT_EQ(trees.lowest_ids[p.first_node + j], expected.nodes[j].lowest_id) << j;
    }
  }

  void expectLikeTwin(const twin::Cloud& cloud) {
    SCOPED_TRACE(cloud.name);
    const HostTrees trees = built(cloud.samples);
    const std::vector<twin::Tree> expected = twin::makeTrees(cloud.samples);
    ASSERT_EQ(trees.primitives.size(), expected.size());
    uint32_t first = 0;
    for (size_t i = 0; i < expected.size(); ++i) {
      ASSERT_EQ(trees.primitives[i].first, first);
      first += trees.primitives[i].count;
      expectTree(expected[i], trees, i, cloud.samples);
      if (HasFatalFailure()) return;
    }
    EXPECT_EQ(first, cloud.samples.keys.size());
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  twin::TreeKernels kernels_{*device_};
  twin::CloudMaker maker_{1};
};

TEST_F(TreesTest, OnePrimitiveOfAnySize) {
  for (const uint32_t size : {0, 1, 2, 7, 8, 9, 15, 16, 17, 64, 65, 1000, 4097}) {
    expectLikeTwin(maker_.onOnePrimitive(size));
  }
}

TEST_F(TreesTest, AMillionSamplesOnOnePrimitive) { expectLikeTwin(maker_.onOnePrimitive(1'000'000)); }

TEST_F(TreesTest, ManyPrimitives) { expectLikeTwin(maker_.onManyPrimitives(100'000)); }

TEST_F(TreesTest, HardShapes) {
  for (const twin::Cloud& cloud : maker_.hardShapes(5000)) expectLikeTwin(cloud);
}

TEST_F(TreesTest, ExtremesAndMixture) {
  expectLikeTwin(maker_.extremes(20'000));
  expectLikeTwin(maker_.mixture(20'000));
}

TEST_F(TreesTest, TwoBuildsAreBitIdentical) {
  const twin::Cloud cloud = maker_.mixture(50'000);
  const HostTrees a = built(cloud.samples);
  built(maker_.onManyPrimitives(3000).samples);  // leaves other contents in the scratch memory
  const HostTrees b = built(cloud.samples);
  EXPECT_EQ(a.ids, b.ids);
  EXPECT_TRUE(std::equal(a.points.begin(), a.points.end(), b.points.begin(), b.points.end(), sameBits));
  ASSERT_EQ(a.primitives.size(), b.primitives.size());
  for (size_t i = 0; i < a.primitives.size(); ++i) {
    EXPECT_EQ(std::memcmp(&a.primitives[i], &b.primitives[i], sizeof(TreePrimitive)), 0);
  }
}

TEST_F(TreesTest, WorksWithoutSharedMemory) {
  const auto device = Device::create({.validation = true, .staging = true});
  twin::TreeKernels kernels(*device);
  const twin::Cloud cloud = maker_.mixture(5000);
  Trees trees = kernels.build(twin::uploadShading(*device, cloud.samples));
  EXPECT_EQ(HostTrees(trees).ids, built(cloud.samples).ids);
}

}  // namespace
}  // namespace encore
