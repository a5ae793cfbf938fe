#include "core/dice/tessellation.h"

#include <algorithm>

namespace encore {
namespace {

// A row of vertices beside or on a side; vertex i lies at (i + offset) * spacing along the side.
template <class Index>
struct Row {
  Index index;
  uint32_t count;
  double offset, spacing;

  // Twice the position of the middle of segment i.
  double middle(uint32_t i) const { return (2.0 * (i + offset) + 1.0) * spacing; }
};
template <class Index>
Row(Index, uint32_t, double, double) -> Row<Index>;

using Indices = std::vector<uint32_t>;

void emit(Indices& out, uint32_t a, uint32_t b, uint32_t c) { out.insert(out.end(), {a, b, c}); }

// Fills the strip between two rows that run the same way, inner on the left of outer. Each step advances
// on the row whose next segment has its middle first; every order would be a valid triangulation.
template <class Outer, class Inner>
void zip(const Row<Outer>& outer, const Row<Inner>& inner, Indices& out) {
  uint32_t i = 0, j = 0;
  while (i + 1 < outer.count || j + 1 < inner.count) {
    if (j + 1 == inner.count || (i + 1 < outer.count && outer.middle(i) <= inner.middle(j))) {
      emit(out, outer.index(i), outer.index(i + 1), inner.index(j));
      ++i;
    } else {
      emit(out, outer.index(i), inner.index(j + 1), inner.index(j));
      ++j;
    }
  }
}

uint32_t sideFirst(const Tessellation& t, int side) {
  uint32_t first = 0;
  for (int s = 0; s < side; ++s) first += t.sides[s];
  return first;
}

auto sideRow(const Tessellation& t, int side) {
  const uint32_t first = sideFirst(t, side), ring = uint32_t(t.boundaryCount());
  return Row([first, ring](uint32_t i) { return first + i == ring ? 0 : first + i; }, t.sides[side] + 1, 0.0,
             1.0 / t.sides[side]);
}

// Without a lattice (one of the rates is 1), a quad is one strip between opposite sides.
void quadStrip(const Tessellation& t, Indices& out) {
  const int outer = t.nv == 1 ? 0 : 3;  // side 3 runs down; side 1 lies on its left
  const auto opposite = sideRow(t, outer == 0 ? 2 : 1);
  const auto reversed = [&opposite](uint32_t i) { return opposite.index(opposite.count - 1 - i); };
  zip(sideRow(t, outer), Row(reversed, opposite.count, 0.0, opposite.spacing), out);
}

void quadTriangles(const Tessellation& t, Indices& out) {
  if (t.nu == 1 || t.nv == 1) return quadStrip(t, out);
  const uint32_t base = uint32_t(t.boundaryCount()), columns = t.nu - 1, rows = t.nv - 1;
  const auto lattice = [base, columns](uint32_t i, uint32_t j) { return base + j * columns + i; };
  const double u = 1.0 / t.nu, v = 1.0 / t.nv;
  zip(sideRow(t, 0), Row([&](uint32_t k) { return lattice(k, 0); }, columns, 1.0, u), out);
  zip(sideRow(t, 1), Row([&](uint32_t k) { return lattice(columns - 1, k); }, rows, 1.0, v), out);
  zip(sideRow(t, 2), Row([&](uint32_t k) { return lattice(columns - 1 - k, rows - 1); }, columns, 1.0, u), out);
  zip(sideRow(t, 3), Row([&](uint32_t k) { return lattice(0, rows - 1 - k); }, rows, 1.0, v), out);
  for (uint32_t j = 0; j + 1 < rows; ++j)
    for (uint32_t i = 0; i + 1 < columns; ++i) {
      emit(out, lattice(i, j), lattice(i + 1, j), lattice(i + 1, j + 1));
      emit(out, lattice(i, j), lattice(i + 1, j + 1), lattice(i, j + 1));
    }
}

// Rank of lattice point (i, j) of a triangle of rate m: row j (from 1) holds m - 1 - j points.
uint32_t triangleRank(uint64_t m, uint64_t i, uint64_t j) {
  return uint32_t((j - 1) * (m - 1) - (j - 1) * j / 2 + (i - 1));
}

// The kite at a corner (the corner c, the next vertices a and b on its two sides, the lattice's corner q)
// has the diagonal a-b in the regular grid; the strips leave c-q. Takes a-b where it is the shorter one
// on an equilateral triangle. first, last: where the corner's strip begins, and the one before it ends.
void turnDiagonal(const Tessellation& t, int corner, size_t first, size_t last, Indices& out) {
  uint32_t *one = &out[first], *two = &out[last];
  const uint32_t c = one[0], a = one[1], q = one[2], b = two[0];
  if (two[1] != c || two[2] != q) return;  // a strip does not meet the corner with its side
  const double n = t.sides[corner], n_before = t.sides[(corner + 2) % 3], m = t.nu;
  if (1 / (n * n) + 1 / (n_before * n_before) - 1 / (n * n_before) >= 3 / (m * m)) return;
  if (n + n_before <= m) return;  // not convex
  one[0] = c, one[1] = a, one[2] = b;
  two[0] = a, two[1] = q, two[2] = b;
}

void triangleTriangles(const Tessellation& t, Indices& out) {
  const uint32_t base = uint32_t(t.boundaryCount()), m = t.nu;
  if (m == 1) return emit(out, 0, 1, 2);
  if (m == 2) {  // every side has rate 2 (fitTessellation)
    emit(out, 1, 2, 3), emit(out, 3, 4, 5), emit(out, 5, 0, 1), emit(out, 1, 3, 5);
    return;
  }
  const auto lattice = [base, m](uint32_t i, uint32_t j) { return base + triangleRank(m, i, j); };
  const double spacing = 1.0 / m;
  std::array<size_t, 4> strip{};
  zip(sideRow(t, 0), Row([&](uint32_t k) { return lattice(1 + k, 1); }, m - 2, 1.5, spacing), out);
  strip[1] = out.size();
  zip(sideRow(t, 1), Row([&](uint32_t k) { return lattice(m - 2 - k, 1 + k); }, m - 2, 1.5, spacing), out);
  strip[2] = out.size();
  zip(sideRow(t, 2), Row([&](uint32_t k) { return lattice(1, m - 2 - k); }, m - 2, 1.5, spacing), out);
  strip[3] = out.size();
  for (int corner = 0; corner < 3; ++corner)
    turnDiagonal(t, corner, strip[corner], strip[corner == 0 ? 3 : corner] - 3, out);
  for (uint32_t j = 1; j + 2 < m; ++j)
    for (uint32_t i = 1; i + j + 1 < m; ++i) {
      emit(out, lattice(i, j), lattice(i + 1, j), lattice(i, j + 1));
      if (i + j + 2 < m) emit(out, lattice(i + 1, j), lattice(i + 1, j + 1), lattice(i, j + 1));
    }
}

ParamCoord corner(DomainShape shape, int i) {
  constexpr std::array<ParamCoord, 4> kQuad{{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
  constexpr std::array<ParamCoord, 3> kTriangle{{{0, 0}, {1, 0}, {0, 1}}};
  return shape == DomainShape::Quad ? kQuad[i % 4] : kTriangle[i % 3];
}

}  // namespace

uint64_t Tessellation::boundaryCount() const {
  uint64_t count = 0;
  for (int s = 0; s < sideCount(); ++s) count += sides[s];
  return count;
}

uint64_t Tessellation::interiorCount() const {
  if (shape == DomainShape::Quad) return uint64_t(nu - 1) * (nv - 1);
  return nu < 3 ? 0 : uint64_t(nu - 1) * (nu - 2) / 2;
}

uint64_t Tessellation::micropolygons() const {
  return shape == DomainShape::Quad ? uint64_t(nu) * nv : triangleCount();
}

void Tessellation::coordinates(std::vector<ParamCoord>& coords) const {
  coords.clear();
  coords.reserve(vertexCount());
  for (int s = 0; s < sideCount(); ++s) {
    const ParamCoord a = corner(shape, s), b = corner(shape, s + 1);
    for (uint32_t i = 0; i < sides[s]; ++i) {
      // Exact on the axes: one of the two terms is 0, or a coordinate is constant.
      const double t = double(i) / sides[s], r = double(sides[s] - i) / sides[s];
      const auto mix = [t, r](double x, double y) { return x == y ? x : x * r + y * t; };
      coords.push_back({mix(a.u, b.u), mix(a.v, b.v)});
    }
  }
  const bool quad = shape == DomainShape::Quad;
  for (uint32_t j = 1; j < (quad ? nv : nu); ++j)
    for (uint32_t i = 1; i + (quad ? 0 : j) < nu; ++i) coords.push_back({double(i) / nu, double(j) / (quad ? nv : nu)});
}

void Tessellation::triangles(std::vector<uint32_t>& indices) const {
  indices.clear();
  indices.reserve(3 * triangleCount());
  shape == DomainShape::Quad ? quadTriangles(*this, indices) : triangleTriangles(*this, indices);
}

Tessellation fitTessellation(DomainShape shape, std::array<uint32_t, 4> sides, uint32_t nu, uint32_t nv) {
  if (shape == DomainShape::Quad)
    return {shape, sides, std::max({nu, sides[0], sides[2]}), std::max({nv, sides[1], sides[3]})};
  const uint32_t m = std::max({nu, sides[0], sides[1], sides[2]});
  const bool uniform = sides[0] == m && sides[1] == m && sides[2] == m;
  // Unequal sides need a point inside to meet at.
  return {shape, sides, uniform ? m : std::max(m, 3u), 1};
}

}  // namespace encore
