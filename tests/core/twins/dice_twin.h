// Twins of the dicer: limit positions from the textbook definitions, slow and obvious.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "core/scene/math.h"

namespace encore::twin {

struct PolygonMesh {
  std::vector<Vec3d> points;
  std::vector<std::vector<int32_t>> faces;
};

// One step of Catmull & Clark's rules (1978), for closed manifold meshes without creases.
// Points of the result: the old points, then one per face, then one per edge.
inline PolygonMesh catmullClarkStep(const PolygonMesh& mesh) {
  PolygonMesh out;
  std::map<std::pair<int32_t, int32_t>, std::vector<size_t>> edge_faces;
  std::vector<Vec3d> face_points;
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    Vec3d sum{0, 0, 0};
    const auto& face = mesh.faces[f];
    for (size_t k = 0; k < face.size(); ++k) {
      sum += mesh.points[face[k]];
      const int32_t a = face[k], b = face[(k + 1) % face.size()];
      edge_faces[{std::min(a, b), std::max(a, b)}].push_back(f);
    }
    face_points.push_back(sum / double(face.size()));
  }
  std::vector<Vec3d> face_sum(mesh.points.size(), {0, 0, 0}), neighbour_sum = face_sum;
  std::vector<double> valence(mesh.points.size(), 0);
  std::map<std::pair<int32_t, int32_t>, int32_t> edge_point;
  std::vector<Vec3d> edge_points;
  for (const auto& [edge, faces] : edge_faces) {
    const Vec3d a = mesh.points[edge.first], b = mesh.points[edge.second];
    edge_point[edge] = int32_t(mesh.points.size() + mesh.faces.size() + edge_points.size());
    edge_points.push_back((a + b + face_points[faces[0]] + face_points[faces[1]]) / 4.0);
    neighbour_sum[edge.first] += b;
    neighbour_sum[edge.second] += a;
    valence[edge.first] += 1;
    valence[edge.second] += 1;
  }
  for (size_t f = 0; f < mesh.faces.size(); ++f)
    for (const int32_t v : mesh.faces[f]) face_sum[v] += face_points[f];
  for (size_t v = 0; v < mesh.points.size(); ++v) {
    const double n = valence[v];
    out.points.push_back((face_sum[v] / n + neighbour_sum[v] / n + mesh.points[v] * (n - 2)) / n);
  }
  out.points.insert(out.points.end(), face_points.begin(), face_points.end());
  out.points.insert(out.points.end(), edge_points.begin(), edge_points.end());
  for (size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto& face = mesh.faces[f];
    const auto edge = [&](size_t k) {
      const int32_t a = face[k], b = face[(k + 1) % face.size()];
      return edge_point.at({std::min(a, b), std::max(a, b)});
    };
    for (size_t k = 0; k < face.size(); ++k)
      out.faces.push_back(
          {face[k], edge(k), int32_t(mesh.points.size() + f), edge((k + face.size() - 1) % face.size())});
  }
  return out;
}

// Limit of every point of a closed mesh of quads: (n² v + 4 Σ e + Σ f) / (n (n + 5)), with the ends e of
// its edges and the far corners f of its faces (Halstead, Kass & DeRose 1993).
inline std::vector<Vec3d> catmullClarkLimit(const PolygonMesh& quads) {
  std::vector<std::set<int32_t>> near(quads.points.size());
  std::vector<Vec3d> far(quads.points.size(), {0, 0, 0});
  for (const auto& face : quads.faces)
    for (size_t k = 0; k < 4; ++k) {
      near[face[k]].insert({face[(k + 1) % 4], face[(k + 3) % 4]});
      far[face[k]] += quads.points[face[(k + 2) % 4]];
    }
  std::vector<Vec3d> limit;
  for (size_t v = 0; v < quads.points.size(); ++v) {
    const double n = double(near[v].size());
    Vec3d sum = quads.points[v] * (n * n) + far[v];
    for (const int32_t e : near[v]) sum += quads.points[e] * 4.0;
    limit.push_back(sum / (n * (n + 5)));
  }
  return limit;
}

// Limit of a point of valence n under Loop's scheme: (1 - n χ) v + χ Σ e, χ = 1 / (n + 3 / (8 β)),
// β = (5/8 - (3/8 + cos(2π/n) / 4)²) / n (Loop 1987).
inline Vec3d loopLimit(Vec3d v, const std::vector<Vec3d>& neighbours) {
  const double n = double(neighbours.size());
  const double c = 3.0 / 8 + std::cos(2 * 3.14159265358979323846 / n) / 4;
  const double beta = (5.0 / 8 - c * c) / n, chi = 1 / (n + 3 / (8 * beta));
  Vec3d sum = v * (1 - n * chi);
  for (const Vec3d e : neighbours) sum += e * chi;
  return sum;
}

// Uniform cubic B-spline basis over its middle interval, and its derivative.
inline std::array<double, 4> bspline(double t) {
  const double r = 1 - t;
  return {r * r * r / 6, (3 * t * t * t - 6 * t * t + 4) / 6, (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6,
          t * t * t / 6};
}
inline std::array<double, 4> bsplineSlope(double t) {
  const double r = 1 - t;
  return {-r * r / 2, (3 * t * t - 4 * t) / 2, (-3 * t * t + 2 * t + 1) / 2, t * t / 2};
}

// Σ a_i b_j p(i, j) over the 4 × 4 points around a regular face; i runs along u.
template <class Point>
Vec3d tensor(const std::array<double, 4>& a, const std::array<double, 4>& b, const Point& p) {
  Vec3d sum{0, 0, 0};
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) sum += toDouble(p(i, j)) * (a[i] * b[j]);
  return sum;
}

}  // namespace encore::twin
