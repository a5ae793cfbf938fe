#include "core/dice/spheres.h"

#include <cmath>
#include <string>

#include "core/dice/micropolygon_cap.h"
#include "core/dice/poses.h"
#include "core/dice/primvars.h"

namespace encore {
namespace {

// Radius of what is not there: Embree leaves it out.
constexpr float kNowhere = -1;

// Whatever is not constant is per point (core/scene/mesh.h).
template <class T>
T pointValue(const Primvar<T>& primvar, size_t point) {
  const size_t element = primvar.interpolation == Interpolation::Constant ? 0 : point;
  return primvar.values[valueIndex(primvar, element)];
}

template <class T>
std::vector<T> pointValues(const Primvar<T>& primvar, size_t points) {
  if (primvar.empty()) return {};
  std::vector<T> values(primvar.interpolation == Interpolation::Constant ? 1 : points);
  for (size_t i = 0; i < values.size(); ++i) values[i] = pointValue(primvar, i);
  return values;
}

std::vector<Vec4f> spheresAt(const Mesh& mesh, const std::vector<Vec3f>& points) {
  std::vector<Vec4f> spheres(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const float width = mesh.widths.empty() ? 1 : pointValue(mesh.widths, i);
    spheres[i] = {points[i].x, points[i].y, points[i].z, width > 0 ? width / 2 : kNowhere};
  }
  return spheres;
}

double signOf(double x) { return std::copysign(1.0, x); }

}  // namespace

// Through the octahedron |x| + |y| + |z| = 1, whose lower half is folded outwards.
SphereNormal::SphereNormal(double u, double v) {
  const double x = 2 * u - 1, y = 2 * v - 1, z = 1 - std::abs(x) - std::abs(y);
  const double sx = signOf(x), sy = signOf(y);
  Vec3d at{x, y, z}, by_x{1, 0, -sx}, by_y{0, 1, -sy};
  if (z < 0) {
    at = {sx * (1 - std::abs(y)), sy * (1 - std::abs(x)), z};
    by_x = {0, -sx * sy, -sx}, by_y = {-sx * sy, 0, -sy};
  }
  const double size = length(at);
  n = at / size;
  du = (by_x - n * dot(n, by_x)) * (2 / size), dv = (by_y - n * dot(n, by_y)) * (2 / size);
}

std::array<double, 2> sphereParameters(Vec3d d) {
  const double sum = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
  if (!(sum > 0)) return {0.5, 0.5};
  double x = d.x / sum, y = d.y / sum;
  if (d.z < 0) {
    const double folded = (1 - std::abs(y)) * signOf(x);
    y = (1 - std::abs(x)) * signOf(y), x = folded;
  }
  return {(x + 1) / 2, (y + 1) / 2};
}

DicedMesh spheresOf(const Mesh& mesh, uint64_t max_micropolygons) {
  const size_t count = mesh.points.size();
  if (count > max_micropolygons)
    throw overMicropolygonCap(mesh, std::to_string(count) + " points are more than the cap of " +
                                        std::to_string(max_micropolygons) + " micropolygons");
  DicedMesh out;
  out.spheres = spheresAt(mesh, mesh.points);
  for (const std::vector<Vec3f>& points : mesh.motion_points.get())
    out.motion_spheres.push_back(spheresAt(mesh, points));
  for (const auto& primvar : mesh.texcoords) out.texcoords.push_back(pointValues(primvar, count));
  for (const auto& primvar : mesh.primvars) out.primvars.push_back(pointValues(primvar, count));
  out.display_color = pointValues(mesh.display_color, count);
  out.micropolygons = count;
  return out;
}

}  // namespace encore
