#include "core/dice/edge_length.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/dice/dice.h"

namespace encore {
namespace {

struct Box {
  Vec3d low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};

  bool empty() const { return low.x > high.x; }
  double diagonal() const { return empty() ? 0 : length(high - low); }
  void add(Vec3d p) {
    for (int i = 0; i < 3; ++i) {
      low[i] = std::min(low[i], p[i]);
      high[i] = std::max(high[i], p[i]);
    }
  }
  void add(const Box& box, const Affine3d& transform) {
    for (int i = 0; i < 8 && !box.empty(); ++i)
      add(transform.point(
          {i & 1 ? box.high.x : box.low.x, i & 2 ? box.high.y : box.low.y, i & 4 ? box.high.z : box.low.z}));
  }
};

constexpr double kWidthsPerEdge = 16;

struct WidthRange {
  double mean = 1, most = 1;
};

WidthRange widthRange(const Mesh& mesh) {
  if (mesh.widths.empty()) return {};
  WidthRange range{0, 0};
  for (const float width : mesh.widths.values.get())
    range.mean += double(width), range.most = std::max(range.most, double(width));
  range.mean /= double(mesh.widths.values.size());
  return range;
}

// Points that faces use: stray ones must not make a mesh look large. Curves and points with the widest of their widths.
Box boundsOf(const Mesh& mesh) {
  Box box;
  if (mesh.shape != Shape::Faces) {
    for (const Vec3f& point : mesh.points.get()) box.add(toDouble(point));
    if (box.empty()) return box;
    const double radius = widthRange(mesh).most / 2;
    box.add(box.low - Vec3d{radius, radius, radius}), box.add(box.high + Vec3d{radius, radius, radius});
    return box;
  }
  for (const int32_t point : mesh.face_vertex_indices) box.add(toDouble(mesh.points[size_t(point)]));
  return box;
}

// Of control polygons.
double meanCurveEdge(const Mesh& mesh) {
  const std::vector<Vec3f>& points = mesh.points.get();
  double sum = 0;
  size_t first = 0, edges = 0;
  for (const int32_t count : mesh.face_vertex_counts.get()) {
    for (size_t k = 1; k < size_t(count); ++k)
      sum += length(toDouble(points[first + k]) - toDouble(points[first + k - 1]));
    first += size_t(count), edges += size_t(count) - 1;
  }
  return edges == 0 ? 0 : sum / double(edges);
}

// Stands for the base faces' edges in defaultEdgeLength(), which takes a quarter of it: not longer than edges of the
// control polygons, and not so long that hair is bent by more than twice its width (CurveDicer).
double curveBaseEdge(const Mesh& mesh) {
  const double edge = meanCurveEdge(mesh), width = kWidthsPerEdge * widthRange(mesh).mean;
  return 4 * (width > 0 ? std::min(edge, width) : edge);
}

double meanBaseEdge(const Mesh& mesh) {
  if (mesh.shape != Shape::Faces) return mesh.shape == Shape::Curves ? curveBaseEdge(mesh) : 0;
  double sum = 0;
  size_t first = 0;
  for (const int32_t count : mesh.face_vertex_counts) {
    const auto point = [&](int32_t k) { return toDouble(mesh.points[mesh.face_vertex_indices[first + k % count]]); };
    for (int32_t k = 0; k < count; ++k) sum += length(point(k + 1) - point(k));
    first += size_t(count);
  }
  return first == 0 ? 0 : sum / double(first);
}

// Turning a thing changes the last bits of its scale, which must not dice it anew.
double rounded(double scale) {
  constexpr double kSteps = 1 << 17;
  int exponent = 0;
  const double mantissa = std::frexp(scale, &exponent);
  return std::ldexp(std::round(mantissa * kSteps) / kSteps, exponent);
}

// The nearest quarter of an octave: what moves about must not dice all others anew.
double roundedDiagonal(double diagonal) {
  return diagonal > 0 && std::isfinite(diagonal) ? std::exp2(std::round(4 * std::log2(diagonal)) / 4) : diagonal;
}

struct ScaleRange {
  double least = std::numeric_limits<double>::max(), largest = 0;

  void add(double scale) {
    least = std::min(least, scale);
    largest = std::max(largest, scale);
  }

  // See resolvedEdgeLengths. The tolerances forgive what rotations do to the last bits.
  double forDicing() const {
    if (largest <= least * (1 + 1e-4)) return rounded(largest);
    return std::exp2(std::ceil(std::log2(largest) - 1e-4));
  }
};

}  // namespace

// The largest eigenvalue of the Gram matrix MᵀM in closed form (O. K. Smith, "Eigenvalues of a symmetric
// 3 × 3 matrix", CACM 4(4), 1961).
float largestScale(const Affine3d& m) {
  const double unit =
      std::max({maxComponent(absolute(m.ex)), maxComponent(absolute(m.ey)), maxComponent(absolute(m.ez))});
  if (unit == 0) return 0;
  const Vec3d x = m.ex / unit, y = m.ey / unit, z = m.ez / unit;
  const double xx = dot(x, x), yy = dot(y, y), zz = dot(z, z), xy = dot(x, y), xz = dot(x, z), yz = dot(y, z);
  const double mean = (xx + yy + zz) / 3, off = xy * xy + xz * xz + yz * yz;
  const double a = xx - mean, b = yy - mean, c = zz - mean;
  const double p = std::sqrt((a * a + b * b + c * c + 2 * off) / 6);
  if (p == 0) return float(unit * std::sqrt(mean));
  const double det = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz);
  const double angle = std::acos(std::clamp(det / (2 * p * p * p), -1.0, 1.0)) / 3;
  return float(unit * std::sqrt(mean + 2 * p * std::cos(angle)));
}

float defaultEdgeLength(float mesh_diagonal_world, float scene_diagonal_world, float base_edge_world) {
  if (!(mesh_diagonal_world > 0) || !std::isfinite(mesh_diagonal_world)) return 1;
  // Collapsed base faces say nothing about thin parts.
  const float round = base_edge_world > 0 ? base_edge_world / 4 : mesh_diagonal_world / 128;
  const float fine = std::min(mesh_diagonal_world / 128, round);
  const float coarse = std::min(std::max(scene_diagonal_world, 0.0f) / 4096, mesh_diagonal_world / 64);
  return std::max(fine, coarse);
}

std::vector<float> resolvedEdgeLengths(const Scene& scene, const Settings& settings) {
  std::vector<Box> bounds;
  for (const Mesh& mesh : scene.meshes) bounds.push_back(boundsOf(mesh));
  std::vector<ScaleRange> scales(scene.meshes.size());
  Box world;
  for (const Instance& instance : scene.instances) {
    ScaleRange range;
    range.add(largestScale(instance.to_world));
    // Between keys, scales are at most those at the keys: matrices are interpolated linearly.
    for (const Affine3d& key : instance.motion) range.add(largestScale(key));
    for (const uint32_t mesh : scene.prototypes[instance.prototype].meshes) {
      scales[mesh].add(range.least);
      scales[mesh].add(range.largest);
      world.add(bounds[mesh], instance.to_world);
    }
  }
  const float world_diagonal = float(roundedDiagonal(world.diagonal()));
  std::vector<float> lengths;
  for (size_t i = 0; i < scene.meshes.size(); ++i) {
    const Mesh& mesh = scene.meshes[i];
    const double largest = rounded(scales[i].largest);
    double world_length = mesh.target_edge_length_world;
    if (!(world_length > 0)) {
      world_length = settings.target_edge_length_world > 0
                         ? settings.target_edge_length_world
                         : defaultEdgeLength(float(bounds[i].diagonal() * largest), world_diagonal,
                                             float(meanBaseEdge(mesh) * largest));
      world_length *= settings.edge_length_scale;
    }
    lengths.push_back(largest > 0 ? float(world_length / scales[i].forDicing()) : 0.0f);
  }
  return lengths;
}

}  // namespace encore
