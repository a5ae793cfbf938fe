#include "core/dice/curve_geometry.h"

#include <algorithm>
#include <cmath>

#include "core/dice/poses.h"

namespace encore {
namespace {

// Of the segment's size: derivatives below it are rounding.
constexpr double kStill = 1e-7;
// How far to look for a direction.
constexpr double kLook = 1.0 / 64;

}  // namespace

Vec3d curveDirection(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t, size_t pose) {
  const std::vector<Vec3f>& points = posedPoints(mesh, pose);
  const auto at = [&](double place) { return curveSum(pointStencil(mesh, curve, segment, place), points); };
  const Vec3d derivative = curveSum(pointStencil(mesh, curve, segment, t, 1), points);
  const Vec3d begin = at(0), middle = at(0.5), end = at(1);
  const double size = length(middle - begin) + length(end - middle);
  if (length(derivative) > kStill * size) return normalize(derivative);
  const Vec3d step = t < 0.5 ? at(t + kLook) - at(t) : at(t) - at(t - kLook);
  return length(step) > kStill * kLook * size ? normalize(step) : normalize(end - begin);
}

double widthChange(const Mesh& mesh, const CurveStencil& points) {
  double sum = 0;
  for (uint32_t i = 0; i < points.count; ++i)
    sum += double(mesh.widths.values[valueIndex(mesh.widths, points.index[i])]) * points.weight[i];
  return sum;
}

double curveWidth(const Mesh& mesh, const CurvePlace& place) {
  return mesh.widths.empty() ? 1 : std::max(0.0, double(curveValue(mesh.widths, place)));
}

double radiusSlope(const Mesh& mesh, const CurveSpan& curve, uint32_t segment, double t, size_t pose) {
  const Interpolation kind = mesh.widths.interpolation;
  if (mesh.widths.empty() || kind == Interpolation::Constant || kind == Interpolation::Uniform) return 0;
  const double speed = length(curveSum(pointStencil(mesh, curve, segment, t, 1), posedPoints(mesh, pose)));
  double change;
  if (kind == Interpolation::Vertex)
    change = widthChange(mesh, pointStencil(mesh, curve, segment, t, 1));
  else
    change = widthChange(mesh, varyingStencil(mesh, curve, segment, 1)) -
             widthChange(mesh, varyingStencil(mesh, curve, segment, 0));
  return speed > 0 ? change / (2 * speed) : 0;
}

Vec3d ribbonNormal(const Mesh& mesh, const CurvePlace& place, size_t pose) {
  const Primvar<Vec3f>& normals = mesh.normals;
  const bool moving = pose > 0 && !mesh.motion_normals.empty();
  const std::vector<Vec3f>& values = moving ? mesh.motion_normals[pose - 1] : normals.values.get();
  const CurveStencil* stencil = stencilOf(normals.interpolation, place);
  if (!stencil) return toDouble(values[cornerIndex(normals, place.curve, 0, 0)]);
  Vec3d sum{0, 0, 0};
  for (uint32_t i = 0; i < stencil->count; ++i)
    sum += toDouble(values[valueIndex(normals, stencil->index[i])]) * stencil->weight[i];
  return sum;
}

}  // namespace encore
