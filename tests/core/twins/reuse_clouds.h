// Shading samples and queries that are easy, or hard, for trees and their search.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "core/reuse/reuse.h"
#include "tests/core/twins/trees_twin.h"

namespace encore::twin {

struct Cloud {
  std::string name;
  Samples samples;
};

// How footprints are given to samples.
enum class Footprints { kEqual, kSmooth, kTwoSizes, kFewLarge, kWide, kOdd };
inline constexpr Footprints kAllFootprints[] = {Footprints::kEqual,    Footprints::kSmooth, Footprints::kTwoSizes,
                                                Footprints::kFewLarge, Footprints::kWide,   Footprints::kOdd};

class CloudMaker {
 public:
  explicit CloudMaker(uint32_t seed) : random_(seed) {}

  uint32_t word() { return uint32_t(random_()); }
  uint32_t below(uint32_t n) { return uint32_t(word() % n); }
  float unit() { return float(word() >> 8) * 0x1p-24f; }
  Vec2f uv() { return {unit(), unit()}; }

  Cloud onOnePrimitive(uint32_t count) {
    Cloud cloud{std::to_string(count) + " samples on one primitive", {}};
    for (uint32_t i = 0; i < count; ++i) cloud.samples.add({3, 14}, uv());
    return cloud;
  }

  // Up to 12 samples on each of many primitives of a few instances, in random order.
  Cloud onManyPrimitives(uint32_t primitives) {
    Cloud cloud{std::to_string(primitives) + " primitives", {}};
    for (uint32_t i = 0; i < 6 * primitives; ++i) cloud.samples.add({below(3), below(primitives / 3)}, uv());
    return cloud;
  }

  // Equal; growing over the primitive; two sizes a factor of 64 apart, half and half or 1 in 100; from 2^-40 to 2^10;
  // at and beyond the ends of the range, and no numbers.
  void giveFootprints(Samples& samples, Footprints kind) {
    for (size_t i = 0; i < samples.keys.size(); ++i) samples.footprints[i] = footprint(kind, samples.uv[i]);
  }

  // f(i) gives the place of sample i of `count`.
  template <class F>
  Cloud placed(const std::string& name, uint32_t count, F&& f) {
    Cloud cloud{name, {}};
    for (uint32_t i = 0; i < count; ++i) cloud.samples.add({0, 0}, f(i));
    return cloud;
  }

  std::vector<Cloud> hardShapes(uint32_t count) {
    const auto cube = [](float x) { return x * x * x; };
    return {
        placed("all at one point", count, [](uint32_t) { return Vec2f{0.3f, 0.7f}; }),
        placed("all at one corner", count, [](uint32_t) { return Vec2f{1, 0}; }),
        placed("line of constant u", count, [&](uint32_t) { return Vec2f{0.25f, unit()}; }),
        placed("line of constant v", count, [&](uint32_t) { return Vec2f{unit(), 0.75f}; }),
        placed("diagonal", count,
               [&](uint32_t) {
                 const float t = unit();
                 return Vec2f{t, t};
               }),
        placed("cross", count, [&](uint32_t i) { return i % 2 ? Vec2f{0.5f, unit()} : Vec2f{unit(), 0.5f}; }),
        placed("borders", count, [&](uint32_t) { return Vec2f{float(below(2)), float(below(3)) / 2}; }),
        placed("border lines", count,
               [&](uint32_t i) { return i % 2 ? Vec2f{float(below(2)), unit()} : Vec2f{unit(), float(below(2))}; }),
        placed("uneven", count, [&](uint32_t) { return Vec2f{cube(cube(unit())), cube(unit())}; }),
        placed("thin", count, [&](uint32_t) { return Vec2f{unit(), unit() * 1e-5f}; }),
        placed("tiny", count, [&](uint32_t) { return Vec2f{0.5f + unit() * 1e-6f, unit() * 1e-6f}; }),
        placed("regular grid", count, [&](uint32_t i) { return Vec2f{float(i * 7 % 32) / 32, float(i % 31) / 32}; }),
        placed("few places", count, [&](uint32_t) { return Vec2f{float(below(4)) / 4, float(below(5)) / 8}; }),
        placed("circle", count,
               [&](uint32_t) {
                 const float t = 6.2831853f * unit();
                 return Vec2f{0.5f + 0.4f * std::cos(t), 0.5f + 0.4f * std::sin(t)};
               }),
    };
  }

  // Keys at the ends of their range; coordinates outside the unit square, and no numbers.
  Cloud extremes(uint32_t count) {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
    const float odd[] = {kNan, -kNan, kInf, -kInf, -0.0f, -1e-7f, 1 + 1e-6f, -3, 7, 0, 1};
    const uint32_t instances[] = {0, 1, 0x7fffffffu, 0x80000000u, 0xfffffffeu};
    const uint32_t primitives[] = {0, 1, 0x7fffffffu, 0xfffffffeu, 0xffffffffu};
    Cloud cloud{"extremes", {}};
    for (uint32_t i = 0; i < count; ++i) {
      const Vec2f at{below(3) ? unit() : odd[below(11)], below(3) ? unit() : odd[below(11)]};
      cloud.samples.add({instances[below(5)], primitives[below(5)]}, at);
    }
    return cloud;
  }

  // Primitives of all sizes from 1 to `largest` samples.
  Cloud mixture(uint32_t largest) {
    Cloud cloud{"mixture", {}};
    for (uint32_t size = 1, primitive = 0; size <= largest; size += 1 + size / 3, ++primitive) {
      const float scale = std::pow(10.0f, -float(below(5)));
      for (uint32_t i = 0; i < size; ++i) cloud.samples.add({below(2), primitive}, {unit() * scale, unit()});
    }
    for (size_t i = cloud.samples.keys.size(); i-- > 1;) {
      const size_t j = word() % (i + 1);
      std::swap(cloud.samples.keys[i], cloud.samples.keys[j]);
      std::swap(cloud.samples.uv[i], cloud.samples.uv[j]);
      std::swap(cloud.samples.footprints[i], cloud.samples.footprints[j]);
    }
    return cloud;
  }

  // Queries on the cloud's keys: anywhere, near samples, at samples, half way between two, on borders, no
  // numbers; a few on keys without samples and on none. coherent: in runs on one primitive, close together.
  Samples queries(const Samples& samples, uint32_t count, bool coherent) {
    Samples made;
    const uint32_t n = uint32_t(samples.keys.size());
    while (made.keys.size() < count) {
      const uint32_t run = coherent ? 1 + below(60) : 1;
      const uint32_t near = n == 0 ? 0 : below(n);
      const SurfaceKey key = n == 0 ? SurfaceKey{1, 2} : samples.keys[near];
      const Vec2f centre = n == 0 ? uv() : inUnitSquare(samples.uv[near]);
      for (uint32_t i = 0; i < run && made.keys.size() < count; ++i) {
        const uint32_t kind = below(40);
        if (kind == 0) made.add({kNoInstance, word()}, uv());
        if (kind == 1) made.add({key.instance, key.primitive_side ^ 0x40000000u}, uv());
        if (kind > 1) made.add(key, queryPlace(samples, centre, coherent));
      }
    }
    return made;
  }

 private:
  float footprint(Footprints kind, Vec2f at) {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
    const float odd[] = {kNan,   -kNan,    kInf,   -kInf,  0,       -0.0f, -1,      1e-40f,
                         1e-30f, 0x1p-60f, 1e-17f, 0.001f, 0x1p60f, 1e30f, 3.4e38f, 0x1.8p-61f};
    switch (kind) {
      case Footprints::kEqual:
        return 0.01f;
      case Footprints::kSmooth:
        return 0.001f + 0.1f * inUnitSquare(at).x * inUnitSquare(at).y;
      case Footprints::kTwoSizes:
        return (below(2) ? 0.001f : 0.064f) * (1 + 0.25f * unit());
      case Footprints::kFewLarge:
        return (below(100) ? 0.001f : 0.064f) * (1 + 0.25f * unit());
      case Footprints::kWide:
        return std::exp2(50 * unit() - 40);
      case Footprints::kOdd:
        return odd[below(16)];
    }
    return 0;
  }

  Vec2f queryPlace(const Samples& samples, Vec2f centre, bool coherent) {
    const uint32_t n = uint32_t(samples.keys.size());
    const uint32_t kind = below(20);
    if (n == 0 || kind == 0) return uv();
    if (kind == 1) return {float(below(3)) / 2, float(below(3)) / 2};
    if (kind == 2) return {std::numeric_limits<float>::quiet_NaN(), unit()};
    if (kind == 3) return centre;
    if (kind == 4) return 0.5f * (inUnitSquare(samples.uv[below(n)]) + inUnitSquare(samples.uv[below(n)]));
    const float radius = coherent ? 0.01f : std::pow(10.0f, -1 - 6 * unit());
    return {centre.x + radius * (unit() - 0.5f), centre.y + radius * (unit() - 0.5f)};
  }

  std::mt19937 random_;
};

}  // namespace encore::twin
