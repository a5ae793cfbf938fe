#include "core/render/memory_plan.h"

#include <gtest/gtest.h>

#include "core/scene/error.h"

namespace encore {
namespace {

constexpr uint64_t kMebibyte = 1u << 20;

Settings frame(uint32_t width, uint32_t height, uint32_t samples) {
  Settings settings;
  settings.width = width;
  settings.height = height;
  settings.samples = samples;
  return settings;
}

// Three layers at the usual rate.
PlanInput threeLayers() { return {{{2, Search::Groups}, {2, Search::Cells}, {2, Search::Cells}}}; }

TEST(MemoryPlan, StaysWithinTheBudget) {
  for (const uint64_t budget : {1024 * kMebibyte, 4096 * kMebibyte, 16384 * kMebibyte})
    for (const uint32_t samples : {1u, 4u, 11u, 23u}) {
      const MemoryPlan plan = planMemory(frame(1920, 1080, samples), threeLayers(), budget);
      EXPECT_GE(plan.blocks_per_batch, 1u);
      // One block is allowed to be larger than what batches are usually cut to, but not than the budget.
      EXPECT_LE(plan.fixed_bytes + plan.blocks_per_batch * plan.bytes_per_block, budget);
    }
}

TEST(MemoryPlan, MoreMemoryNeverMeansSmallerBatches) {
  uint32_t before = 0;
  for (uint64_t budget = 1000 * kMebibyte; budget < 20000 * kMebibyte; budget += 500 * kMebibyte) {
    const MemoryPlan plan = planMemory(frame(1280, 720, 11), threeLayers(), budget);
    EXPECT_GE(plan.blocks_per_batch, before);
    before = plan.blocks_per_batch;
  }
  EXPECT_GT(before, 1u);
}

TEST(MemoryPlan, NamesTheSmallestSufficientBudget) {
  try {
    planMemory(frame(1920, 1080, 11), threeLayers(), 1);
    FAIL() << "a budget of one byte was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Memory);
    EXPECT_EQ(error.where(), "--memory");
    const std::string remedy = error.remedy();
    const size_t digits = remedy.find_first_of("0123456789");
    ASSERT_NE(digits, std::string::npos) << remedy;
    const uint64_t least = std::stoull(remedy.substr(digits));
    EXPECT_NO_THROW(planMemory(frame(1920, 1080, 11), threeLayers(), least * kMebibyte));
    EXPECT_THROW(planMemory(frame(1920, 1080, 11), threeLayers(), (least - 2) * kMebibyte), Error);
  }
}

TEST(MemoryPlan, TileDoesNotGrowWithTheImage) {
  const MemoryPlan hd = planMemory(frame(1920, 1080, 4), threeLayers(), 1ull << 40);
  const MemoryPlan wide = planMemory(frame(16384, 8192, 4), threeLayers(), 1ull << 40);
  EXPECT_EQ(hd.bytes_per_block, wide.bytes_per_block);
  EXPECT_EQ(hd.blocks_per_batch, wide.blocks_per_batch);
}

// §3.1: what grows with the image is only a strip of its width for the film.
TEST(MemoryPlan, ImageAndSampleCountDoNotChangeWhatATileTakes) {
  const MemoryPlan hd = planMemory(frame(1920, 1080, 23), threeLayers(), 1024 * kMebibyte);
  const MemoryPlan wide = planMemory(frame(16384, 8192, 4), threeLayers(), 1024 * kMebibyte);
  EXPECT_NEAR(double(wide.fixed_bytes), double(hd.fixed_bytes), 16.0 * kMebibyte);
  EXPECT_GE(hd.blocks_per_batch, 1u);
}

TEST(MemoryPlan, SeedsOfTheHighestRateFit) {
  PlanInput input = threeLayers();
  input.layers[1].rate = 16;
  const MemoryPlan plan = planMemory(frame(1920, 1080, 4), input, 8192 * kMebibyte);
  EXPECT_GE(plan.blocks_per_seed_batch, 1u);
  EXPECT_LE(plan.fixed_bytes + plan.blocks_per_seed_batch * plan.bytes_per_seed_block, 8192 * kMebibyte);
  EXPECT_GT(plan.fixed_bytes, planMemory(frame(1920, 1080, 4), threeLayers(), 8192 * kMebibyte).fixed_bytes);
}

TEST(MemoryPlan, ReferenceNeedsNoTrees) {
  Settings settings = frame(1920, 1080, 4);
  const uint64_t reuse = planMemory(settings, threeLayers(), 1ull << 40).fixed_bytes;
  settings.method = Method::Reference;
  EXPECT_LT(planMemory(settings, threeLayers(), 1ull << 40).fixed_bytes, reuse);
}

TEST(MemoryPlan, DefaultBudgetIsHalfOfWhatThereIs) {
  EXPECT_EQ(defaultMemoryBudget(false, 8192 * kMebibyte), 4096 * kMebibyte);
  EXPECT_GT(defaultMemoryBudget(true, 0), 0u);
}

}  // namespace
}  // namespace encore
