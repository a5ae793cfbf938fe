// All searches find the same, bit for bit: what brute force finds. And the memory that they take.
#include "core/reuse/reuse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/scene/error.h"
#include "tests/core/twins/nearest_neighbour_twin.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"

namespace encore {
namespace {

constexpr Search kSearches[] = {Search::Tree, Search::Groups, Search::Cells};

class ReuseTest : public testing::Test {
 protected:
  // Brute force for every `stride`th query.
  void expectSame(const twin::Samples& samples, const twin::Samples& queries, uint32_t samples_per_pixel,
                  uint32_t stride = 1) {
    const ShadingSamples shading = twin::uploadShading(*device_, samples);
    AaSamples aa = twin::uploadAa(*device_, queries, samples_per_pixel);
    std::vector<uint32_t> first;
    for (const Search search : kSearches) {
      SCOPED_TRACE(int(search));
      const auto index = kernels_.buildIndex(shading, search);
      kernels_.findNearest(*index, aa);
      const std::vector<uint32_t> ids = twin::download(aa.shade);
      if (search == Search::Tree) first = ids;
      EXPECT_TRUE(ids == first);
    }
    const twin::NearestNeighbour expected(samples);
    for (size_t i = 0; i < queries.keys.size(); i += stride) {
      ASSERT_EQ(first[i], expected.find(queries.keys[i], queries.uv[i])) << i;
    }
  }

  // Coherent and scattered queries on a cloud.
  void expectSame(const twin::Cloud& cloud, uint32_t queries, uint32_t stride = 1) {
    for (const bool coherent : {true, false}) {
      SCOPED_TRACE(cloud.name + (coherent ? ", coherent" : ", scattered"));
      expectSame(cloud.samples, maker_.queries(cloud.samples, queries, coherent), 16, stride);
    }
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  ReuseKernels kernels_{*device_};
  twin::CloudMaker maker_{29};
};

// Antialiasing samples of the pixels of a screen that quads tile, 9 per pixel, and 2 shading samples per pixel.
TEST_F(ReuseTest, PixelsOfAScreen) {
  constexpr uint32_t kSize = 96, kPerPixel = 9;
  for (const float side : {0.7f, 3.3f, 40.0f}) {
    SCOPED_TRACE(side);
    const auto place = [&](twin::Samples& samples, uint32_t pixel) {
      const float x = (float(pixel % kSize) + maker_.unit()) / side, y = (float(pixel / kSize) + maker_.unit()) / side;
      const uint32_t primitive = uint32_t(y) * 1000 + uint32_t(x);
      const float u = x - std::floor(x), v = y - std::floor(y);
      samples.add({primitive % 3, primitive}, {u * u, v * u});
    };
    twin::Samples shading, aa;
    for (uint32_t i = 0; i < 2 * kSize * kSize; ++i) place(shading, i / 2);
    for (uint32_t i = 0; i < kPerPixel * kSize * kSize; ++i) place(aa, i / kPerPixel);
    expectSame(shading, aa, kPerPixel, 11);
    twin::Samples scattered;
    for (uint32_t i = 0; i < aa.keys.size(); ++i) {
      const size_t j = size_t(i) * 7919 % aa.keys.size();  // prime to the number of samples
      scattered.add(aa.keys[j], aa.uv[j]);
    }
    expectSame(shading, scattered, kPerPixel, 11);
  }
}

TEST_F(ReuseTest, Clouds) {
  for (const uint32_t size : {0, 1, 2, 50, 5000}) expectSame(maker_.onOnePrimitive(size), 3000, 3);
  expectSame(maker_.onManyPrimitives(20'000), 30'000, 5);
  expectSame(maker_.extremes(10'000), 10'000, 3);
  expectSame(maker_.mixture(10'000), 20'000, 7);
}

TEST_F(ReuseTest, HardShapes) {
  for (const twin::Cloud& cloud : maker_.hardShapes(2000)) expectSame(cloud, 3000, 7);
}

// The metric in which all footprints are equal orders as distances in (u, v) do.
TEST_F(ReuseTest, MetricOfEqualFootprints) {
  const twin::Cloud cloud = maker_.mixture(3000);
  const ShadingSamples shading = twin::uploadShading(*device_, cloud.samples);
  AaSamples aa = twin::uploadAa(*device_, maker_.queries(cloud.samples, 10'000, true));
  kernels_.findNearest(*kernels_.buildIndex(shading, Search::Groups), aa);
  const std::vector<uint32_t> ids = twin::download(aa.shade);
  kernels_.findNearest(*kernels_.buildIndex(shading, Search::Tree, 2), aa);
  EXPECT_TRUE(twin::download(aa.shade) == ids);
}

TEST_F(ReuseTest, RefusesIndicesThatCannotBe) {
  ShadingSamples shading = twin::uploadShading(*device_, maker_.onOnePrimitive(10).samples);
  EXPECT_THROW(kernels_.buildIndex(shading, Search::Auto), Error);
  EXPECT_THROW(kernels_.buildIndex(shading, Search::Groups, 1), Error);
  EXPECT_THROW(kernels_.buildIndex(shading, Search::Cells, 1), Error);
  for (const float weight : {-1.0f, 2e6f, std::numeric_limits<float>::quiet_NaN()}) {
    EXPECT_THROW(kernels_.buildIndex(shading, Search::Tree, weight), Error);
  }
  shading.footprint = {};
  EXPECT_THROW(kernels_.buildIndex(shading, Search::Tree, 1), Error);
}

// The bounds must hold for one primitive per sample, for one in all, and between; of even and of uneven density.
TEST(IndexBytesTest, BoundsWhatABuildAllocates) {
  twin::CloudMaker maker(2);
  constexpr uint32_t kCount = 33'000;
  for (const bool uneven : {false, true}) {
    for (const uint32_t primitives : {1u, 7000u, kCount}) {
      if (uneven && primitives == kCount) continue;  // one sample each: as even as can be
      twin::Samples samples;
      for (uint32_t i = 0; i < kCount; ++i) {
        const float scale = uneven ? std::pow(10.0f, -6 * maker.unit()) : 1;
        samples.add({0, i % primitives}, scale * maker.uv());
      }
      for (const Search search : kSearches) {
        SCOPED_TRACE(std::to_string(primitives) + " primitives, search " + std::to_string(int(search)));
        const auto device = Device::create({.validation = true});
        const ShadingSamples uploaded = twin::uploadShading(*device, samples);
        const uint64_t before = device->allocatedBytes();
        ReuseKernels kernels(*device);
        const auto index = kernels.buildIndex(uploaded, search, search == Search::Tree ? 1.0f : 0.0f);
        const uint64_t taken = device->peakAllocatedBytes() - before;
        EXPECT_LE(taken, ReuseKernels::indexBytes(kCount, search));
        EXPECT_LE(ReuseKernels::indexBytes(kCount, search), ReuseKernels::indexBytes(kCount, Search::Auto));
        if (search == Search::Tree) {
          EXPECT_GE(3 * taken, ReuseKernels::indexBytes(kCount, search)) << "of no use for planning";
        }
      }
    }
  }
  for (const Search search : kSearches) {
    EXPECT_GT(ReuseKernels::indexBytes(5'000'000'000, search), ReuseKernels::indexBytes(4'000'000'000, search));
  }
}

}  // namespace
}  // namespace encore
