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
#include "tests/core/pattern_world.h"
#include "tests/core/twins/texture_twin.h"

namespace encore {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Texels are off by half of the last place of a half float; coordinates by a few times 2^-24 of the texture.
void expectLike(const std::array<float, 4>& found, const twin::Texel& expected, double largest,
                const std::string& what) {
  for (size_t c = 0; c < 4; ++c)
    ASSERT_NEAR(found[c], expected[c], largest * (0x1p-11 + 2e-4)) << what << " channel " << c;
}

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
  std::vector<TestPoint> points;
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
  scene.textures = {makeTexture("corners.exr", 2, 2, {1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 1, 0.5f, 0.25f, 0.125f, 0})};
  scene.materials = {showing(textureNode(0))};
  std::vector<TestPoint> points(4);
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
    std::vector<TestPoint> points;
    for (uint32_t i = 0; i < 3000; ++i) points.push_back(randomPoint(i % 3, random));
    for (const ShadingInputs& value : evaluate(scene, points))
      for (size_t c = 0; c < 4; ++c) ASSERT_NEAR(shown(value)[c], kValue[c], kValue[c] * (0x1p-11 + 1e-6));
  }
}

TEST_F(PatternTest, BlackIsZeroOutside) {
  Scene scene;
  scene.textures = {constantTexture(5, 3, {1, 1, 1, 1})};
  scene.materials = {showing(textureNode(0, WrapMode::Black, WrapMode::Black))};
  std::vector<TestPoint> points(6);
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
  scene.textures = {makeTexture("stripes.exr", 64, 64)};
  for (uint32_t i = 0; i < 64 * 64; ++i)
    for (float value : {float((i / 64) % 2), float(i % 2), 0.0f, 1.0f}) scene.textures[0].rgba.push_back(value);
  scene.materials = {showing(textureNode(0))};
  std::vector<TestPoint> points(32);
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
    TestPoint point;
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
  std::vector<TestPoint> points;
  for (uint32_t m = 0; m < 4; ++m)
    for (float s : kStrange)
      for (float t : kStrange)
        for (float d : kStrange)
          points.push_back({.material = m, .st = {s, t}, .dstdx = {d, 0.1f}, .dstdy = {s, d}, .color = {}});
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
  std::vector<TestPoint> points;
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
  scene.textures = {makeTexture("channels.exr", 1, 1, {0.125f, 0.25f, 0.5f, 0.75f})};
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
  TestPoint point;
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
  EXPECT_EQ(evaluate(scene, {TestPoint{}})[0].emissive_color, material.emissive_color.value);
}

TEST_F(PatternTest, ConstantsNeverDispatch) {
  Scene scene;
  Material material;
  material.diffuse_color.value = {0.1f, 0.2f, 0.3f};
  material.roughness.value = 0.7f;
  material.opacity.value = 0.25f;
  material.displacement.value = 0.5f;
  material.nodes = {textureNode(0)};  // present, but nothing reads it
  scene.textures = {randomTexture(5, 3, 12)};
  scene.materials = {material};
  device->resetTimings();
  Patterns patterns(*device, scene);
  for (uint32_t part = 0; part < kPatternParts; ++part) {
    EXPECT_FALSE(patterns.varies(PatternPart(part), 0)) << part;
    EXPECT_EQ(patterns.layout(PatternPart(part), 0).size, 0u);
    EXPECT_TRUE(generatePatterns(scene).parts[part].empty());
  }
  EXPECT_EQ(patterns.constantShading(0).diffuse_color, material.diffuse_color.value);
  EXPECT_EQ(patterns.constantPath(0).roughness, 0.7f);
  EXPECT_EQ(patterns.constantPath(0).ior, 1.5f);
  EXPECT_EQ(patterns.constantPath(0).opacity, 0.25f);
  EXPECT_EQ(patterns.constantPath(0).normal, (Vec3f{0, 0, 1}));
  EXPECT_EQ(patterns.constantOpacity(0), 0.25f);
  EXPECT_EQ(patterns.constantDisplacement(0).along_normal, 0.5f);
  EXPECT_EQ(patterns.constantDisplacement(0).offset, Vec3f{});
  EXPECT_EQ(patterns.normalTexcoord(0), "");
  EXPECT_FALSE(patterns.readsTextures());
  EXPECT_EQ(patterns.textureBytes(), 0u);
  patterns.evaluate({}, std::span<ShadingInputs>());
  EXPECT_TRUE(device->timings().empty());

  PatternPoints points;
  points.point.push_back({0, 0});
  std::vector<ShadingInputs> values(1);
  EXPECT_THROW(patterns.evaluate(points, std::span<ShadingInputs>(values)), Error);
  EXPECT_THROW(patterns.evaluate(points, std::span<ShadingInputs>()), Error);
  points.point[0].material = 7;
  EXPECT_THROW(patterns.evaluate(points, std::span<ShadingInputs>(values)), Error);
}

TEST_F(PatternTest, PointsNeedTheirData) {
  Scene scene;
  scene.textures = {randomTexture(5, 3, 12)};
  scene.materials = {showing(textureNode(0))};
  Patterns patterns(*device, scene);
  PatternPoints points = pack(patterns, PatternPart::Shading, {TestPoint{}});
  ASSERT_EQ(points.data.size(), 6u);
  points.data.pop_back();
  std::vector<ShadingInputs> values(1);
  EXPECT_THROW(patterns.evaluate(points, std::span<ShadingInputs>(values)), Error);
}

TEST_F(PatternTest, AppendedPointsKeepTheirData) {
  Scene scene;
  Material material;
  material.nodes.resize(1);
  material.nodes[0].kind = PatternNode::Kind::DisplayColor;
  material.diffuse_color.node = 0;
  scene.materials = {material};
  Patterns patterns(*device, scene);
  std::vector<TestPoint> a(3), b(2);
  for (size_t i = 0; i < 5; ++i) (i < 3 ? a[i] : b[i - 3]).color = {float(i), 1, 2};
  PatternPoints points = pack(patterns, PatternPart::Shading, a);
  points.append(pack(patterns, PatternPart::Shading, b));
  std::vector<ShadingInputs> values(5);
  patterns.evaluate(points, std::span<ShadingInputs>(values));
  for (size_t i = 0; i < 5; ++i) EXPECT_EQ(values[i].diffuse_color, (Vec3f{float(i), 1, 2}));
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
  EXPECT_FALSE(patterns.varies(PatternPart::Shading, 0));
  EXPECT_FALSE(patterns.varies(PatternPart::Path, 0));
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
    EXPECT_TRUE(patterns.varies(PatternPart::Shading, m));
    EXPECT_EQ(patterns.varies(PatternPart::Path, m), kPathVaries[m]) << m;
    EXPECT_EQ(patterns.layout(PatternPart::Shading, m).slots[0].name, m == 1 ? "uv" : "st");
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
  ASSERT_EQ(source.parts[0].size(), 1u);
  ASSERT_EQ(source.parts[1].size(), 1u);
  EXPECT_TRUE(source.parts[2].empty() && source.parts[3].empty());
  const std::string &shading = source.parts[0][0].source, &path = source.parts[1][0].source;
  const auto contains = [](const std::string& text, const char* word) { return text.find(word) != std::string::npos; };
  for (const std::string& part : {shading, path}) {
    EXPECT_TRUE(contains(part, "/looks/mixed") && contains(part, "TEXTURE_SLOTS 1"));
    EXPECT_FALSE(contains(part, "/looks/constant"));
    EXPECT_FALSE(compileGlsl(part, "part").empty());
  }
  EXPECT_EQ(source.parts[0][0].materials, std::vector<uint32_t>{1});

  // 4 × 4 and 2 × 2: their levels, not those of 64 × 64. Nothing is there before somebody asks, then what was asked
  // for: one level of the first, and all (two) of the other. Tables: 5 levels, 2 tiles, 6 marks, one record.
  constexpr uint64_t kTables = 5 * 16 + 2 * 16 + 6 * 4 + 32;
  Patterns patterns(*device, scene);
  EXPECT_EQ(patterns.textureBytes(), kTables);
  evaluate<ShadingInputs>(patterns, PatternPart::Shading, {{.material = 1, .dstdx = {9, 0}, .dstdy = {0, 9}}});
  EXPECT_EQ(patterns.textureBytes(), kTables + 8);
  evaluate<PathInputs>(patterns, PatternPart::Path, {{.material = 1}});
  EXPECT_EQ(patterns.textureBytes(), kTables + 8 + 5 * 8);
  EXPECT_EQ(patterns.peakTextureBytes(), kTables + 8 + 5 * 8);
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
  std::vector<TestPoint> points;
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
  std::vector<TestPoint> points;
  for (uint32_t i = 0; i < 100000; ++i) points.push_back(randomPoint(0, random));
  const std::vector<ShadingInputs> all = evaluate(scene, points);

  Patterns patterns(*device, scene);
  evaluate<ShadingInputs>(patterns, PatternPart::Shading, {TestPoint{}});  // every level is there after this
  device->resetTimings();
  uint64_t batches = 0;
  for (size_t size : {1u, 63u, 64u, 65u, 5000u, 100000u, 1u}) {
    const std::vector<ShadingInputs> values =
        evaluate<ShadingInputs>(patterns, PatternPart::Shading, {points.begin(), points.begin() + long(size)});
    EXPECT_EQ(device->timings().at("pattern_shading").dispatches, ++batches);
    for (size_t i = 0; i < size; ++i) ASSERT_EQ(values[i].diffuse_color, all[i].diffuse_color) << size << " " << i;
  }
}

// One material reads two sets of coordinates, a primvar and the colour.
TEST_F(PatternTest, NetworksReadWhatTheyName) {
  Scene scene;
  scene.textures = {randomTexture(64, 64, 18)};
  Material material;
  material.nodes = {textureNode(0), textureNode(0)};
  material.nodes[1].texcoord = "uv";
  material.nodes.resize(3);
  material.nodes[2].kind = PatternNode::Kind::Primvar;
  material.nodes[2].primvar = "wear";
  material.nodes[2].fallback = {0.5f, 0.25f, 0.125f, 0.75f};
  material.diffuse_color.node = 0;
  material.emissive_color.node = 1;
  material.specular_color.node = 2;
  material.use_specular_workflow = true;
  material.roughness = {0, 2, 3};
  material.normal.node = 1;
  material.opacity = {0, 2, 2};
  material.displacement = {0, 1, 1};
  scene.materials = {material};
  const std::vector<twin::Level> pyramid = twin::pyramid(scene.textures[0]);
  Patterns patterns(*device, scene);
  EXPECT_EQ(patterns.normalTexcoord(0), "uv");
  EXPECT_TRUE(patterns.readsTextures());
  Random random(61);
  std::vector<TestPoint> points;
  for (uint32_t i = 0; i < 200; ++i) points.push_back(randomPoint(0, random));
  const auto shading = evaluate<ShadingInputs>(patterns, PatternPart::Shading, points);
  const auto path = evaluate<PathInputs>(patterns, PatternPart::Path, points);
  const auto opacity = evaluate<OpacityInputs>(patterns, PatternPart::Opacity, points);
  const auto displacement = evaluate<DisplacementInputs>(patterns, PatternPart::Displacement, points);
  for (size_t i = 0; i < points.size(); ++i) {
    const TestPoint& p = points[i];
    const auto swapped = [](Vec2f v) { return Vec2f{v.y, v.x}; };
    const twin::Texel st = twin::evaluate(pyramid, material.nodes[0], p.st, p.dstdx, p.dstdy);
    const twin::Texel uv =
        twin::evaluate(pyramid, material.nodes[1], swapped(p.st), swapped(p.dstdx), swapped(p.dstdy));
    const auto expectColor = [&](Vec3f found, const twin::Texel& expected) {
      expectLike({found.x, found.y, found.z, float(expected[3])}, expected, 3, "point " + std::to_string(i));
    };
    expectColor(shading[i].diffuse_color, st);
    expectColor(shading[i].emissive_color, uv);
    expectColor(path[i].normal, twin::evaluate(pyramid, material.nodes[1], swapped(p.st), swapped(p.dstdx),
                                               swapped(p.dstdy), twin::kPathFilter));
    EXPECT_EQ(path[i].specular_color, p.color + (Vec3f{0.5f, 0.25f, 0.125f}));
    EXPECT_EQ(path[i].roughness, 0.75f);
    EXPECT_NEAR(path[i].opacity, p.color.z + 0.125f, 1e-6);
    EXPECT_EQ(opacity[i].opacity, path[i].opacity);
    EXPECT_NEAR(displacement[i].along_normal, uv[1], 3 * (0x1p-11 + 2e-4));
    EXPECT_EQ(displacement[i].offset, Vec3f{});
  }
}

TEST_F(PatternTest, NormalsOfMaterials) {
  Scene scene;
  scene.textures = {randomTexture(4, 4, 19)};
  Material mapped, tilted, fallback;
  mapped.nodes = {textureNode(0)};
  mapped.nodes[0].texcoord = "map";
  mapped.normal.node = 0;
  tilted.normal.value = {0.6f, 0, 0.8f};
  fallback.nodes = {textureNode(-1)};
  fallback.nodes[0].fallback = {0, 0, 1, 1};
  fallback.normal.node = 0;
  scene.materials = {{}, mapped, tilted, fallback};
  const Patterns patterns(*device, scene);
  EXPECT_EQ(patterns.normalTexcoord(0), "");
  EXPECT_EQ(patterns.normalTexcoord(1), "map");
  EXPECT_EQ(patterns.normalTexcoord(2), "st");
  EXPECT_EQ(patterns.normalTexcoord(3), "");
  EXPECT_TRUE(patterns.varies(PatternPart::Path, 1));
  EXPECT_FALSE(patterns.varies(PatternPart::Path, 2) || patterns.varies(PatternPart::Path, 3));
  EXPECT_EQ(patterns.constantPath(2).normal, tilted.normal.value);
}

// Three columns and two rows of tiles, of different sizes; the middle of the upper row and what lies beyond are
// missing.
TEST_F(PatternTest, UdimTilesAgreeWithTwin) {
  Scene scene;
  std::vector<std::vector<twin::Level>> pyramids;
  for (uint32_t t = 0; t < 5; ++t) {
    scene.textures.push_back(randomTexture(3 + 13 * t, 40 - 9 * t, 200 + t));
    pyramids.push_back(twin::pyramid(scene.textures.back()));
  }
  PatternNode node = textureNode(-1, WrapMode::Repeat, WrapMode::Black);  // which have no meaning here
  node.udim.assign(13, -1);
  node.udim[0] = 0, node.udim[1] = 1, node.udim[2] = 2, node.udim[10] = 3, node.udim[12] = 4;
  node.fallback = {0.25f, 0.5f, 0.75f, 1.5f};
  node.scale = {2, 2, 2, 2};
  scene.materials = {showing(node)};
  Random random(71);
  std::vector<TestPoint> points;
  for (uint32_t i = 0; i < 5000; ++i) {
    points.push_back(randomPoint(0, random));
    points.back().st = {random.in(-0.5f, 4.0f), random.in(-0.5f, 2.5f)};
    if (i % 10 == 0) points.back().st.x = float(random.below(5));
    if (i % 15 == 0) points.back().st.y = float(random.below(4));
  }
  points[0].st = {3, 0.5f};  // the last tile's right edge
  points[1].st = {0.5f, 2};  // the upper edge of the upper row
  points[2].st = {1, 1.5f};  // its first tile's right edge: the tile beyond is missing
  points[3].st = {2, 2};     // on both, at a corner that no tile touches with its lower left
  points[4].st = {1e30f, 0.5f};
  points[5].st = {kNan, 0.5f};
  const std::vector<ShadingInputs> values = evaluate(scene, points);
  size_t inside = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const int32_t tile = std::isfinite(points[i].st.x) ? twin::udimTile(node, points[i].st) : -1;
    if (tile < 0) {
      EXPECT_EQ(shown(values[i]), node.fallback) << i;
      continue;
    }
    ++inside;
    const twin::Texel expected = twin::evaluateUdim(pyramids[size_t(node.udim[size_t(tile)])], node, tile, points[i].st,
                                                    points[i].dstdx, points[i].dstdy);
    expectLike(shown(values[i]), expected, 6, "point " + std::to_string(i));
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(inside, 1500u);
  EXPECT_EQ(twin::udimTile(node, points[0].st), 2);
  EXPECT_EQ(twin::udimTile(node, points[1].st), 10);
  EXPECT_EQ(twin::udimTile(node, points[2].st), 10);
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
