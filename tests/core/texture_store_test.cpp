// Textures on demand: sources are read when and as far as batches want them, within the budget.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <memory>
#include <vector>

#include "core/pattern/texture_heap.h"
#include "core/pattern/texture_pyramid.h"
#include "core/scene/error.h"
#include "tests/core/pattern_world.h"

namespace encore {
namespace {

// The pixels of a texture, as half floats on demand.
class CountingSource : public TextureSource {
 public:
  explicit CountingSource(const Texture& texture) {
    for (float value : texture.rgba) halves_.push_back(toHalf(value));
  }
  void read(std::span<uint16_t> rgba) const override {
    ++reads;
    if (fail) throw Error(ErrorKind::Scene, "the file is gone", "/looks/image", "Bring it back");
    ASSERT_EQ(rgba.size(), halves_.size());
    std::copy(halves_.begin(), halves_.end(), rgba.begin());
  }
  void set(size_t half, uint16_t bits) { halves_[half] = bits; }

  mutable std::atomic<int> reads = 0;
  bool fail = false;

 private:
  std::vector<uint16_t> halves_;
};

class TextureStoreTest : public PatternTest {
 protected:
  // Textures of 64 × 64: pyramids of 5461 texels, 43688 bytes.
  static constexpr uint64_t kPyramidBytes = 5461 * 8;

  void makeScene(uint32_t textures) {
    for (uint32_t i = 0; i < textures; ++i) {
      const Texture pixels = randomTexture(64, 64, 300 + i);
      in_memory_.textures.push_back(pixels);
      in_memory_.materials.push_back(showing(textureNode(int32_t(i))));
      sources_.push_back(std::make_shared<CountingSource>(pixels));
      Texture on_demand = makeTexture(pixels.path, 64, 64);
      on_demand.source = sources_.back();
      scene_.textures.push_back(on_demand);
    }
    scene_.materials = in_memory_.materials;
    // Pixels that are half floats to begin with, so that both ways give the same.
    for (Texture& texture : in_memory_.textures)
      for (float& value : texture.rgba) value = fromHalf(toHalf(value));
  }

  // Points whose footprints are as wide as two texels of the level.
  static std::vector<TestPoint> wanting(uint32_t texture, float level, uint32_t count = 50) {
    Random random(uint32_t(texture * 100 + level));
    std::vector<TestPoint> points(count);
    for (TestPoint& point : points) {
      const float width = std::exp2(level + 1) / 64;
      point = {.material = texture, .st = {random.unit(), random.unit()}, .dstdx = {width, 0}, .dstdy = {0, width}};
    }
    return points;
  }
  static uint64_t tailBytes(uint32_t level) {
    uint64_t texels = 0;
    for (uint32_t size = 64u >> level; size > 0; size /= 2) texels += size * size;
    return texels * 8;
  }
  static void expectSame(const std::vector<ShadingInputs>& a, const std::vector<ShadingInputs>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < a.size(); ++i) {
      ASSERT_EQ(a[i].diffuse_color, b[i].diffuse_color) << i;
      ASSERT_EQ(a[i].emissive_color, b[i].emissive_color) << i;
    }
  }
  std::vector<ShadingInputs> expected(const std::vector<TestPoint>& points) {
    if (!whole_) whole_ = std::make_unique<Patterns>(*device, in_memory_);
    return shading(*whole_, points);
  }
  static std::vector<ShadingInputs> shading(Patterns& patterns, const std::vector<TestPoint>& points) {
    return evaluate<ShadingInputs>(patterns, PatternPart::Shading, points);
  }

  Scene scene_, in_memory_;
  std::unique_ptr<Patterns> whole_;  // of in_memory_
  std::vector<std::shared_ptr<CountingSource>> sources_;
};

TEST(HalfFloats, AreExactWhenTheyComeBack) {
  for (uint32_t half = 0; half < 0x10000; ++half) {
    const float value = fromHalf(uint16_t(half));
    if ((half & 0x7c00u) == 0x7c00u) {
      ASSERT_EQ(std::isnan(value), (half & 0x3ffu) != 0);
      ASSERT_FALSE(std::isfinite(value));
    } else {
      ASSERT_EQ(toHalf(value), half);
    }
  }
}

TEST_F(TextureStoreTest, ReadsOnlyWhatIsWanted) {
  makeScene(2);
  Patterns patterns(*device, scene_);
  const uint64_t tables = patterns.textureBytes();
  EXPECT_EQ(sources_[0]->reads, 0);

  expectSame(shading(patterns, wanting(0, 4)), expected(wanting(0, 4)));
  EXPECT_EQ(sources_[0]->reads, 1);
  EXPECT_EQ(sources_[1]->reads, 0);
  EXPECT_EQ(patterns.textureBytes(), tables + tailBytes(4));
  shading(patterns, wanting(0, 5));  // coarser ones came with it
  EXPECT_EQ(sources_[0]->reads, 1);
  expectSame(shading(patterns, wanting(0, 1.5f)), expected(wanting(0, 1.5f)));
  EXPECT_EQ(sources_[0]->reads, 2);
  EXPECT_EQ(patterns.textureBytes(), tables + tailBytes(1));
  expectSame(shading(patterns, wanting(1, 0)), expected(wanting(1, 0)));
  EXPECT_EQ(patterns.textureBytes(), tables + tailBytes(1) + kPyramidBytes);
  EXPECT_EQ(patterns.peakTextureBytes(), patterns.textureBytes());

  // Once everything is there, batches take one dispatch.
  shading(patterns, wanting(0, 0));
  device->resetTimings();
  shading(patterns, wanting(0, 0));
  EXPECT_EQ(device->timings().at("pattern_shading").dispatches, 1u);
}

TEST_F(TextureStoreTest, ResultsDoNotDependOnTheBudget) {
  makeScene(6);
  Random random(81);
  Settings small;
  small.texture_budget_bytes = 2 * kPyramidBytes + 100;
  Patterns patterns(*device, scene_, small);
  const uint64_t tables = patterns.textureBytes();
  for (int batch = 0; batch < 60; ++batch) {
    std::vector<TestPoint> points;
    for (int i = 0; i < 2; ++i) {
      const std::vector<TestPoint> more = wanting(random.below(6), random.in(0, 6));
      points.insert(points.end(), more.begin(), more.end());
    }
    expectSame(shading(patterns, points), expected(points));
    if (HasFatalFailure()) return;
    ASSERT_LE(patterns.textureBytes(), tables + small.texture_budget_bytes);
  }
  EXPECT_LE(patterns.peakTextureBytes(), tables + small.texture_budget_bytes);
  EXPECT_GT(patterns.peakTextureBytes(), tables + kPyramidBytes);
}

TEST_F(TextureStoreTest, TheLeastRecentlyWantedLeave) {
  makeScene(4);
  Settings settings;
  settings.texture_budget_bytes = 3 * kPyramidBytes;
  Patterns patterns(*device, scene_, settings);
  for (uint32_t texture : {0u, 1u, 2u}) shading(patterns, wanting(texture, 0));
  shading(patterns, wanting(0, 0));  // now texture 1 is the oldest
  shading(patterns, wanting(3, 0));
  const auto reads = [&](uint32_t texture) {
    const int before = sources_[texture]->reads;
    shading(patterns, wanting(texture, 0));
    return sources_[texture]->reads - before;
  };
  EXPECT_EQ(reads(0), 0);
  EXPECT_EQ(reads(2), 0);
  EXPECT_EQ(reads(3), 0);
  EXPECT_EQ(reads(1), 1);
}

TEST_F(TextureStoreTest, BatchesThatDoNotFitAreRefused) {
  makeScene(2);
  Settings settings;
  settings.texture_budget_bytes = kPyramidBytes + tailBytes(2);
  Patterns patterns(*device, scene_, settings);
  std::vector<TestPoint> points = wanting(0, 0);
  const std::vector<TestPoint> more = wanting(1, 1);
  points.insert(points.end(), more.begin(), more.end());
  try {
    shading(patterns, points);
    FAIL() << "nothing thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Memory);
    const std::string what = error.what();
    EXPECT_NE(what.find("2 textures"), std::string::npos) << what;
    EXPECT_NE(what.find("MiB"), std::string::npos) << what;
  }
  // One after the other they do.
  expectSame(shading(patterns, wanting(0, 0)), expected(wanting(0, 0)));
  expectSame(shading(patterns, wanting(1, 1)), expected(wanting(1, 1)));
}

TEST_F(TextureStoreTest, ErrorsOfSourcesArrive) {
  makeScene(2);
  Patterns patterns(*device, scene_);
  std::vector<TestPoint> points = wanting(0, 0);
  const std::vector<TestPoint> more = wanting(1, 0);
  points.insert(points.end(), more.begin(), more.end());
  sources_[1]->fail = true;
  for (int i = 0; i < 2; ++i) {
    try {
      shading(patterns, points);
      FAIL() << "nothing thrown";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::Scene);
      EXPECT_EQ(error.where(), "/looks/image");
    }
  }
  sources_[1]->fail = false;
  expectSame(shading(patterns, points), expected(points));
}

TEST_F(TextureStoreTest, StrangePixelsOfSources) {
  makeScene(2);
  sources_[0]->set(4 * (64 * 3 + 7), 0x7c00);      // infinity
  sources_[0]->set(4 * (64 * 3 + 7) + 1, 0xfc00);  // and below
  sources_[1]->set(4 * (64 * 5 + 9) + 2, 0xfe01);  // not a number
  Patterns patterns(*device, scene_);
  const TestPoint centre{.material = 0, .st = {7.5f / 64, 3.5f / 64}};
  const ShadingInputs value = shading(patterns, {centre})[0];
  EXPECT_EQ(value.diffuse_color.x, 65504.0f);
  EXPECT_EQ(value.diffuse_color.y, -65504.0f);
  try {
    shading(patterns, wanting(1, 3));
    FAIL() << "nothing thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Scene);
    EXPECT_NE(std::string(error.what()).find("column 9, row 5"), std::string::npos) << error.what();
  }
}

TEST_F(TextureStoreTest, OneTexel) {
  scene_.textures = {makeTexture("one.exr", 1, 1)};
  auto source = std::make_shared<CountingSource>(constantTexture(1, 1, {0.25f, 0.5f, 0.75f, 1}));
  scene_.textures[0].source = source;
  scene_.materials = {showing(textureNode(0))};
  Patterns patterns(*device, scene_);
  EXPECT_EQ(shown(shading(patterns, wanting(0, 3, 1))[0]), (std::array<float, 4>{0.25f, 0.5f, 0.75f, 1}));
}

// Devices whose memory is not shared see the same.
TEST_F(TextureStoreTest, StagedMemory) {
  makeScene(3);
  const auto staged = Device::create({.select = {}, .validation = true, .staging = true});
  Settings settings;
  settings.texture_budget_bytes = kPyramidBytes + tailBytes(1);
  Patterns patterns(*staged, scene_, settings);
  for (uint32_t texture : {0u, 1u, 2u, 0u}) {
    const std::vector<TestPoint> points = wanting(texture, texture == 1 ? 1.5f : 0);
    expectSame(shading(patterns, points), expected(points));
  }
}

class TextureHeapTest : public PatternTest {};

TEST_F(TextureHeapTest, BlocksNeverOverlapAndPagesAreGivenBack) {
  constexpr uint64_t kPage = 1 << 16;
  const uint64_t before = device->allocatedBytes();
  TextureHeap heap(*device, kPage);
  std::vector<TextureHeap::Block> blocks;
  std::vector<uint16_t> names;
  Random random(91);
  const auto check = [&](size_t i) {
    const auto halves = heap.host(blocks[i]);
    ASSERT_TRUE(std::all_of(halves.begin(), halves.end(), [&](uint16_t half) { return half == names[i]; })) << i;
  };
  for (uint16_t step = 1; step < 2000; ++step) {
    if (blocks.size() > 40 || (!blocks.empty() && random.below(3) == 0)) {
      const size_t i = random.below(uint32_t(blocks.size()));
      check(i);
      heap.release(blocks[i]);
      blocks.erase(blocks.begin() + long(i)), names.erase(names.begin() + long(i));
    } else {
      blocks.push_back(heap.allocate(4 * (1 + random.below(random.below(4) ? 500 : 9000))));
      names.push_back(step);
      const auto halves = heap.host(blocks.back());
      std::fill(halves.begin(), halves.end(), step);
    }
    if (HasFatalFailure()) return;
  }
  for (size_t i = 0; i < blocks.size(); ++i) {
    check(i);
    heap.release(blocks[i]);
  }
  EXPECT_EQ(device->allocatedBytes(), before);
}

TEST_F(TextureHeapTest, SmallBlocksShareAPage) {
  TextureHeap heap(*device, 1 << 16);
  const uint64_t before = device->allocatedBytes();
  std::vector<TextureHeap::Block> blocks;
  for (int i = 0; i < 8; ++i) blocks.push_back(heap.allocate(1024));
  EXPECT_EQ(device->allocatedBytes() - before, 1u << 16);
  EXPECT_EQ(blocks[7].page, blocks[0].page);
  heap.release(blocks[3]);
  EXPECT_EQ(heap.allocate(1024).first, 3u * 1024);  // into the hole
}

}  // namespace
}  // namespace encore
