// UsdGeomBasisCurves, one curve at a time: control points are written out with what wrap adds to them, and places are
// found by repeated linear interpolation. What dicing must agree with.
#pragma once

#include <cmath>
#include <vector>

#include "core/scene/math.h"
#include "core/scene/mesh.h"

namespace encore::twin {

class CurveTwin {
 public:
  // points: those of one curve.
  CurveTwin(std::vector<Vec3d> points, CurveBasis basis, CurveWrap wrap) : points_(std::move(points)), basis_(basis) {
    const size_t own = points_.size();
    const size_t step = basis == CurveBasis::Bezier ? 3 : 1, width = basis == CurveBasis::Linear ? 2 : 4;
    if (wrap == CurveWrap::Periodic)
      for (size_t i = 0; i < width - step; ++i) points_.push_back(points_[i % own]);
    if (wrap == CurveWrap::Pinned && (basis == CurveBasis::BSpline || basis == CurveBasis::CatmullRom)) {
      const Vec3d before = points_[0] * 2.0 - points_[1], after = points_[own - 1] * 2.0 - points_[own - 2];
      points_.insert(points_.begin(), before);
      points_.push_back(after);
    }
    for (size_t first = 0; first + width <= points_.size(); first += step) firsts_.push_back(first);
  }

  size_t segments() const { return firsts_.size(); }
  Vec3d at(double u) const {
    const double scaled = u * double(segments());
    const size_t segment = std::min(size_t(scaled), segments() - 1);
    return at(segment, scaled - double(segment));
  }
  Vec3d at(size_t segment, double t) const {
    const Vec3d* p = &points_[firsts_[segment]];
    switch (basis_) {
      case CurveBasis::Linear:
        return mix(p[0], p[1], t);
      case CurveBasis::Bezier:
        return deCasteljau(p[0], p[1], p[2], p[3], t);
      case CurveBasis::CatmullRom:  // tangents are half the way between the neighbours
        return deCasteljau(p[1], p[1] + (p[2] - p[0]) / 6.0, p[2] - (p[3] - p[1]) / 6.0, p[2], t);
      case CurveBasis::BSpline: {  // de Boor's algorithm on knots -2 -1 0 1 2 3
        const Vec3d a = mix(p[0], p[1], (t + 2) / 3), b = mix(p[1], p[2], (t + 1) / 3), c = mix(p[2], p[3], t / 3);
        return mix(mix(a, b, (t + 1) / 2), mix(b, c, t / 2), t);
      }
    }
    return {};
  }
  Vec3d direction(double u) const {
    const double h = 1e-6, low = std::max(0.0, u - h), high = std::min(1.0, u + h);
    return normalize(at(high) - at(low));
  }

 private:
  static Vec3d mix(Vec3d a, Vec3d b, double t) { return a * (1 - t) + b * t; }
  static Vec3d deCasteljau(Vec3d a, Vec3d b, Vec3d c, Vec3d d, double t) {
    const Vec3d ab = mix(a, b, t), bc = mix(b, c, t), cd = mix(c, d, t);
    return mix(mix(ab, bc, t), mix(bc, cd, t), t);
  }

  std::vector<Vec3d> points_;
  std::vector<size_t> firsts_;  // of the segments
  CurveBasis basis_;
};

}  // namespace encore::twin
