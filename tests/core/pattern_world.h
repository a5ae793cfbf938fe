// What tests of patterns share: random numbers, textures, and points with all that a layout can ask for.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "core/pattern/patterns.h"

namespace encore {

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

inline Texture makeTexture(const std::string& path, uint32_t width, uint32_t height, std::vector<float> rgba = {}) {
  Texture texture;
  texture.path = path;
  texture.width = width, texture.height = height;
  texture.rgba = std::move(rgba);
  return texture;
}

inline Texture randomTexture(uint32_t width, uint32_t height, uint32_t seed) {
  Random random(seed);
  Texture texture = makeTexture("texture" + std::to_string(seed) + ".exr", width, height);
  for (uint32_t i = 0; i < width * height * 4; ++i) texture.rgba.push_back(random.in(-1, 3));
  return texture;
}

inline Texture constantTexture(uint32_t width, uint32_t height, std::array<float, 4> value) {
  Texture texture = makeTexture("constant.exr", width, height);
  for (uint32_t i = 0; i < width * height * 4; ++i) texture.rgba.push_back(value[i % 4]);
  return texture;
}

inline PatternNode textureNode(int32_t texture, WrapMode wrap_s = WrapMode::Repeat,
                               WrapMode wrap_t = WrapMode::Repeat) {
  PatternNode node;
  node.path = "/looks/image" + std::to_string(texture);
  node.texture = texture;
  node.wrap_s = wrap_s;
  node.wrap_t = wrap_t;
  return node;
}

// A material whose diffuseColor is the node's rgb and whose emissiveColor is its gba: all channels show.
inline Material showing(const PatternNode& node) {
  Material material;
  material.path = "/looks/show";
  material.nodes = {node};
  material.diffuse_color.node = 0;
  material.emissive_color.node = 0;
  material.emissive_color.channel = 1;
  return material;
}

inline std::array<float, 4> shown(const ShadingInputs& value) {
  EXPECT_EQ(value.diffuse_color.y, value.emissive_color.x);
  EXPECT_EQ(value.diffuse_color.z, value.emissive_color.y);
  return {value.diffuse_color.x, value.diffuse_color.y, value.diffuse_color.z, value.emissive_color.z};
}

struct TestPoint {
  uint32_t material = 0;
  Vec2f st{}, dstdx{}, dstdy{};  // of all texture coordinates but "uv", which are these in reverse
  Vec3f color{};
  Vec3f position{1, 2, 3}, object_position{4, 5, 6}, normal{0, 0, 1};
  Vec2f uv{0.25f, 0.75f};
};

// Every primvar is its fallback plus the colour.
inline PatternPoints pack(const Patterns& patterns, PatternPart part, const std::vector<TestPoint>& from) {
  PatternPoints points;
  std::vector<float>& data = points.data;
  for (const TestPoint& p : from) {
    points.point.push_back({p.material, uint32_t(data.size())});
    for (const PointSlot& slot : patterns.layout(part, int32_t(p.material)).slots) {
      const auto add = [&](Vec3f v) { data.insert(data.end(), {v.x, v.y, v.z}); };
      const auto add2 = [&](Vec2f v) {
        slot.name == "uv" ? data.insert(data.end(), {v.y, v.x}) : data.insert(data.end(), {v.x, v.y});
      };
      const auto& f = slot.fallback;
      switch (slot.kind) {
        case PointSlot::Kind::Texcoord:
          add2(p.st), add2(p.dstdx), add2(p.dstdy);
          break;
        case PointSlot::Kind::DisplayColor:
          add(p.color);
          break;
        case PointSlot::Kind::Primvar:
          data.insert(data.end(), {f[0] + p.color.x, f[1] + p.color.y, f[2] + p.color.z, f[3]});
          break;
        case PointSlot::Kind::Position:
          add(p.position);
          break;
        case PointSlot::Kind::ObjectPosition:
          add(p.object_position);
          break;
        case PointSlot::Kind::Normal:
          add(p.normal);
          break;
        case PointSlot::Kind::Parameter:
          data.insert(data.end(), {p.uv.x, p.uv.y});
          break;
      }
    }
  }
  return points;
}

// st up to a few repeats away; footprints from a thousandth of the texture to several textures, any shape.
inline TestPoint randomPoint(uint32_t material, Random& random) {
  TestPoint point;
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

class PatternTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { device = Device::create({.select = {}, .validation = true}); }
  static void TearDownTestSuite() { device.reset(); }

  template <class Outputs>
  static std::vector<Outputs> evaluate(Patterns& patterns, PatternPart part, const std::vector<TestPoint>& points) {
    std::vector<Outputs> values(points.size());
    patterns.evaluate(pack(patterns, part, points), std::span<Outputs>(values));
    return values;
  }
  static std::vector<ShadingInputs> evaluate(const Scene& scene, const std::vector<TestPoint>& points) {
    Patterns patterns(*device, scene);
    return evaluate<ShadingInputs>(patterns, PatternPart::Shading, points);
  }
  static std::vector<PathInputs> evaluatePath(const Scene& scene, const std::vector<TestPoint>& points) {
    Patterns patterns(*device, scene);
    return evaluate<PathInputs>(patterns, PatternPart::Path, points);
  }

  static inline std::shared_ptr<Device> device;
};

}  // namespace encore
