// Small vectors and affine transforms; the only linear algebra that core needs.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <type_traits>

namespace encore {

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.31830988618379067154f;

struct Vec2f {
  float x = 0, y = 0;
  bool operator==(const Vec2f&) const = default;
};
inline Vec2f operator+(Vec2f a, Vec2f b) { return {a.x + b.x, a.y + b.y}; }
inline Vec2f operator-(Vec2f a, Vec2f b) { return {a.x - b.x, a.y - b.y}; }
inline Vec2f operator*(Vec2f a, float s) { return {a.x * s, a.y * s}; }
inline Vec2f operator*(float s, Vec2f a) { return a * s; }

struct Vec4f {
  float x = 0, y = 0, z = 0, w = 0;
  bool operator==(const Vec4f&) const = default;
};
inline Vec4f operator+(Vec4f a, Vec4f b) { return {a.x + b.x, a.y + b.y, a.z + b.z, a.w + b.w}; }
inline Vec4f operator-(Vec4f a, Vec4f b) { return {a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w}; }
inline Vec4f operator*(Vec4f a, float s) { return {a.x * s, a.y * s, a.z * s, a.w * s}; }

// A three-vector of T; points, directions and colours alike.
template <class T>
struct Vec3 {
  T x = 0, y = 0, z = 0;
  bool operator==(const Vec3&) const = default;
  T& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
  T operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  Vec3& operator+=(Vec3 b) { return *this = {x + b.x, y + b.y, z + b.z}; }
  Vec3& operator*=(Vec3 b) { return *this = {x * b.x, y * b.y, z * b.z}; }
  Vec3& operator*=(T s) { return *this = {x * s, y * s, z * s}; }
};
using Vec3f = Vec3<float>;
using Vec3d = Vec3<double>;

template <class T>
Vec3<T> operator+(Vec3<T> a, Vec3<T> b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
Vec3<T> operator-(Vec3<T> a, Vec3<T> b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
Vec3<T> operator-(Vec3<T> a) {
  return {-a.x, -a.y, -a.z};
}
template <class T>
Vec3<T> operator*(Vec3<T> a, Vec3<T> b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}
template <class T>
Vec3<T> operator*(Vec3<T> a, std::type_identity_t<T> s) {
  return {a.x * s, a.y * s, a.z * s};
}
template <class T>
Vec3<T> operator*(std::type_identity_t<T> s, Vec3<T> a) {
  return a * s;
}
template <class T>
Vec3<T> operator/(Vec3<T> a, std::type_identity_t<T> s) {
  return {a.x / s, a.y / s, a.z / s};
}
template <class T>
T dot(Vec3<T> a, Vec3<T> b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
Vec3<T> cross(Vec3<T> a, Vec3<T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
T length(Vec3<T> a) {
  return std::sqrt(dot(a, a));
}
// Zero stays zero.
template <class T>
Vec3<T> normalize(Vec3<T> a) {
  const T l = length(a);
  return l > 0 ? a / l : a;
}
template <class T>
Vec3<T> absolute(Vec3<T> a) {
  return {std::abs(a.x), std::abs(a.y), std::abs(a.z)};
}
template <class T>
T maxComponent(Vec3<T> a) {
  return std::max({a.x, a.y, a.z});
}
template <class T>
bool isFinite(Vec3<T> a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}
inline Vec3f toFloat(Vec3d a) { return {float(a.x), float(a.y), float(a.z)}; }
inline Vec3d toDouble(Vec3f a) { return {a.x, a.y, a.z}; }

// x ↦ x.x * ex + x.y * ey + x.z * ez + origin: the columns are the images of the axes and the origin.
template <class T>
struct Affine3 {
  Vec3<T> ex{1, 0, 0}, ey{0, 1, 0}, ez{0, 0, 1}, origin{0, 0, 0};
  bool operator==(const Affine3&) const = default;

  Vec3<T> vector(Vec3<T> v) const { return ex * v.x + ey * v.y + ez * v.z; }
  Vec3<T> point(Vec3<T> p) const { return vector(p) + origin; }
  // Multiplies by the transposed linear part. Called on the inverse transform, this maps normals.
  Vec3<T> transposedVector(Vec3<T> n) const { return {dot(ex, n), dot(ey, n), dot(ez, n)}; }
  T determinant() const { return dot(ex, cross(ey, ez)); }
};
using Affine3f = Affine3<float>;
using Affine3d = Affine3<double>;

// a after b.
template <class T>
Affine3<T> operator*(const Affine3<T>& a, const Affine3<T>& b) {
  return {a.vector(b.ex), a.vector(b.ey), a.vector(b.ez), a.point(b.origin)};
}

// Precondition: the determinant is not zero.
template <class T>
Affine3<T> inverse(const Affine3<T>& m) {
  const T d = m.determinant();
  const Vec3<T> r0 = cross(m.ey, m.ez) / d, r1 = cross(m.ez, m.ex) / d, r2 = cross(m.ex, m.ey) / d;
  Affine3<T> i{{r0.x, r1.x, r2.x}, {r0.y, r1.y, r2.y}, {r0.z, r1.z, r2.z}, {}};
  i.origin = -i.vector(m.origin);
  return i;
}

inline Affine3f toFloat(const Affine3d& m) { return {toFloat(m.ex), toFloat(m.ey), toFloat(m.ez), toFloat(m.origin)}; }

// Two unit vectors that with the unit vector n form a right-handed basis (t, b, n).
// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017.
struct Basis {
  Vec3f t, b, n;
  explicit Basis(Vec3f normal) : n(normal) {
    const float sign = std::copysign(1.0f, n.z);
    const float p = -1.0f / (sign + n.z);
    const float q = n.x * n.y * p;
    t = {1.0f + sign * n.x * n.x * p, sign * q, -sign * n.x};
    b = {q, sign + n.y * n.y * p, -n.y};
  }
  Vec3f toWorld(Vec3f v) const { return t * v.x + b * v.y + n * v.z; }
  Vec3f toLocal(Vec3f v) const { return {dot(t, v), dot(b, v), dot(n, v)}; }
};

}  // namespace encore
