// Filtering of fine text: against the mean over the footprint, it neither aliases (error) nor blurs (contrast).
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <vector>

#include "tests/core/pattern_world.h"
#include "tests/core/twins/texture_twin.h"

namespace encore {
namespace {

constexpr uint32_t kSize = 256;

// Black strokes a texel wide on white, as letters of five by seven texels.
Texture textTexture() {
  Texture texture = makeTexture("text.exr", kSize, kSize, std::vector<float>(kSize * kSize * 4, 1.0f));
  Random random(3);
  for (uint32_t y = 0; y + 9 <= kSize; y += 9)
    for (uint32_t x = 0; x + 7 <= kSize; x += 7)
      for (int stroke = 0; stroke < 4; ++stroke) {
        const bool horizontal = random.below(2) != 0;
        const uint32_t column = random.below(5), row = random.below(7), length = 3 + random.below(4);
        for (uint32_t i = 0; i < length; ++i) {
          const uint32_t tx = x + (horizontal ? std::min(4u, i) : column),
                         ty = y + (horizontal ? row : std::min(6u, i));
          for (uint32_t c = 0; c < 4; ++c) texture.rgba[(ty * kSize + tx) * 4 + c] = 0;
        }
      }
  return texture;
}

// The mean over the parallelogram of the footprint, by brute force.
double truth(const twin::Level& level, const TestPoint& p) {
  constexpr int kSteps = 20;
  double sum = 0;
  for (int j = 0; j < kSteps; ++j)
    for (int i = 0; i < kSteps; ++i) {
      const double u = (i + 0.5) / kSteps - 0.5, v = (j + 0.5) / kSteps - 0.5;
      sum += twin::bilinear(level, p.st.x + u * p.dstdx.x + v * p.dstdy.x, p.st.y + u * p.dstdx.y + v * p.dstdy.y,
                            WrapMode::Repeat, WrapMode::Repeat)[0];
    }
  return sum / (kSteps * kSteps);
}

struct Quality {
  double error = 0, contrast = 0;  // root mean square; slope of the found values over the true ones
};

class TextureFilterTest : public PatternTest {
 protected:
  // Footprints of these widths, in texels, of this ratio, in any direction.
  static std::vector<TestPoint> points(float least, float most, float anisotropy) {
    Random random(17);
    std::vector<TestPoint> points(400);
    for (TestPoint& p : points) {
      const float width = least * std::pow(most / least, random.unit()) / kSize, angle = random.in(0, 2 * kPi);
      p.st = {random.unit(), random.unit()};
      p.dstdx = {width * anisotropy * std::cos(angle), width * anisotropy * std::sin(angle)};
      p.dstdy = {-width * std::sin(angle), width * std::cos(angle)};
    }
    return points;
  }
  static Quality measure(const std::vector<double>& found, const std::vector<double>& expected) {
    double n = double(found.size()), e = 0, sx = 0, sy = 0, sxy = 0, sxx = 0;
    for (size_t i = 0; i < found.size(); ++i) {
      e += (found[i] - expected[i]) * (found[i] - expected[i]);
      sx += expected[i], sy += found[i], sxy += expected[i] * found[i], sxx += expected[i] * expected[i];
    }
    return {std::sqrt(e / n), (sxy - sx * sy / n) / (sxx - sx * sx / n)};
  }
};

TEST_F(TextureFilterTest, FineTextNeitherAliasesNorBlurs) {
  Scene scene;
  scene.textures = {textTexture()};
  scene.materials = {showing(textureNode(0))};
  scene.materials[0].roughness = {0, 0, 0};
  const twin::Level level = twin::pyramid(scene.textures[0])[0];
  Patterns patterns(*device, scene);
  struct Case {
    float least, most, anisotropy;
    double shading_error, shading_contrast, path_error, path_contrast;
  };
  for (const Case& c : {Case{0.3f, 0.6f, 1, 0.03, 0.97, 0.03, 0.97}, Case{1.2f, 2, 1, 0.03, 0.98, 0.08, 0.95},
                        Case{2, 4, 1, 0.045, 0.88, 0.08, 0.9}, Case{4, 8, 1, 0.05, 0.7, 0.07, 0.75},
                        Case{1.2f, 2, 4, 0.03, 0.97, 0.05, 0.97}, Case{2, 4, 4, 0.03, 0.9, 0.05, 0.95}}) {
    const std::vector<TestPoint> at = points(c.least, c.most, c.anisotropy);
    std::vector<double> expected, shading, path;
    for (const TestPoint& p : at) expected.push_back(truth(level, p));
    for (const auto& value : evaluate<ShadingInputs>(patterns, PatternPart::Shading, at))
      shading.push_back(value.diffuse_color.x);
    for (const auto& value : evaluate<PathInputs>(patterns, PatternPart::Path, at)) path.push_back(value.roughness);
    const Quality of_shading = measure(shading, expected), of_path = measure(path, expected);
    SCOPED_TRACE(std::to_string(c.least) + " texels, anisotropy " + std::to_string(c.anisotropy) + ": shading " +
                 std::to_string(of_shading.error) + " " + std::to_string(of_shading.contrast) + ", path " +
                 std::to_string(of_path.error) + " " + std::to_string(of_path.contrast));
    EXPECT_LT(of_shading.error, c.shading_error);
    EXPECT_GT(of_shading.contrast, c.shading_contrast);
    EXPECT_LT(of_shading.contrast, 1.1);
    EXPECT_LT(of_path.error, c.path_error);
    EXPECT_GT(of_path.contrast, c.path_contrast);
    EXPECT_LT(of_path.contrast, 1.12);
  }
}

// A pan by fractions of a texel: what is seen of a pixel changes as the truth does, without jumps.
TEST_F(TextureFilterTest, TextDoesNotFlickerWhenItMoves) {
  Scene scene;
  scene.textures = {textTexture()};
  scene.materials = {showing(textureNode(0))};
  const twin::Level level = twin::pyramid(scene.textures[0])[0];
  std::vector<TestPoint> pan;
  for (int i = 0; i < 600; ++i) {
    TestPoint p;
    p.st = {0.1f + 0.1f * float(i) / kSize, 0.37f};
    p.dstdx = {3.0f / kSize, 0}, p.dstdy = {0, 3.0f / kSize};
    pan.push_back(p);
  }
  const std::vector<ShadingInputs> values = PatternTest::evaluate(scene, pan);
  for (size_t i = 1; i < pan.size(); ++i) {
    const double step = values[i].diffuse_color.x - values[i - 1].diffuse_color.x;
    ASSERT_NEAR(step, truth(level, pan[i]) - truth(level, pan[i - 1]), 0.05) << i;
  }
}

}  // namespace
}  // namespace encore
