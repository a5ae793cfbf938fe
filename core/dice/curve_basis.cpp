#include "core/dice/curve_basis.h"

namespace encore {
namespace {

// Weights of a segment's points, by powers of t: rows are those of t³, t², t and 1.
struct BasisMatrix {
  double of[4][4];
};

constexpr BasisMatrix kBezier{{{-1, 3, -3, 1}, {3, -6, 3, 0}, {-3, 3, 0, 0}, {1, 0, 0, 0}}};
constexpr BasisMatrix kBSpline{{{-1. / 6, 3. / 6, -3. / 6, 1. / 6},
                                {3. / 6, -1, 3. / 6, 0},
                                {-3. / 6, 0, 3. / 6, 0},
                                {1. / 6, 4. / 6, 1. / 6, 0}}};
constexpr BasisMatrix kCatmullRom{{{-0.5, 1.5, -1.5, 0.5}, {1, -2.5, 2, -0.5}, {-0.5, 0, 0.5, 0}, {0, 1, 0, 0}}};

const BasisMatrix& matrixOf(CurveBasis basis) {
  return basis == CurveBasis::Bezier ? kBezier : basis == CurveBasis::BSpline ? kBSpline : kCatmullRom;
}

std::array<double, 4> powers(double t, int derivative) {
  if (derivative == 0) return {t * t * t, t * t, t, 1};
  if (derivative == 1) return {3 * t * t, 2 * t, 1, 0};
  return {6 * t, 2, 0, 0};
}

std::array<double, 4> weights(CurveBasis basis, double t, int derivative) {
  if (basis == CurveBasis::Linear) {
    if (derivative == 0) return {1 - t, t, 0, 0};
    return derivative == 1 ? std::array<double, 4>{-1, 1, 0, 0} : std::array<double, 4>{};
  }
  const BasisMatrix& matrix = matrixOf(basis);
  const std::array<double, 4> power = powers(t, derivative);
  std::array<double, 4> sum{};
  for (int point = 0; point < 4; ++point)
    for (int row = 0; row < 4; ++row) sum[point] += power[row] * matrix.of[row][point];
  return sum;
}

}  // namespace

CurveStencil pointStencil(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t, int derivative) {
  const std::array<double, 4> weight = weights(mesh.basis, t, derivative);
  const int64_t count = curve.points, first = int64_t(segment) * vstep(mesh.basis) - (hasPhantomPoints(mesh) ? 1 : 0);
  CurveStencil stencil;
  const auto add = [&](int64_t point, double amount) { stencil.add(curve.first_point + uint32_t(point), amount); };
  for (int32_t k = 0; k < segmentPoints(mesh.basis); ++k) {
    if (weight[k] == 0) continue;
    const int64_t point = first + k;
    if (isPeriodic(mesh)) {
      add(point % count, weight[k]);
    } else if (point < 0) {
      add(0, 2 * weight[k]), add(1, -weight[k]);
    } else if (point >= count) {
      add(count - 1, 2 * weight[k]), add(count - 2, -weight[k]);
    } else {
      add(point, weight[k]);
    }
  }
  return stencil;
}

CurveStencil varyingStencil(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t) {
  const uint32_t count = curve.segments + (isPeriodic(mesh) ? 0 : 1);
  CurveStencil stencil;
  if (t != 1) stencil.add(curve.first_varying + segment % count, 1 - t);
  if (t != 0) stencil.add(curve.first_varying + (segment + 1) % count, t);
  return stencil;
}

CurvePlace curvePlace(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t) {
  return {curve.curve, pointStencil(mesh, curve, segment, t), varyingStencil(mesh, curve, segment, t)};
}

}  // namespace encore
