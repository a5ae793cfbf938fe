// The distance limit against its plain definition.
#include "core/reuse/limit_distance.h"

#include <gtest/gtest.h>

#include <limits>

#include "core/scene/error.h"
#include "tests/core/twins/footprint_twin.h"
#include "tests/core/twins/reuse_buffers.h"
#include "tests/core/twins/reuse_clouds.h"

namespace encore {
namespace {

// In double precision: what a sample's shade becomes.
uint32_t limited(const twin::Samples& samples, Vec2f uv, float footprint, uint32_t shade, float limit) {
  if (shade >= samples.keys.size()) return shade;
  const Vec2f q = twin::inUnitSquare(uv), p = twin::inUnitSquare(samples.uv[shade]);
  const double distance = std::hypot(double(q.x) - p.x, double(q.y) - p.y);
  return distance > double(limit) * twin::clampedFootprint(footprint) ? kShadeNotFound : shade;
}

class LimitDistanceTest : public testing::Test {
 protected:
  std::vector<uint32_t> after(const twin::Samples& samples, const twin::Samples& queries,
                              const std::vector<uint32_t>& shade, float limit) {
    AaSamples aa = twin::uploadAa(*device_, queries);
    aa.shade = twin::upload(*device_, shade);
    kernels_.limitDistance(twin::uploadShading(*device_, samples), aa, limit);
    return twin::download(aa.shade);
  }
  // Of one sample that has sample 0, at `at`, as its neighbour.
  bool keeps(Vec2f at, Vec2f uv, float footprint, float limit) {
    twin::Samples samples, queries;
    samples.add({1, 2}, at);
    queries.add({1, 2}, uv, footprint);
    return after(samples, queries, {0}, limit)[0] == 0;
  }

  std::shared_ptr<Device> device_ = Device::create({.validation = true});
  ReuseKernels kernels_{*device_};
  twin::CloudMaker maker_{5};
};

TEST_F(LimitDistanceTest, AgreesWithTwin) {
  const twin::Samples samples = maker_.onOnePrimitive(500).samples;
  for (const twin::Footprints kind : twin::kAllFootprints) {
    twin::Samples queries = maker_.queries(samples, 20'000, true);
    maker_.giveFootprints(queries, kind);
    std::vector<uint32_t> shade;
    for (size_t i = 0; i < queries.keys.size(); ++i) {
      const uint32_t others[] = {kShadeNone, kShadeNotFound, 500, 1'000'000};
      shade.push_back(maker_.below(5) ? maker_.below(500) : others[maker_.below(4)]);
    }
    for (const float limit : {1e-20f, 0.3f, 4.0f, 100.0f, 1e6f}) {
      SCOPED_TRACE(limit);
      const std::vector<uint32_t> found = after(samples, queries, shade, limit);
      uint32_t different = 0;
      for (size_t i = 0; i < shade.size(); ++i) {
        different += found[i] != limited(samples, queries.uv[i], queries.footprints[i], shade[i], limit);
      }
      EXPECT_LE(different, 2u);  // those whose distance is the limit to within rounding
    }
  }
}

TEST_F(LimitDistanceTest, IsInclusive) {
  EXPECT_TRUE(keeps({0.25f, 0.5f}, {0.5f, 0.5f}, 0.125f, 2));
  EXPECT_FALSE(keeps({0.25f, 0.5f}, {0.5f, 0.5f}, 0.1249f, 2));
  EXPECT_TRUE(keeps({0, 0}, {1, 1}, 1.5f, 1));
}

TEST_F(LimitDistanceTest, FootprintsThatAreNone) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
  for (const float footprint : {0.0f, -0.0f, -1.0f, kNan, 1e-40f, -kInf}) {
    EXPECT_TRUE(keeps({0.5f, 0.5f}, {0.5f, 0.5f}, footprint, 3)) << footprint;
    EXPECT_FALSE(keeps({0.5f, 0.5f}, {0.5f, 0.5001f}, footprint, 3)) << footprint;
  }
  for (const float footprint : {kInf, 3e38f}) {
    for (const float limit : {1e-6f, 1.0f, 3e38f, kInf}) EXPECT_TRUE(keeps({0, 1}, {1, 0}, footprint, limit));
  }
  EXPECT_TRUE(keeps({kNan, 0}, {-3, 0}, 0, 3)) << "both count as (0, 0)";
}

TEST_F(LimitDistanceTest, RefusesWhatIsNoLimit) {
  EXPECT_THROW(keeps({0, 0}, {0, 0}, 1, 0), Error);
  EXPECT_THROW(keeps({0, 0}, {0, 0}, 1, -1), Error);
  EXPECT_THROW(keeps({0, 0}, {0, 0}, 1, std::numeric_limits<float>::quiet_NaN()), Error);
  twin::Samples samples;
  samples.add({1, 2}, {0, 0});
  AaSamples aa = twin::uploadAa(*device_, samples);
  aa.footprint = {};
  EXPECT_THROW(kernels_.limitDistance(twin::uploadShading(*device_, samples), aa, 1), Error);
}

TEST_F(LimitDistanceTest, OfNoSamples) {
  EXPECT_TRUE(after({}, {}, {}, 1).empty());
  twin::Samples queries;
  queries.add({1, 2}, {0, 0});
  EXPECT_EQ(after({}, queries, {kShadeNotFound}, 1)[0], kShadeNotFound);
}

}  // namespace
}  // namespace encore
