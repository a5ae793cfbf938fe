#include "core/trace/parameter_scale.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <map>
#include <utility>

#include "core/dice/spheres.h"

namespace encore {

namespace {

// The linear part L of a transform as far as lengths go, up to a common factor: the upper half of the symmetric
// matrix LᵀL over its trace. |L v|² is proportional to vᵀ (LᵀL) v.
using Metric = std::array<float, 6>;  // xx, yy, zz, xy, xz, yz

constexpr Metric kUniform{1, 1, 1, 0, 0, 0};
// Rigid transforms arrive with rounding errors; all of them share one table.
constexpr double kUniformTolerance = 1e-5;

Metric metricOf(const Affine3d& m) {
  const double trace = dot(m.ex, m.ex) + dot(m.ey, m.ey) + dot(m.ez, m.ez);
  if (!(trace > 0) || !std::isfinite(trace)) return kUniform;
  const double scale = 3 / trace;
  const double entries[6] = {dot(m.ex, m.ex), dot(m.ey, m.ey), dot(m.ez, m.ez),
                             dot(m.ex, m.ey), dot(m.ex, m.ez), dot(m.ey, m.ez)};
  Metric metric;
  bool uniform = true;
  for (size_t i = 0; i < 6; ++i) {
    metric[i] = float(entries[i] * scale);
    uniform = uniform && std::abs(entries[i] * scale - double(kUniform[i])) < kUniformTolerance;
  }
  return uniform ? kUniform : metric;
}

double stretchedLength(const Metric& m, Vec3d v) {
  const double squared = double(m[0]) * v.x * v.x + double(m[1]) * v.y * v.y + double(m[2]) * v.z * v.z +
                         2 * (double(m[3]) * v.x * v.y + double(m[4]) * v.x * v.z + double(m[5]) * v.y * v.z);
  return std::sqrt(std::max(0.0, squared));
}

// Sums over the triangles of a primitive of area |dp/du| and area |dp/dv|.
struct Extents {
  double u = 0, v = 0;

  void add(const DicedMesh& mesh, size_t triangle, const Metric& metric) {
    const uint32_t* corner = &mesh.triangles[3 * triangle];
    const Vec3d p0 = toDouble(mesh.positions[corner[0]]);
    const Vec3d e1 = toDouble(mesh.positions[corner[1]]) - p0, e2 = toDouble(mesh.positions[corner[2]]) - p0;
    const Vec2f t0 = mesh.uv[corner[0]], t1 = mesh.uv[corner[1]], t2 = mesh.uv[corner[2]];
    const double u1 = double(t1.x) - double(t0.x), v1 = double(t1.y) - double(t0.y);
    const double u2 = double(t2.x) - double(t0.x), v2 = double(t2.y) - double(t0.y);
    const double determinant = u1 * v2 - u2 * v1;  // twice the parametric area, which cancels with that of the weight
    if (determinant == 0) return;
    u += stretchedLength(metric, e1 * v2 - e2 * v1);
    v += stretchedLength(metric, e2 * u1 - e1 * u2);
  }
  Vec2f scale() const {
    const double largest = std::max(u, v);
    if (!(largest > 0) || !std::isfinite(largest)) return {1, 1};
    return {float(std::max(kLeastParameterScale, u / largest)), float(std::max(kLeastParameterScale, v / largest))};
  }
};

std::vector<Vec2f> makeTable(const Prototype& prototype, const DicedMeshes& diced, const Metric& metric) {
  std::vector<Vec2f> table;
  const auto has_spheres = [&](uint32_t index) { return isSpheres(diced[index]); };
  if (std::all_of(prototype.meshes.begin(), prototype.meshes.end(), has_spheres)) return table;
  for (const uint32_t index : prototype.meshes) {
    const DicedMesh& mesh = diced[index];
    if (isSpheres(mesh)) {
      table.resize(table.size() + mesh.primitiveCount(), {1, 1});
      continue;
    }
    std::vector<Extents> extents(mesh.primitiveCount());
    for (size_t t = 0; t < mesh.triangleCount(); ++t) extents[mesh.triangle_primitive[t]].add(mesh, t, metric);
    for (const Extents& e : extents) table.push_back(e.scale());
  }
  return table;
}

}  // namespace

ParameterScales::ParameterScales(const Scene& scene, const DicedMeshes& diced) {
  std::map<std::pair<uint32_t, Metric>, uint32_t> known;
  for (const Instance& instance : scene.instances)
    table_of_.push_back(
        known.try_emplace({instance.prototype, metricOf(instance.to_world)}, uint32_t(known.size())).first->second);
  tables_.resize(known.size());
  std::vector<std::pair<uint32_t, Metric>> keys(known.size());
  for (const auto& [key, index] : known) keys[index] = key;
  tbb::parallel_for(size_t{0}, keys.size(),
                    [&](size_t i) { tables_[i] = makeTable(scene.prototypes[keys[i].first], diced, keys[i].second); });
}

uint64_t ParameterScales::bytes() const {
  uint64_t bytes = table_of_.capacity() * sizeof(uint32_t);
  for (const auto& table : tables_) bytes += table.capacity() * sizeof(Vec2f);
  return bytes;
}

}  // namespace encore
