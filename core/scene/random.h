// Counter-based random numbers and low-discrepancy points: no state, so that the value of a sample
// depends on (seed, pixel, sample, dimension) and not on the order of evaluation (design: Determinism).
#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include "core/scene/math.h"

namespace encore {

// What a stream of random numbers is for. Streams of different use are independent.
enum class RandomUse : uint32_t {
  FilmPosition = 1,
  Seed,   // positions of the shading rays
  Lobe,   // which lobe is followed, and where to
  Light,  // points on lights; add the light's index times kLightStride
  Occlusion,
  Camera,    // the place on the lens, and time
  Presence,  // whether a path passes a surface that is partly there
};

// Hash of four words to four words (Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 2020).
inline std::array<uint32_t, 4> pcg4d(uint32_t x, uint32_t y, uint32_t z, uint32_t w) {
  x = x * 1664525u + 1013904223u;
  y = y * 1664525u + 1013904223u;
  z = z * 1664525u + 1013904223u;
  w = w * 1664525u + 1013904223u;
  x += y * w, y += z * x, z += x * y, w += y * z;
  x ^= x >> 16, y ^= y >> 16, z ^= z >> 16, w ^= w >> 16;
  x += y * w, y += z * x, z += x * y, w += y * z;
  return {x, y, z, w};
}

// The upper 24 bits as a float in [0, 1).
inline float toUnit(uint32_t bits) { return float(bits >> 8) * 0x1p-24f; }

inline uint32_t reverseBits(uint32_t x) {
  x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
  x = std::rotl(x, 16);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
  x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
  return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
}

// Owen scrambling of a word whose bits stand in reverse: flips every bit by a hash of the bits below it
// (Laine & Karras 2011; constants after Vegdahl; Burley, "Practical Hash-based Owen Scrambling", JCGT 2020).
inline uint32_t owenScrambleReversed(uint32_t x, uint32_t seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}
inline uint32_t owenScramble(uint32_t x, uint32_t seed) {
  return reverseBits(owenScrambleReversed(reverseBits(x), seed));
}

// The Owen-scrambled Sobol (0, 2)-sequence of one scramble: point(i) in [0, 1)².
// Every prefix of 2^k points is stratified in all elementary intervals of area 2^-k.
class Sobol2 {
 public:
  explicit Sobol2(uint32_t seed) : keys_(pcg4d(seed, 0x9e3779b9u, 0x85ebca6bu, 0xc2b2ae35u)) {}

  Vec2f point(uint32_t index) const {
    index = owenScramble(index, keys_[0]);  // shuffles the order, keeps power-of-two blocks
    return {toUnit(reverseBits(owenScrambleReversed(index, keys_[1]))),
            toUnit(reverseBits(owenScrambleReversed(pascal(index), keys_[2])))};
  }

 private:
  // The second dimension, bits in reverse: its generator matrix is Pascal's triangle modulo 2, so that bit j
  // is the sum of the bits i of the index with j a subset of i (Lucas): one masked shift per bit of i.
  static uint32_t pascal(uint32_t x) {
    x ^= (x >> 1) & 0x55555555u;
    x ^= (x >> 2) & 0x33333333u;
    x ^= (x >> 4) & 0x0f0f0f0fu;
    x ^= (x >> 8) & 0x00ff00ffu;
    return x ^ (x >> 16);
  }
  std::array<uint32_t, 4> keys_;
};

inline Vec2f sobol2(uint32_t index, uint32_t seed) { return Sobol2(seed).point(index); }

}  // namespace encore
