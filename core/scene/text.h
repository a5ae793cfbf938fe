// Numbers as text, for messages.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <type_traits>

#include "core/scene/math.h"

namespace encore {

// Integers in full, floating-point numbers as briefly as still tells neighbours apart to six digits.
template <class T>
  requires std::is_arithmetic_v<T>
std::string text(T value) {
  if constexpr (std::is_integral_v<T>) {
    return std::to_string(value);
  } else {
    std::array<char, 32> buffer;
    std::snprintf(buffer.data(), buffer.size(), "%.6g", double(value));
    return buffer.data();
  }
}
// "(a, b, c)" from "a, b, c". Appended, because GCC 12 warns wrongly about "(" + std::string.
inline std::string parenthesized(const std::string& list) { return std::string(1, '(').append(list).append(")"); }
inline std::string text(Vec2f v) { return parenthesized(text(v.x) + ", " + text(v.y)); }
template <class T>
std::string text(Vec3<T> v) {
  return parenthesized(text(v.x) + ", " + text(v.y) + ", " + text(v.z));
}

inline std::string text(Vec4f v) {
  return parenthesized(text(v.x) + ", " + text(v.y) + ", " + text(v.z) + ", " + text(v.w));
}

inline bool allFinite(float v) { return std::isfinite(v); }
inline bool allFinite(Vec2f v) { return std::isfinite(v.x) && std::isfinite(v.y); }
inline bool allFinite(Vec4f v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z) && std::isfinite(v.w);
}
template <class T>
bool allFinite(Vec3<T> v) {
  return isFinite(v);
}
template <class T>
bool allFinite(const Affine3<T>& m) {
  return isFinite(m.ex) && isFinite(m.ey) && isFinite(m.ez) && isFinite(m.origin);
}

}  // namespace encore
