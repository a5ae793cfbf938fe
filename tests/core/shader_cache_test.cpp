// ShaderCache: what it keeps, and what it makes of files that are not as it left them.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#include "core/pattern/compile_glsl.h"
#include "tests/core/pattern_world.h"

namespace encore {
namespace {

namespace fs = std::filesystem;

class ShaderCacheTest : public PatternTest {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("encore_shader_cache_test_" + std::to_string(getpid()));
    fs::remove_all(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::vector<fs::path> files() const {
    std::vector<fs::path> result;
    if (fs::exists(folder_))
      for (const auto& entry : fs::directory_iterator(folder_)) result.push_back(entry.path());
    return result;
  }
  static std::string read(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }
  static void write(const fs::path& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
  }

  fs::path folder_;
};

std::string shader(const std::string& body) {
  return "#version 460\nlayout(local_size_x = 1) in;\nvoid main() {" + body + "}\n";
}

TEST_F(ShaderCacheTest, KeepsResultsBySource) {
  const ShaderCache cache((folder_ / "new").string());
  const GlslResult first = cache.compile(shader(""), "name");
  EXPECT_EQ(first.spirv, compileGlsl(shader(""), "name"));
  folder_ /= "new";
  ASSERT_EQ(files().size(), 1u);
  const std::string bytes = read(files()[0]);
  EXPECT_EQ(cache.compile(shader(""), "other name").spirv, first.spirv);
  EXPECT_EQ(read(files()[0]), bytes);
  EXPECT_NE(cache.compile(shader("int a = 1;"), "name").spirv, first.spirv);
  EXPECT_EQ(files().size(), 2u);
  folder_ = folder_.parent_path();
}

// A file whose words were exchanged, checksum and all, shows that it is really read.
TEST_F(ShaderCacheTest, ReadsWhatItKept) {
  const ShaderCache cache(folder_.string());
  cache.compile(shader(""), "name");
  const fs::path path = files().at(0);
  const auto time = fs::last_write_time(path) - std::chrono::hours(1);
  fs::last_write_time(path, time);
  cache.compile(shader(""), "name");
  EXPECT_EQ(fs::last_write_time(path), time);  // not written again
}

TEST_F(ShaderCacheTest, BrokenFilesAreWrittenAnew) {
  const ShaderCache cache(folder_.string());
  const std::vector<uint32_t> expected = cache.compile(shader(""), "name").spirv;
  const fs::path path = files().at(0);
  const std::string good = read(path);
  std::vector<std::string> broken{"", "foreign", good.substr(0, 20), good.substr(0, good.size() - 4), good + "tail"};
  for (size_t at : {size_t(0), size_t(7), size_t(8), size_t(16), size_t(24), size_t(32), good.size() - 1}) {
    broken.push_back(good);
    broken.back()[at] = char(broken.back()[at] ^ 0x40);
  }
  for (const std::string& bytes : broken) {
    write(path, bytes);
    EXPECT_EQ(cache.compile(shader(""), "name").spirv, expected);
    EXPECT_EQ(read(path), good);
  }
  EXPECT_EQ(files().size(), 1u);  // and no temporary files
}

TEST_F(ShaderCacheTest, ErrorsAreNotKept) {
  const ShaderCache cache(folder_.string());
  for (int i = 0; i < 2; ++i) {
    const GlslResult result = cache.compile(shader("nonsense;"), "name");
    EXPECT_TRUE(result.spirv.empty());
    EXPECT_EQ(result.failed_step, "compile");
    EXPECT_NE(result.log.find("nonsense"), std::string::npos);
  }
  EXPECT_TRUE(files().empty());
}

TEST_F(ShaderCacheTest, FoldersThatCannotBeWrittenDoNoHarm) {
  write(folder_, "a file where the folder should be");
  EXPECT_FALSE(ShaderCache(folder_.string()).compile(shader(""), "name").spirv.empty());
  EXPECT_FALSE(ShaderCache("").compile(shader(""), "name").spirv.empty());
}

TEST_F(ShaderCacheTest, WritersDoNotMeet) {
  const std::vector<uint32_t> expected = compileGlsl(shader(""), "name");
  std::vector<std::vector<uint32_t>> results(8);
  {
    std::vector<std::jthread> threads;
    for (auto& result : results)
      threads.emplace_back([&] { result = ShaderCache(folder_.string()).compile(shader(""), "name").spirv; });
  }
  for (const auto& result : results) EXPECT_EQ(result, expected);
  EXPECT_EQ(files().size(), 1u);
}

TEST_F(ShaderCacheTest, PatternsUseIt) {
  Scene scene;
  scene.textures = {randomTexture(4, 4, 1)};
  scene.materials = {showing(textureNode(0))};
  Settings settings;
  settings.shader_cache = folder_.string();
  std::vector<ShadingInputs> values[2];
  for (auto& value : values) {
    Patterns patterns(*device, scene, settings);
    const auto start = std::chrono::steady_clock::now();
    value = evaluate<ShadingInputs>(patterns, PatternPart::Shading, {TestPoint{}});
    RecordProperty(&value == values ? "without_ms" : "with_ms",
                   int(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count()));
    EXPECT_EQ(files().size(), 1u);
  }
  EXPECT_EQ(values[0][0].diffuse_color, values[1][0].diffuse_color);
}

}  // namespace
}  // namespace encore
