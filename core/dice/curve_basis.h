// Values along curves: which elements a place on a curve is made of, and how much of each.
#pragma once

#include <array>
#include <cstdint>

#include "core/dice/primvars.h"
#include "core/scene/curve_counts.h"
#include "core/scene/math.h"

namespace encore {

// A weighted sum of elements of an array. Phantom points are resolved into the points that they are made of.
struct CurveStencil {
  static constexpr uint32_t kMost = 6;
  uint32_t count = 0;
  std::array<uint32_t, kMost> index{};
  std::array<double, kMost> weight{};

  void add(uint32_t element, double amount) {
    for (uint32_t i = 0; i < count; ++i)
      if (index[i] == element) {
        weight[i] += amount;
        return;
      }
    index[count] = element, weight[count++] = amount;
  }
};

// One curve of a mesh: where its elements begin in arrays of each interpolation.
struct CurveSpan {
  uint32_t curve = 0;
  uint32_t first_point = 0, points = 0;
  uint32_t first_varying = 0;
  uint32_t first_segment = 0, segments = 0;
};

// Place t in [0, 1] of a segment of a curve: what it is of the points (derivative: 0 to 2, by t), and of the values of
// varying primvars. Sums of the weights: 1, or 0 of derivatives.
CurveStencil pointStencil(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t, int derivative = 0);
CurveStencil varyingStencil(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t);

// All that places on curves are evaluated with.
struct CurvePlace {
  uint32_t curve;
  CurveStencil points, varying;
};
CurvePlace curvePlace(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t);

inline const CurveStencil* stencilOf(Interpolation interpolation, const CurvePlace& place) {
  if (interpolation == Interpolation::Vertex) return &place.points;
  const bool varying = interpolation == Interpolation::Varying || interpolation == Interpolation::FaceVarying;
  return varying ? &place.varying : nullptr;
}

// Sum over a stencil of double(values[...]), taken from the first of them: exact where one element has all the weight,
// and where all values agree, so that weights which nearly add up to 0 make no derivative of what stands still.
inline Vec3d curveSum(const CurveStencil& stencil, const std::vector<Vec3f>& values) {
  if (stencil.count == 0) return {0, 0, 0};  // a second derivative of what is linear
  const Vec3d first = toDouble(values[stencil.index[0]]);
  Vec3d sum{0, 0, 0};
  double weight = stencil.weight[0];
  for (uint32_t i = 1; i < stencil.count; ++i) {
    sum += (toDouble(values[stencil.index[i]]) - first) * stencil.weight[i];
    weight += stencil.weight[i];
  }
  return weight > 0.5 ? first + sum : sum;
}

// A primvar's value at a place; T{} where there are no values at all.
template <class T>
T curveValue(const Primvar<T>& primvar, const CurvePlace& place) {
  if (primvar.empty()) return T{};
  const std::vector<T>& values = primvar.values.get();
  const CurveStencil* stencil = stencilOf(primvar.interpolation, place);
  if (!stencil) return values[cornerIndex(primvar, place.curve, 0, 0)];
  constexpr size_t kWidth = sizeof(T) / sizeof(float);
  double sum[kWidth] = {};
  for (uint32_t i = 0; i < stencil->count; ++i) {
    const float* value = reinterpret_cast<const float*>(&values[valueIndex(primvar, stencil->index[i])]);
    for (size_t k = 0; k < kWidth; ++k) sum[k] += stencil->weight[i] * double(value[k]);
  }
  T result;
  for (size_t k = 0; k < kWidth; ++k) reinterpret_cast<float*>(&result)[k] = float(sum[k]);
  return result;
}

}  // namespace encore
