// Small meshes for the dicer's tests, and checks of what it makes of them.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/dice/dice.h"
#include "core/scene/mesh.h"

namespace encore::test {

inline constexpr uint64_t kNoCap = 10'000'000;

inline Mesh makeMesh(std::vector<Vec3f> points, const std::vector<std::vector<int32_t>>& faces,
                     SubdivisionScheme scheme = SubdivisionScheme::CatmullClark) {
  Mesh mesh;
  mesh.path = "/World/Mesh";
  mesh.scheme = scheme;
  mesh.points = std::move(points);
  for (const auto& face : faces) {
    mesh.face_vertex_counts.push_back(int32_t(face.size()));
    mesh.face_vertex_indices.insert(mesh.face_vertex_indices.end(), face.begin(), face.end());
  }
  return mesh;
}

inline std::vector<std::vector<int32_t>> facesOf(const Mesh& mesh) {
  std::vector<std::vector<int32_t>> faces;
  auto at = mesh.face_vertex_indices.begin();
  for (const int32_t count : mesh.face_vertex_counts) {
    faces.emplace_back(at, at + count);
    at += count;
  }
  return faces;
}

// Corners at ±1, faces outwards.
inline Mesh cube() {
  return makeMesh({{-1, -1, -1}, {1, -1, -1}, {-1, 1, -1}, {1, 1, -1}, {-1, -1, 1}, {1, -1, 1}, {-1, 1, 1}, {1, 1, 1}},
                  {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}});
}

inline Mesh tetrahedron(SubdivisionScheme scheme) {
  return makeMesh({{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}}, {{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}},
                  scheme);
}

inline Mesh octahedron(SubdivisionScheme scheme) {
  return makeMesh({{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}},
                  {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}}, scheme);
}

// An n-sided prism: two n-gons, n quads, outwards.
inline Mesh prism(int n, float height = 2) {
  std::vector<Vec3f> points;
  std::vector<std::vector<int32_t>> faces(2);
  for (int top = 0; top < 2; ++top)
    for (int i = 0; i < n; ++i) {
      const float angle = 2 * kPi * float(i) / float(n);
      points.push_back({std::cos(angle), std::sin(angle), top ? height / 2 : -height / 2});
    }
  for (int i = 0; i < n; ++i) {
    const int j = (i + 1) % n;
    faces[0].push_back(n - 1 - i);
    faces[1].push_back(n + i);
    faces.push_back({i, j, n + j, n + i});
  }
  return makeMesh(points, faces);
}

inline Mesh torus(int around, int across) {
  std::vector<Vec3f> points;
  std::vector<std::vector<int32_t>> faces;
  for (int i = 0; i < around; ++i)
    for (int j = 0; j < across; ++j) {
      const float a = 2 * kPi * float(i) / float(around), b = 2 * kPi * float(j) / float(across);
      const float r = 3 + std::cos(b);
      points.push_back({r * std::cos(a), r * std::sin(a), std::sin(b)});
      const int i1 = (i + 1) % around, j1 = (j + 1) % across;
      faces.push_back({i * across + j, i1 * across + j, i1 * across + j1, i * across + j1});
    }
  return makeMesh(points, faces);
}

// n × n quads over [0, size]², the surface z = height(x, y).
template <class Height>
Mesh sheet(int n, float size, const Height& height) {
  std::vector<Vec3f> points;
  std::vector<std::vector<int32_t>> faces;
  for (int j = 0; j <= n; ++j)
    for (int i = 0; i <= n; ++i) {
      const float x = size * float(i) / float(n), y = size * float(j) / float(n);
      points.push_back({x, y, height(x, y)});
      const int a = j * (n + 1) + i;
      if (i < n && j < n) faces.push_back({a, a + 1, a + n + 2, a + n + 1});
    }
  return makeMesh(points, faces);
}

// A closed mesh of triangles, quads and larger polygons with points of many valences: an octahedron whose
// triangles are split at random and joined at random, its points pushed out at random.
inline Mesh randomMesh(uint32_t seed, SubdivisionScheme scheme = SubdivisionScheme::CatmullClark) {
  std::mt19937 random(seed);
  const auto below = [&](size_t n) { return size_t(random() % n); };
  Mesh base = octahedron(scheme);
  auto faces = facesOf(base);
  for (int step = 0; step < 30; ++step) {  // a point in the middle of a triangle: valences grow apart
    const size_t f = below(faces.size());
    const auto [a, b, c] = std::array<int32_t, 3>{faces[f][0], faces[f][1], faces[f][2]};
    const Vec3f middle = (base.points[a] + base.points[b] + base.points[c]) / 3.0f;
    const int32_t d = int32_t(base.points.size());
    base.points.push_back(normalize(middle) * (0.9f + 0.2f * float(below(1000)) / 1000));
    faces[f] = {a, b, d};
    faces.push_back({b, c, d});
    faces.push_back({c, a, d});
  }
  for (int step = 0; step < 20 && scheme != SubdivisionScheme::Loop; ++step) {  // joins two faces at an edge
    const size_t f = below(faces.size()), k = below(faces[f].size());
    const int32_t a = faces[f][k], b = faces[f][(k + 1) % faces[f].size()];
    for (size_t g = 0; g < faces.size(); ++g) {
      if (g == f) continue;
      auto &one = faces[f], &two = faces[g];
      for (size_t m = 0; m < two.size(); ++m) {
        if (two[m] != b || two[(m + 1) % two.size()] != a) continue;
        std::vector<int32_t> joined;
        for (size_t i = 1; i <= one.size(); ++i) joined.push_back(one[(k + i) % one.size()]);
        for (size_t i = 2; i < two.size(); ++i) joined.push_back(two[(m + i) % two.size()]);
        if (std::set<int32_t>(joined.begin(), joined.end()).size() != joined.size()) continue;  // shares more
        faces[f] = joined;
        faces.erase(faces.begin() + int64_t(g));
        g = faces.size();
        break;
      }
    }
  }
  return makeMesh(base.points, faces, scheme);
}

// Index of each vertex among the distinct positions, which must agree bit for bit.
inline std::vector<uint32_t> weld(const DicedMesh& mesh) {
  std::map<std::array<uint32_t, 3>, uint32_t> known;
  std::vector<uint32_t> welded;
  for (const Vec3f p : mesh.positions) {
    const Vec3f positive_zero = p + Vec3f{0, 0, 0};
    std::array<uint32_t, 3> bits{};
    std::memcpy(bits.data(), &positive_zero, sizeof bits);
    welded.push_back(known.try_emplace(bits, uint32_t(known.size())).first->second);
  }
  return welded;
}

// Edges of welded triangles that are not passed as often one way as the other. A closed surface without
// cracks and T-junctions has none. (Once each way is too much to ask: where two faces meet at a point of
// valence 2, diagonals of both may join the same two points.)
inline size_t openEdges(const DicedMesh& mesh) {
  const auto welded = weld(mesh);
  std::map<std::pair<uint32_t, uint32_t>, int> balance;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const uint32_t a = welded[mesh.triangles[i]], b = welded[mesh.triangles[i % 3 == 2 ? i - 2 : i + 1]];
    balance[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : a > b ? -1 : 0;
  }
  return size_t(std::count_if(balance.begin(), balance.end(), [](const auto& edge) { return edge.second != 0; }));
}

// Longest of the triangles' edges that run along u or v (of triangular primitives: or along u + v). Not
// counted are those that cut off a corner of a triangular primitive: sides of other rates than the lattice's
// end there.
inline double longestGridEdge(const DicedMesh& mesh, bool triangular) {
  double longest = 0;
  const auto sides = [](Vec2f p) {  // one bit per side of the triangle that p lies on
    return (p.y == 0 ? 1 : 0) | (p.x + p.y > 1 - 1e-6f ? 2 : 0) | (p.x == 0 ? 4 : 0);
  };
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const uint32_t a = mesh.triangles[i], b = mesh.triangles[i % 3 == 2 ? i - 2 : i + 1];
    const Vec2f p = mesh.uv[a], q = mesh.uv[b], d = q - p;
    if (d.x != 0 && d.y != 0 && !(triangular && std::abs(d.x + d.y) < 1e-6f)) continue;
    if (triangular && sides(p) && sides(q) && !(sides(p) & sides(q))) continue;
    longest = std::max(longest, length(toDouble(mesh.positions[b]) - toDouble(mesh.positions[a])));
  }
  return longest;
}

inline Vec3d areaVector(const DicedMesh& mesh, size_t triangle) {
  const uint32_t* v = &mesh.triangles[3 * triangle];
  const Vec3d p = toDouble(mesh.positions[v[0]]);
  return cross(toDouble(mesh.positions[v[1]]) - p, toDouble(mesh.positions[v[2]]) - p) * 0.5;
}

// Signed area in (u, v) of each primitive's triangles; of the smallest triangle, too.
inline std::vector<double> parametricAreas(const DicedMesh& mesh, double& smallest) {
  std::vector<double> areas(mesh.primitiveCount(), 0);
  smallest = 1;
  for (size_t t = 0; t < mesh.triangleCount(); ++t) {
    const Vec2f a = mesh.uv[mesh.triangles[3 * t]], b = mesh.uv[mesh.triangles[3 * t + 1]],
                c = mesh.uv[mesh.triangles[3 * t + 2]];
    const double area = ((double(b.x) - a.x) * (double(c.y) - a.y) - (double(b.y) - a.y) * (double(c.x) - a.x)) / 2;
    areas[mesh.triangle_primitive[t]] += area;
    smallest = std::min(smallest, area);
  }
  return areas;
}

}  // namespace encore::test
