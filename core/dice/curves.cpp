#include "core/dice/curves.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/dice/chords.h"
#include "core/dice/curve_geometry.h"
#include "core/dice/micropolygon_cap.h"
#include "core/dice/poses.h"

namespace encore {
namespace {

// Of the edge length: how far a polyline may be from its curve.
constexpr double kDeviation = 1.0 / 8;
// Segments that meet at a larger angle are a corner, with normals of its own on both sides.
constexpr double kCornerCosine = 0.866;  // 30°

// Bounds of what a cubic does over its segment.
struct Bend {
  double speed = 0;         // of its first derivative
  double acceleration = 0;  // of its second
};

// The first derivative is a quadratic, within the hull of its Bernstein coefficients; the second is linear.
template <class Derivative>
Bend bendOf(const Derivative& derivative) {
  const auto first = derivative(0.0, 1), middle = derivative(0.5, 1), last = derivative(1.0, 1);
  const auto size = [](auto value) { return std::sqrt(dot(value, value)); };
  const auto control = middle * 2.0 - (first + last) * 0.5;
  return {std::max({size(first), size(control), size(last)}),
          std::max(size(derivative(0.0, 2)), size(derivative(1.0, 2)))};
}

// Steps that a segment needs so that chords leave it by at most `deviation`.
double stepsFor(double acceleration, double deviation) { return std::sqrt(acceleration / (8 * deviation)); }

}  // namespace

CurveDicer::CurveDicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons)
    : mesh_(mesh), edge_length_(edge_length), max_micropolygons_(max_micropolygons) {
  listCurves();
  tbb::parallel_for(tbb::blocked_range<size_t>(0, plans_.size(), 64), [&](const tbb::blocked_range<size_t>& range) {
    for (size_t i = range.begin(); i != range.end(); ++i) findRates(plans_[i]);
  });
  count();
}

void CurveDicer::listCurves() {
  const std::vector<int32_t>& counts = mesh_.face_vertex_counts.get();
  plans_.resize(counts.size());
  CurveSpan next;
  for (size_t i = 0; i < counts.size(); ++i) {
    next.points = uint32_t(counts[i]), next.segments = uint32_t(segmentCount(mesh_, counts[i]));
    plans_[i].span = next;
    ++next.curve;
    next.first_point += next.points, next.first_segment += next.segments;
    next.first_varying += uint32_t(varyingCount(mesh_, counts[i]));
  }
  rates_.resize(next.first_segment), corners_.resize(next.first_segment);
}

void CurveDicer::findRates(Plan& plan) {
  const CurveSpan& span = plan.span;
  const double width = widthOf(span);
  plan.across = isTube() ? std::clamp(toRate(2 * double(kPi) * width / edge_length_), kLeastAround, kMostAround) : 1;
  plan.rows = 1;
  for (uint32_t s = 0; s < span.segments; ++s) {
    rates_[span.first_segment + s] = segmentRate(span, s, width);
    corners_[span.first_segment + s] = isCorner(span, s);
    plan.rows += rates_[span.first_segment + s] + (s > 0 && corners_[span.first_segment + s] ? 1 : 0);
  }
}

double CurveDicer::widthOf(const CurveSpan& span) const {
  double widest = 0;
  for (uint32_t s = 0; s < span.segments; ++s)
    for (const double t : {0.0, 0.5, 1.0}) widest = std::max(widest, curveWidth(mesh_, curvePlace(mesh_, span, s, t)));
  return widest;
}

uint32_t CurveDicer::segmentRate(const CurveSpan& span, uint32_t segment, double width) const {
  const double deviation = kDeviation * edge_length_;
  const double thin = std::max(1.0, edge_length_ / width), spacing = edge_length_ * thin * thin;
  double rate = 1;
  for (size_t pose = 0; pose < poseCount(mesh_); ++pose) {
    const Bend bend = bendOf([&](double t, int derivative) {
      return curveSum(pointStencil(mesh_, span, segment, t, derivative), posedPoints(mesh_, pose));
    });
    rate = std::max({rate, bend.speed / spacing, stepsFor(bend.acceleration, deviation)});
    if (isTube()) continue;
    // The edges of a ribbon that turns by an angle are helices.
    double angle = 0;
    Vec3d before = ribbonNormal(mesh_, curvePlace(mesh_, span, segment, 0), pose);
    for (const double t : {0.5, 1.0}) {
      const Vec3d after = ribbonNormal(mesh_, curvePlace(mesh_, span, segment, t), pose);
      angle += std::atan2(length(cross(before, after)), dot(before, after));
      before = after;
    }
    rate = std::max(rate, stepsFor(width / 2 * angle * angle, deviation));
  }
  if (mesh_.widths.interpolation == Interpolation::Vertex && !mesh_.widths.empty()) {
    const Bend bend = bendOf([&](double t, int derivative) {
      return Vec3d{widthChange(mesh_, pointStencil(mesh_, span, segment, t, derivative)) / 2, 0, 0};
    });
    rate = std::max(rate, stepsFor(bend.acceleration, deviation));
  }
  return toRate(rate);
}

bool CurveDicer::isCorner(const CurveSpan& span, uint32_t segment) const {
  const bool smooth = mesh_.basis == CurveBasis::BSpline || mesh_.basis == CurveBasis::CatmullRom;
  if (smooth || (segment == 0 && !isPeriodic(mesh_))) return false;
  const uint32_t last = segment == 0 ? span.segments - 1 : segment - 1;
  for (size_t pose = 0; pose < poseCount(mesh_); ++pose) {
    const Vec3d before = curveDirection(mesh_, span, last, 1, pose);
    const Vec3d after = curveDirection(mesh_, span, segment, 0, pose);
    const bool both = dot(before, before) > 0 && dot(after, after) > 0;
    if (both && dot(before, after) < kCornerCosine) return true;
  }
  return false;
}

void CurveDicer::count() {
  for (Plan& plan : plans_) {
    uint64_t strips = 0;
    for (uint32_t s = 0; s < plan.span.segments; ++s) strips += rates_[plan.span.first_segment + s];
    plan.first_vertex = vertices_, plan.first_triangle = triangles_;
    micropolygons_ += strips * plan.across;
    vertices_ += plan.rows * (plan.across + 1);
    triangles_ += 2 * strips * plan.across;
    if (micropolygons_ > max_micropolygons_)
      throw tooManyMicropolygons(mesh_, "more than " + std::to_string(max_micropolygons_), edge_length_,
                                 max_micropolygons_);
  }
  if (vertices_ > std::numeric_limits<uint32_t>::max())
    throw tooManyMicropolygons(mesh_, std::to_string(micropolygons_), edge_length_, max_micropolygons_);
}

}  // namespace encore
