#include "core/dice/tessellation.h"

#include <algorithm>

namespace encore {
namespace {

// A row of vertices on a side, or on the lattice's line beside it; vertex i lies at at(i) along the side.
template <class Index, class At>
struct Row {
  uint32_t count;
  Index index;
  At at;

  // Twice the position of the middle of segment i.
  double middle(uint32_t i) const { return at(i) + at(i + 1); }
};
template <class Index, class At>
Row(uint32_t, Index, At) -> Row<Index, At>;

using Indices = std::vector<uint32_t>;

void emit(Indices& out, uint32_t a, uint32_t b, uint32_t c) { out.insert(out.end(), {a, b, c}); }

// Fills the strip between two rows that run the same way, inner on the left of outer. Each step advances
// on the row whose next segment has its middle first; every order would be a valid triangulation.
// Equal middles, up to rounding, go to the outer row, so that regular grids look alike on all sides.
template <class Outer, class Inner>
void zip(const Outer& outer, const Inner& inner, Indices& out) {
  uint32_t i = 0, j = 0;
  while (i + 1 < outer.count || j + 1 < inner.count) {
    if (j + 1 == inner.count || (i + 1 < outer.count && outer.middle(i) <= inner.middle(j) + 1e-12)) {
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

auto sideRow(const Tessellation& t, const TessellationLines& lines, int side) {
  const uint32_t first = sideFirst(t, side), ring = uint32_t(t.boundaryCount());
  const Parameters& at = lines.sides[side];
  return Row(
      t.sides[side] + 1, [first, ring](uint32_t i) { return first + i == ring ? 0 : first + i; },
      [&at](uint32_t i) { return at[i]; });
}

// Without a lattice (one of the rates is 1), a quad is one strip between opposite sides.
void quadStrip(const Tessellation& t, const TessellationLines& lines, Indices& out) {
  const int outer = t.nv == 1 ? 0 : 3;  // side 3 runs down; side 1 lies on its left
  const auto opposite = sideRow(t, lines, outer == 0 ? 2 : 1);
  const uint32_t last = opposite.count - 1;
  zip(sideRow(t, lines, outer),
      Row(
          opposite.count, [&](uint32_t i) { return opposite.index(last - i); },
          [&](uint32_t i) { return 1 - opposite.at(last - i); }),
      out);
}

void quadTriangles(const Tessellation& t, const TessellationLines& lines, Indices& out) {
  if (t.nu == 1 || t.nv == 1) return quadStrip(t, lines, out);
  const uint32_t base = uint32_t(t.boundaryCount()), columns = t.nu - 1, rows = t.nv - 1;
  const auto lattice = [base, columns](uint32_t i, uint32_t j) { return base + j * columns + i; };
  const auto up = [](const Parameters& p) { return [&p](uint32_t k) { return p[k + 1]; }; };
  const auto down = [](const Parameters& p) { return [&p](uint32_t k) { return 1 - p[p.size() - 2 - k]; }; };
  const auto strip = [&](int side, uint32_t count, const auto& index, const auto& at) {
    zip(sideRow(t, lines, side), Row(count, index, at), out);
  };
  strip(0, columns, [&](uint32_t k) { return lattice(k, 0); }, up(lines.u));
  strip(1, rows, [&](uint32_t k) { return lattice(columns - 1, k); }, up(lines.v));
  strip(2, columns, [&](uint32_t k) { return lattice(columns - 1 - k, rows - 1); }, down(lines.u));
  strip(3, rows, [&](uint32_t k) { return lattice(0, rows - 1 - k); }, down(lines.v));
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

void triangleTriangles(const Tessellation& t, const TessellationLines& lines, Indices& out) {
  const uint32_t base = uint32_t(t.boundaryCount()), m = t.nu;
  if (m == 1) return emit(out, 0, 1, 2);
  if (m == 2) {  // every side has rate 2 (fitTessellation)
    emit(out, 1, 2, 3), emit(out, 3, 4, 5), emit(out, 5, 0, 1), emit(out, 1, 3, 5);
    return;
  }
  const auto lattice = [base, m](uint32_t i, uint32_t j) { return base + triangleRank(m, i, j); };
  // The lattice's line beside a side starts and ends half a segment further in.
  const auto at = [m](uint32_t k) { return (k + 1.5) / m; };
  std::array<size_t, 4> strip{};
  zip(sideRow(t, lines, 0), Row(m - 2, [&](uint32_t k) { return lattice(1 + k, 1); }, at), out);
  strip[1] = out.size();
  zip(sideRow(t, lines, 1), Row(m - 2, [&](uint32_t k) { return lattice(m - 2 - k, 1 + k); }, at), out);
  strip[2] = out.size();
  zip(sideRow(t, lines, 2), Row(m - 2, [&](uint32_t k) { return lattice(1, m - 2 - k); }, at), out);
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

// From corner coordinate a to b, both 0 or 1.
double along(double a, double b, double t) { return a == b ? a : a < b ? t : 1 - t; }

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
  return shape == DomainShape::Quad ? (triangleCount() + 1) / 2 : triangleCount();
}

TessellationLines Tessellation::uniformLines() const {
  TessellationLines lines;
  for (int s = 0; s < sideCount(); ++s) lines.sides[s] = uniformParameters(sides[s]);
  lines.u = uniformParameters(nu);
  lines.v = uniformParameters(nv);
  return lines;
}

void Tessellation::coordinates(const TessellationLines& lines, std::vector<ParamCoord>& coords) const {
  coords.clear();
  coords.reserve(vertexCount());
  for (int s = 0; s < sideCount(); ++s) {
    const ParamCoord a = corner(shape, s), b = corner(shape, s + 1);
    for (uint32_t i = 0; i < sides[s]; ++i) {
      const double t = lines.sides[s][i];
      coords.push_back({along(a.u, b.u, t), along(a.v, b.v, t)});
    }
  }
  const bool quad = shape == DomainShape::Quad;
  const Parameters& v = quad ? lines.v : lines.u;
  for (uint32_t j = 1; j + 1 < v.size(); ++j)
    for (uint32_t i = 1; i + (quad ? 0 : j) < nu; ++i) coords.push_back({lines.u[i], v[j]});
}

void Tessellation::triangles(const TessellationLines& lines, std::vector<uint32_t>& indices) const {
  indices.clear();
  indices.reserve(3 * triangleCount());
  shape == DomainShape::Quad ? quadTriangles(*this, lines, indices) : triangleTriangles(*this, lines, indices);
}

Parameters uniformParameters(uint32_t segments) {
  Parameters parameters(segments + 1);
  for (uint32_t i = 0; i <= segments; ++i) parameters[i] = double(i) / segments;
  return parameters;
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
