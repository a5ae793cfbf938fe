// core/pattern and shaders/pattern: textures agree with their twin, networks are generated for what varies only.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "core/pattern/patterns.h"
#include "core/pattern/texture_pyramid.h"
#include "core/scene/error.h"
#include "tests/core/twins/texture_twin.h"

namespace encore {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Numbers that are the same with every standard library.
class Random {
 public:
  explicit Random(uint32_t seed) : engine_(seed) {}
  float unit() { return float(engine_() >> 8) * 0x1p-24f; }
  float in(float low, float high) { return low + (high - low) * unit(); }
  uint32_t below(uint32_t n) { return uint32_t(engine_() % n); }

 private:
  std::mt19937 engine_;
};

Texture randomTexture(uint32_t width, uint32_t height, uint32_t seed) {
  Random random(seed);
  Texture texture{"texture" + std::to_string(seed) + ".exr", width, height, {}};
  for (uint32_t i = 0; i < width * height * 4; ++i) texture.rgba.push_back(random.in(-1, 3));
  return texture;
}

Texture constantTexture(uint32_t width, uint32_t height, std::array<float, 4> value) {
  Texture texture{"constant.exr", width, height, {}};
  for (uint32_t i = 0; i < width * height * 4; ++i) texture.rgba.push_back(value[i % 4]);
  return texture;
}

PatternNode textureNode(int32_t texture, WrapMode wrap_s = WrapMode::Repeat, WrapMode wrap_t = WrapMode::Repeat) {
  PatternNode node;
  node.path = "/looks/image" + std::to_string(texture);
  node.texture = texture;
  node.wrap_s = wrap_s;
  node.wrap_t = wrap_t;
  return node;
}

// A material whose diffuseColor is the node's rgb and whose emissiveColor is its gba: all channels show.
Material showing(const PatternNode& node) {
  Material material;
  material.path = "/looks/show";
  material.nodes = {node};
  material.diffuse_color.node = 0;
  material.emissive_color.node = 0;
  material.emissive_color.channel = 1;
  return material;
}

std::array<float, 4> shown(const ShadingInputs& value) {
  EXPECT_EQ(value.diffuse_color.y, value.emissive_color.x);
  EXPECT_EQ(value.diffuse_color.z, value.emissive_color.y);
  return {value.diffuse_color.x, value.diffuse_color.y, value.diffuse_color.z, value.emissive_color.z};
}

// st up to a few repeats away; footprints from a thousandth of the texture to several textures, any shape.
PatternPoint randomPoint(uint32_t material, Random& random) {
  PatternPoint point{};
  point.material = material;
  point.st = {random.in(-3, 3), random.in(-3, 3)};
  const float size = std::exp2(random.in(-11, 2)), ratio = std::exp2(random.in(-6, 0));
  float a = random.in(0, 6.3f), b = a + random.in(0.3f, 2.8f);
  if (random.below(4) == 0) a = 0.5f * kPi * float(random.below(4)), b = a + 0.5f * kPi;  // along the axes
  point.dstdx = {size * std::cos(a), size * std::sin(a)};
  point.dstdy = {size * ratio * std::cos(b), size * ratio * std::sin(b)};
  point.color = {random.unit(), random.unit(), random.unit()};
  return point;
}

// Texels are off by half of the last place of a half float; coordinates by a few times 2^-24 of the texture.
void expectLike(const std::array<float, 4>& found, const twin::Texel& expected, double largest,
                const std::string& what) {
  for (size_t c = 0; c < 4; ++c)
    ASSERT_NEAR(found[c], expected[c], largest * (0x1p-11 + 2e-4)) << what << " channel " << c;
}

class PatternTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { device = Device::create({.select = {}, .validation = true}); }
  static void TearDownTestSuite() { device.reset(); }

  static std::vector<ShadingInputs> evaluate(const Scene& scene, const std::vector<PatternPoint>& points) {
    Patterns patterns(*device, scene);
    std::vector<ShadingInputs> values(points.size());
    patterns.evaluateShading(points, values);
    return values;
  }
  static std::vector<PathInputs> evaluatePath(const Scene& scene, const std::vector<PatternPoint>& points) {
    Patterns patterns(*device, scene);
    std::vector<PathInputs> values(points.size());
    patterns.evaluatePath(points, values);
    return values;
  }

  static std::shared_ptr<Device> device;
};
std::shared_ptr<Device> PatternTest::device;

TEST(HalfFloats, RoundToNearestEven) {
  const auto decode = [](uint32_t half) {
    const int exponent = int(half >> 10), mantissa = int(half & 1023);
    return float(exponent == 0 ? std::ldexp(mantissa, -24) : std::ldexp(1024 + mantissa, exponent - 25));
  };
  for (uint32_t half = 0; half < 0x7bff; ++half) {
    const float value = decode(half), next = decode(half + 1), middle = 0.5f * (value + next);  // exact
    ASSERT_EQ(toHalf(value), half);
    ASSERT_EQ(toHalf(-value), half | 0x8000u);
    ASSERT_EQ(toHalf(middle), half & 1u ? half + 1 : half);
    ASSERT_EQ(toHalf(std::nextafter(middle, 0.0f)), half);
    ASSERT_EQ(toHalf(std::nextafter(middle, next)), half + 1);
  }
  for (float value : {65504.0f, 65520.0f, 1e30f, kInfinity}) {
    EXPECT_EQ(toHalf(value), 0x7bffu);
    EXPECT_EQ(toHalf(-value), 0xfbffu);
  }
  EXPECT_EQ(toHalf(kNan) & 0x7fffu, 0x7bffu);
}

TEST(Pyramid, LevelsEndAtOneTexel) {
  EXPECT_EQ(pyramidLevels(1, 1).size(), 1u);
  const std::vector<PyramidLevel> levels = pyramidLevels(257, 64);
  ASSERT_EQ(levels.size(), 9u);
  EXPECT_EQ(levels[1].width, 128u);
  EXPECT_EQ(levels[7].width, 2u);
  EXPECT_EQ(levels[7].height, 1u);
  EXPECT_EQ(levels[8].texels(), 1u);
}

TEST(Pyramid, AgreesWithTwinAndPreservesTheMean) {
  for (auto [width, height] : {std::pair{1u, 1u}, {5u, 3u}, {3u, 5u}, {257u, 64u}, {7u, 1u}, {1u, 9u}}) {
    const Texture texture = randomTexture(width, height, width * 1000 + height);
    const std::vector<PyramidLevel> sizes = pyramidLevels(width, height);
    std::vector<std::vector<uint16_t>> halves;
    for (PyramidLevel size : sizes) halves.emplace_back(size.texels() * 4);
    const std::vector<std::span<uint16_t>> spans(halves.begin(), halves.end());
    buildPyramid(texture, spans);

    const std::vector<twin::Level> expected = twin::pyramid(texture);
    ASSERT_EQ(expected.size(), sizes.size());
    const auto decode = [](uint16_t half) {
      const int exponent = (half >> 10) & 31, mantissa = half & 1023;
      const double magnitude = exponent == 0 ? std::ldexp(mantissa, -24) : std::ldexp(1024 + mantissa, exponent - 25);
      return half & 0x8000 ? -magnitude : magnitude;
    };
    double first_mean = 0;
    for (size_t level = 0; level < sizes.size(); ++level) {
      double mean = 0;
      for (size_t i = 0; i < halves[level].size(); ++i) {
        ASSERT_NEAR(decode(halves[level][i]), expected[level].texels[i / 4][i % 4], 3 * 0x1p-11 + 1e-5);
        mean += decode(halves[level][i]) / double(halves[level].size());
      }
      if (level == 0) first_mean = mean;
      EXPECT_NEAR(mean, first_mean, 1e-3) << width << " × " << height << " level " << level;
    }
  }
}

// Every size with every pair of wrap modes and several transforms, in one scene of 240 materials.
TEST_F(PatternTest, TexturesAgreeWithTwin) {
  constexpr std::array<float, 6> kTransforms[] = {
      {1, 0, 0, 0, 1, 0}, {0.5f, 0.2f, 0.1f, -0.3f, 1.5f, -0.7f}, {-1, 0, 1, 0, -2, 0.25f}};
  Scene scene;
  scene.textures = {randomTexture(1, 1, 1), randomTexture(5, 3, 2), randomTexture(257, 64, 3), randomTexture(64, 64, 4),
                    randomTexture(2, 33, 5)};
  for (int32_t t = 0; t < int32_t(scene.textures.size()); ++t)
    for (int wraps = 0; wraps < 16; ++wraps)
      for (const auto& transform : kTransforms) {
        PatternNode node = textureNode(t, WrapMode(wraps % 4), WrapMode(wraps / 4));
        node.st_transform = transform;
        scene.materials.push_back(showing(node));
      }
  std::vector<std::vector<twin::Level>> pyramids;
  for (const Texture& texture : scene.textures) pyramids.push_back(twin::pyramid(texture));

  Random random(11);
  std::vector<PatternPoint> points;
  for (uint32_t i = 0; i < 100 * scene.materials.size(); ++i)
    points.push_back(randomPoint(i % uint32_t(scene.materials.size()), random));
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  for (size_t i = 0; i < points.size(); ++i) {
    const PatternNode& node = scene.materials[points[i].material].nodes[0];
    const twin::Texel expected =
        twin::evaluate(pyramids[size_t(node.texture)], node, points[i].st, points[i].dstdx, points[i].dstdy);
    expectLike(shown(values[i]), expected, 3, "point " + std::to_string(i));
    if (HasFatalFailure()) return;
  }
}

TEST_F(PatternTest, TexelCentresAreExactAndTheFirstRowIsAtTheBottom) {
  Scene scene;
  scene.textures = {{"corners.exr", 2, 2, {1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0.5f, 0.25f, 0.125f, 0}}};
  scene.materials = {showing(textureNode(0))};
  std::vector<PatternPoint> points(4);
  for (int i = 0; i < 4; ++i) points[size_t(i)].st = {0.25f + 0.5f * float(i % 2), 0.25f + 0.5f * float(i / 2)};
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  for (size_t i = 0; i < 4; ++i)
    for (size_t c = 0; c < 4; ++c) EXPECT_EQ(shown(values[i])[c], scene.textures[0].rgba[i * 4 + c]) << i << " " << c;
}

TEST_F(PatternTest, ConstantTextureStaysConstantAtAllFootprints) {
  constexpr std::array<float, 4> kValue{0.18f, 1.5f, 100.0f, 0.7f};
  for (auto [width, height] : {std::pair{1u, 1u}, {5u, 3u}, {257u, 64u}}) {
    Scene scene;
    scene.textures = {constantTexture(width, height, kValue)};
    for (WrapMode wrap : {WrapMode::Clamp, WrapMode::Repeat, WrapMode::Mirror})
      scene.materials.push_back(showing(textureNode(0, wrap, wrap)));
    Random random(21);
    std::vector<PatternPoint> points;
    for (uint32_t i = 0; i < 3000; ++i) points.push_back(randomPoint(i % 3, random));
    for (const ShadingInputs& value : evaluate(scene, points))
      for (size_t c = 0; c < 4; ++c) ASSERT_NEAR(shown(value)[c], kValue[c], kValue[c] * (0x1p-11 + 1e-6));
  }
}

TEST_F(PatternTest, BlackIsZeroOutside) {
  Scene scene;
  scene.textures = {constantTexture(5, 3, {1, 1, 1, 1})};
  scene.materials = {showing(textureNode(0, WrapMode::Black, WrapMode::Black))};
  std::vector<PatternPoint> points(6);
  const Vec2f st[] = {{0.5f, 0.5f}, {-0.2f, 0.5f}, {0.5f, 1.3f}, {1e6f, 0.5f}, {-1e30f, 0.5f}, {0, 0.5f}};
  for (size_t i = 0; i < points.size(); ++i) points[i].st = st[i];
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  EXPECT_EQ(shown(values[0])[0], 1);
  for (size_t i = 1; i < 5; ++i) EXPECT_EQ(shown(values[i]), (std::array<float, 4>{})) << i;
  EXPECT_FLOAT_EQ(shown(values[5])[0], 0.5f);  // on the border, half of the lookup lies outside
}

// Black and white in turn: rows in red, columns in green. Eight texels per pixel along the rows and one across
// them must keep the rows and average the columns; then the other way round.
TEST_F(PatternTest, GrazingViewsDoNotBlur) {
  Scene scene;
  scene.textures = {{"stripes.exr", 64, 64, {}}};
  for (uint32_t i = 0; i < 64 * 64; ++i)
    for (float value : {float((i / 64) % 2), float(i % 2), 0.0f, 1.0f}) scene.textures[0].rgba.push_back(value);
  scene.materials = {showing(textureNode(0))};
  std::vector<PatternPoint> points(32);
  for (size_t i = 0; i < 16; ++i) {
    points[i].st = {30.5f / 64, (float(i) + 0.5f) / 64};
    points[i].dstdx = {8.0f / 64, 0};
    points[i].dstdy = {0, 1.0f / 64};
    points[i + 16].st = {points[i].st.y, points[i].st.x};
    points[i + 16].dstdx = {1.0f / 64, 0};
    points[i + 16].dstdy = {0, 8.0f / 64};
  }
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  for (size_t i = 0; i < 16; ++i) {
    EXPECT_NEAR(values[i].diffuse_color.x, float(i % 2), 1e-4);
    EXPECT_NEAR(values[i].diffuse_color.y, 0.5f, 1e-4);
    EXPECT_NEAR(values[i + 16].diffuse_color.x, 0.5f, 1e-4);
    EXPECT_NEAR(values[i + 16].diffuse_color.y, float(i % 2), 1e-4);
  }
}

TEST_F(PatternTest, LargeFootprintsGiveTheMean) {
  Scene scene;
  scene.textures = {randomTexture(257, 64, 8)};
  scene.materials = {showing(textureNode(0))};
  double mean = 0;
  for (size_t i = 0; i < scene.textures[0].rgba.size(); i += 4) mean += scene.textures[0].rgba[i] / (257.0 * 64);
  for (float size : {8.0f, 1e6f, 1e30f, kInfinity, kNan}) {
    PatternPoint point{};
    point.st = {0.3f, 0.8f};
    point.dstdx = {size, 0};
    point.dstdy = {0, size};
    EXPECT_NEAR(evaluate(scene, {point})[0].diffuse_color.x, mean, 2e-3) << size;
  }
}

TEST_F(PatternTest, StrangeCoordinatesGiveFiniteValues) {
  constexpr float kStrange[] = {0, -0.0f, 1e-30f, -1e-30f, 1e6f, -1e6f, 3e38f, -3e38f, kInfinity, -kInfinity, kNan};
  Scene scene;
  scene.textures = {randomTexture(5, 3, 9)};
  for (int wraps = 0; wraps < 4; ++wraps) {
    PatternNode node = textureNode(0, WrapMode(wraps), WrapMode(wraps));
    node.fallback = {0.25f, 0.5f, 0.75f, 1.5f};
    node.scale = {2, 2, 2, 2};
    scene.materials.push_back(showing(node));
  }
  std::vector<PatternPoint> points;
  for (uint32_t m = 0; m < 4; ++m)
    for (float s : kStrange)
      for (float t : kStrange)
        for (float d : kStrange) points.push_back({m, {s, t}, {d, 0.1f}, {s, d}, {0, 0, 0}});
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  for (size_t i = 0; i < points.size(); ++i) {
    const std::array<float, 4> value = shown(values[i]);
    if (!std::isfinite(points[i].st.x) || !std::isfinite(points[i].st.y)) {
      ASSERT_EQ(value, scene.materials[0].nodes[0].fallback) << i;  // as it is, without scale
    }
    for (float v : value) ASSERT_LE(std::abs(v), 6.01f) << i;  // NaN fails too
  }
}

TEST_F(PatternTest, ScaleAndBias) {
  Scene scene;
  scene.textures = {randomTexture(5, 3, 10)};
  PatternNode plain = textureNode(0), scaled = plain;
  scaled.scale = {2, -1, 0, 0.5f};
  scaled.bias = {-1, 0.5f, 3, 0};
  scene.materials = {showing(plain), showing(scaled)};
  Random random(31);
  std::vector<PatternPoint> points;
  for (uint32_t i = 0; i < 64; ++i) {
    points.push_back(randomPoint(0, random));
    points.push_back(points.back());
    points.back().material = 1;
  }
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  for (size_t i = 0; i < values.size(); i += 2)
    for (size_t c = 0; c < 4; ++c)
      EXPECT_NEAR(shown(values[i + 1])[c], shown(values[i])[c] * scaled.scale[c] + scaled.bias[c], 1e-5);
}

TEST_F(PatternTest, ChannelsOfNodes) {
  Scene scene;
  scene.textures = {{"channels.exr", 1, 1, {0.125f, 0.25f, 0.5f, 0.75f}}};
  Material material;
  material.nodes = {textureNode(0)};
  material.nodes.push_back({});
  material.nodes[1].kind = PatternNode::Kind::DisplayColor;
  material.diffuse_color.node = 1;
  material.emissive_color.node = 0;
  material.emissive_color.channel = 1;
  material.metallic = {0, 0, 1};
  material.roughness = {0, 0, 3};
  material.clearcoat = {0, 1, 2};
  material.clearcoat_roughness = {0, 0, 2};
  material.opacity = {0, 0, 0};
  material.ior = {1.25f};
  scene.materials = {{}, material};
  PatternPoint point{};
  point.material = 1;
  point.color = {0.1f, 0.2f, 0.3f};

  const ShadingInputs shading = evaluate(scene, {point})[0];
  EXPECT_EQ(shading.diffuse_color, point.color);
  EXPECT_EQ(shading.emissive_color, (Vec3f{0.25f, 0.5f, 0.75f}));
  const PathInputs path = evaluatePath(scene, {point})[0];
  EXPECT_EQ(path.base_color, point.color);  // metallic is not 0
  EXPECT_EQ(path.specular_color, (Vec3f{0, 0, 0}));
  EXPECT_EQ(path.metallic, 0.25f);
  EXPECT_EQ(path.roughness, 0.75f);
  EXPECT_EQ(path.clearcoat, 0.3f);
  EXPECT_EQ(path.clearcoat_roughness, 0.5f);
  EXPECT_EQ(path.opacity, 0.125f);
  EXPECT_EQ(path.ior, 1.25f);
}

TEST_F(PatternTest, ConstantsAreKeptToTheBit) {
  Scene scene;
  Material material;
  material.path = "/looks/ünusual \\\n*/path";
  material.nodes.resize(1);
  material.nodes[0].kind = PatternNode::Kind::DisplayColor;
  material.diffuse_color.node = 0;
  material.emissive_color.value = {-1.17549435e-38f, 3.4028235e38f, 0.1f};
  scene.materials = {material};
  EXPECT_EQ(evaluate(scene, {PatternPoint{}})[0].emissive_color, material.emissive_color.value);
}

TEST_F(PatternTest, ConstantsNeverDispatch) {
  Scene scene;
  Material material;
  material.diffuse_color.value = {0.1f, 0.2f, 0.3f};
  material.roughness.value = 0.7f;
  material.nodes = {textureNode(0)};  // present, but nothing reads it
  scene.textures = {randomTexture(5, 3, 12)};
  scene.materials = {material};
  device->resetTimings();
  Patterns patterns(*device, scene);
  EXPECT_FALSE(patterns.shadingVaries(0));
  EXPECT_FALSE(patterns.pathVaries(0));
  EXPECT_EQ(patterns.constantShading(0).diffuse_color, material.diffuse_color.value);
  EXPECT_EQ(patterns.constantPath(0).roughness, 0.7f);
  EXPECT_EQ(patterns.constantPath(0).ior, 1.5f);
  EXPECT_EQ(patterns.texcoordName(0), "");
  EXPECT_EQ(patterns.textureBytes(), 0u);
  patterns.evaluateShading({}, {});
  EXPECT_TRUE(device->timings().empty());
  EXPECT_TRUE(generatePatterns(scene).shading.empty());
  EXPECT_TRUE(generatePatterns(scene).path.empty());

  const PatternPoint point{};
  ShadingInputs value;
  EXPECT_THROW(patterns.evaluateShading({&point, 1}, {&value, 1}), Error);
  EXPECT_THROW(patterns.evaluateShading({&point, 1}, {}), Error);
}

TEST_F(PatternTest, MissingTextureIsTheFallback) {
  Scene scene;
  Material material;
  material.nodes = {textureNode(-1)};
  material.nodes[0].fallback = {0.1f, 0.2f, 0.3f, 0.4f};
  material.nodes[0].scale = {9, 9, 9, 9};
  material.diffuse_color.node = 0;
  material.roughness = {0, 0, 3};
  scene.materials = {material};
  const Patterns patterns(*device, scene);
  EXPECT_FALSE(patterns.shadingVaries(0));
  EXPECT_FALSE(patterns.pathVaries(0));
  EXPECT_EQ(patterns.constantShading(0).diffuse_color, (Vec3f{0.1f, 0.2f, 0.3f}));
  EXPECT_EQ(patterns.constantPath(0).roughness, 0.4f);
}

// What each part needs: metals need the base colour for the path, the workflows ignore each other's inputs.
TEST_F(PatternTest, PartsVaryOnlyWithWhatTheyNeed) {
  Scene scene;
  scene.textures = {randomTexture(2, 2, 13)};
  Material plain = showing(textureNode(0));
  Material metal = plain;
  metal.metallic.value = 0.5f;
  Material specular = metal;
  specular.use_specular_workflow = true;
  Material tinted = specular;
  tinted.specular_color.node = 0;
  Material ignored = tinted;
  ignored.use_specular_workflow = false;
  ignored.metallic.value = 0;
  scene.materials = {plain, metal, specular, tinted, ignored};
  scene.materials[1].nodes[0].texcoord = "uv";
  const Patterns patterns(*device, scene);
  constexpr bool kPathVaries[] = {false, true, false, true, false};
  for (int32_t m = 0; m < 5; ++m) {
    EXPECT_TRUE(patterns.shadingVaries(m));
    EXPECT_EQ(patterns.pathVaries(m), kPathVaries[m]) << m;
    EXPECT_EQ(patterns.texcoordName(m), m == 1 ? "uv" : "st");
  }
}

TEST_F(PatternTest, SourceHoldsOnlyWhatIsReachable) {
  Scene scene;
  scene.textures = {randomTexture(4, 4, 14), randomTexture(64, 64, 15), randomTexture(2, 2, 16)};
  Material material;
  material.path = "/looks/mixed";
  material.nodes = {textureNode(0), textureNode(1), textureNode(2)};
  material.diffuse_color.node = 0;
  material.roughness.node = 2;
  Material constant;
  constant.path = "/looks/constant";
  scene.materials = {constant, material};
  const PatternSource source = generatePatterns(scene);
  const auto contains = [](const std::string& text, const char* word) { return text.find(word) != std::string::npos; };
  EXPECT_TRUE(contains(source.shading, "/looks/image0") && contains(source.shading, "/looks/mixed"));
  EXPECT_FALSE(contains(source.shading, "/looks/image2"));
  EXPECT_TRUE(contains(source.path, "/looks/image2"));
  EXPECT_FALSE(contains(source.path, "/looks/image0"));
  for (const std::string& part : {source.shading, source.path}) {
    EXPECT_FALSE(contains(part, "/looks/image1"));
    EXPECT_FALSE(contains(part, "/looks/constant"));
    EXPECT_FALSE(compileGlsl(part, "part").empty());
  }
  // 4 × 4, 2 × 2 and 1 × 1; 2 × 2 and 1 × 1: 26 texels of 8 bytes, and 5 levels of 16 bytes. Not 64 × 64.
  EXPECT_EQ(Patterns(*device, scene).textureBytes(), 26u * 8 + 5 * 16);
}

// Fifty materials of all kinds, with constant ones between them, in one batch in random order.
TEST_F(PatternTest, MixtureOfFiftyMaterials) {
  Random random(41);
  Scene scene;
  std::vector<std::vector<twin::Level>> pyramids;
  for (uint32_t t = 0; t < 10; ++t) {
    scene.textures.push_back(randomTexture(1 + random.below(40), 1 + random.below(40), 100 + t));
    pyramids.push_back(twin::pyramid(scene.textures.back()));
  }
  for (uint32_t m = 0; m < 100; ++m) {
    Material material;
    material.emissive_color.value = {float(m), 0.5f, 0};
    if (m % 2) {
      material.nodes = {textureNode(int32_t(random.below(10)), WrapMode(random.below(4)), WrapMode(random.below(4))),
                        textureNode(int32_t(random.below(10)), WrapMode(random.below(4)), WrapMode(random.below(4)))};
      material.nodes.emplace_back().kind = PatternNode::Kind::DisplayColor;
      material.diffuse_color.node = int32_t(random.below(3));
      if (m % 3 == 0) material.emissive_color.node = int32_t(random.below(2));
    }
    scene.materials.push_back(material);
  }
  std::vector<PatternPoint> points;
  for (uint32_t i = 0; i < 20000; ++i) points.push_back(randomPoint(random.below(50) * 2 + 1, random));
  const std::vector<ShadingInputs> values = evaluate(scene, points);

  for (size_t i = 0; i < points.size(); ++i) {
    const Material& material = scene.materials[points[i].material];
    const auto check = [&](const Input<Vec3f>& input, Vec3f found) {
      if (input.constant() || material.nodes[size_t(input.node)].kind == PatternNode::Kind::DisplayColor) {
        ASSERT_EQ(found, input.constant() ? input.value : points[i].color) << i;
        return;
      }
      const PatternNode& node = material.nodes[size_t(input.node)];
      const twin::Texel expected =
          twin::evaluate(pyramids[size_t(node.texture)], node, points[i].st, points[i].dstdx, points[i].dstdy);
      expectLike({found.x, found.y, found.z, float(expected[3])}, expected, 3, "point " + std::to_string(i));
    };
    check(material.diffuse_color, values[i].diffuse_color);
    check(material.emissive_color, values[i].emissive_color);
    if (HasFatalFailure()) return;
  }
}

TEST_F(PatternTest, BatchesOfAnySizeTakeOneDispatchEach) {
  Scene scene;
  scene.textures = {randomTexture(5, 3, 17)};
  scene.materials = {showing(textureNode(0))};
  Random random(51);
  std::vector<PatternPoint> points;
  for (uint32_t i = 0; i < 100000; ++i) points.push_back(randomPoint(0, random));
  const std::vector<ShadingInputs> all = evaluate(scene, points);

  Patterns patterns(*device, scene);
  device->resetTimings();
  uint64_t batches = 0;
  for (size_t size : {1u, 63u, 64u, 65u, 5000u, 100000u, 1u}) {
    std::vector<ShadingInputs> values(size);
    patterns.evaluateShading({points.data(), size}, values);
    EXPECT_EQ(device->timings().at("pattern_shading").dispatches, ++batches);
    for (size_t i = 0; i < size; ++i) ASSERT_EQ(values[i].diffuse_color, all[i].diffuse_color) << size << " " << i;
  }
}

TEST(CompileGlsl, ReportsNameAndLog) {
  const auto message = [](const std::string& source) -> std::string {
    try {
      compileGlsl(source, "broken_shader");
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::Internal);
      return error.what();
    }
    return "nothing thrown";
  };
  const std::string undeclared = message("#version 460\nvoid main() {\n  no_such_name = 1;\n}\n");
  EXPECT_NE(undeclared.find("broken_shader:3"), std::string::npos) << undeclared;
  EXPECT_NE(undeclared.find("no_such_name"), std::string::npos) << undeclared;
  const std::string include = message(
      "#version 460\n#extension GL_GOOGLE_include_directive : require\n#include \"no_such_file.h\"\nvoid main() {}\n");
  EXPECT_NE(include.find("no_such_file.h"), std::string::npos) << include;
  const std::string no_entry = message("#version 460\nlayout(local_size_x = 1) in;\n");
  EXPECT_NE(no_entry.find("broken_shader"), std::string::npos) << no_entry;
}

TEST(CompileGlsl, IsThreadSafeAndRepeatable) {
  const std::string source = "#version 460\nlayout(local_size_x = 1) in;\nvoid main() {}\n";
  const std::vector<uint32_t> expected = compileGlsl(source, "empty");
  ASSERT_FALSE(expected.empty());
  std::vector<std::vector<uint32_t>> results(8);
  {
    std::vector<std::jthread> threads;
    for (auto& result : results) threads.emplace_back([&] { result = compileGlsl(source, "empty"); });
  }
  for (const auto& result : results) EXPECT_EQ(result, expected);
}

}  // namespace
}  // namespace encore
