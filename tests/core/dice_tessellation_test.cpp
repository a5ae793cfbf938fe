// Triangulations of primitives: they cover the domain once, and meet their neighbours.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "core/dice/tessellation.h"

namespace encore {
namespace {

struct Pattern {
  std::vector<ParamCoord> coords;
  std::vector<uint32_t> triangles;
};

Pattern build(const Tessellation& t, const TessellationLines& lines) {
  Pattern pattern;
  t.coordinates(lines, pattern.coords);
  t.triangles(lines, pattern.triangles);
  return pattern;
}
Pattern build(const Tessellation& t) { return build(t, t.uniformLines()); }

double area(const Pattern& p, size_t triangle) {
  const ParamCoord a = p.coords[p.triangles[3 * triangle]], b = p.coords[p.triangles[3 * triangle + 1]],
                   c = p.coords[p.triangles[3 * triangle + 2]];
  return ((b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u)) / 2;
}

// Counterclockwise triangles of positive area that sum up to the domain's, every inner edge used once in
// each direction, every outer edge the next step of the boundary: then they cover it exactly once.
void expectCover(const Tessellation& t, const TessellationLines& lines) {
  const Pattern p = build(t, lines);
  ASSERT_EQ(p.coords.size(), t.vertexCount());
  ASSERT_EQ(p.triangles.size(), 3 * t.triangleCount());
  double sum = 0;
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (size_t i = 0; i < t.triangleCount(); ++i) {
    ASSERT_GT(area(p, i), 1e-12);
    sum += area(p, i);
    for (int k = 0; k < 3; ++k) ++edges[{p.triangles[3 * i + k], p.triangles[3 * i + (k + 1) % 3]}];
  }
  EXPECT_NEAR(sum, t.shape == DomainShape::Quad ? 1.0 : 0.5, 1e-12);
  const uint32_t boundary = uint32_t(t.boundaryCount());
  for (const auto& [edge, count] : edges) {
    ASSERT_EQ(count, 1);
    if (!edges.contains({edge.second, edge.first})) {
      ASSERT_EQ(edge.second, (edge.first + 1) % boundary);
      ASSERT_LT(edge.first, boundary);
    }
  }
  for (uint32_t i = 0; i < boundary; ++i) {
    EXPECT_TRUE(edges.contains({i, (i + 1) % boundary}));
  }
}

void expectCover(const Tessellation& t) { expectCover(t, t.uniformLines()); }

TEST(Tessellation, CoversQuadsOfAllSmallRates) {
  for (uint32_t a = 1; a <= 4; ++a)
    for (uint32_t b = 1; b <= 4; ++b)
      for (uint32_t c = 1; c <= 4; ++c)
        for (uint32_t d = 1; d <= 4; ++d)
          for (uint32_t n = 1; n <= 4; ++n)
            for (uint32_t m = 1; m <= 4; ++m) expectCover(fitTessellation(DomainShape::Quad, {a, b, c, d}, n, m));
}

TEST(Tessellation, CoversTrianglesOfAllSmallRates) {
  for (uint32_t a = 1; a <= 6; ++a)
    for (uint32_t b = 1; b <= 6; ++b)
      for (uint32_t c = 1; c <= 6; ++c)
        for (uint32_t n = 1; n <= 7; ++n) expectCover(fitTessellation(DomainShape::Triangle, {a, b, c, 1}, n, 1));
}

TEST(Tessellation, CoversRandomRates) {
  std::mt19937 random(5);
  for (int i = 0; i < 60; ++i) {
    const auto rate = [&] { return uint32_t(1 + random() % (i % 3 == 0 ? 5 : 70)); };
    expectCover(fitTessellation(DomainShape::Quad, {rate(), rate(), rate(), rate()}, rate(), rate()));
    expectCover(fitTessellation(DomainShape::Triangle, {rate(), rate(), rate(), 1}, rate(), 1));
  }
}

// Vertices anywhere along the sides, lines anywhere inside, and more on the sides than inside.
TEST(Tessellation, CoversQuadsOfUnevenParameters) {
  std::mt19937 random(6);
  for (int i = 0; i < 60; ++i) {
    const auto rate = [&] { return uint32_t(2 + random() % 30); };
    const auto uneven = [&](uint32_t n) {
      Parameters p{0, 1};
      while (p.size() < n + 1) {
        const double t = double(1 + random() % 4095) / 4096;
        if (std::find(p.begin(), p.end(), t) == p.end()) p.push_back(t);
      }
      std::sort(p.begin(), p.end());
      return p;
    };
    const Tessellation t{DomainShape::Quad, {rate(), rate(), rate(), rate()}, rate(), rate()};
    TessellationLines lines;
    for (int s = 0; s < 4; ++s) lines.sides[s] = uneven(t.sides[s]);
    lines.u = uneven(t.nu);
    lines.v = uneven(t.nv);
    expectCover(t, lines);
  }
}

TEST(Tessellation, EqualRatesMakeARegularGrid) {
  const Tessellation t = fitTessellation(DomainShape::Quad, {5, 3, 5, 3}, 1, 1);
  EXPECT_EQ(t.nu, 5u);
  EXPECT_EQ(t.nv, 3u);
  EXPECT_EQ(t.micropolygons(), 15u);
  EXPECT_EQ(t.vertexCount(), 24u);
  const Pattern p = build(t);
  std::map<std::pair<int, int>, int> cells;  // each cell holds two triangles that lie inside it
  for (size_t i = 0; i < t.triangleCount(); ++i) {
    double u = 0, v = 0, lu = 1, hu = 0, lv = 1, hv = 0;
    for (int k = 0; k < 3; ++k) {
      const ParamCoord c = p.coords[p.triangles[3 * i + k]];
      u += c.u / 3, v += c.v / 3;
      lu = std::min(lu, c.u), hu = std::max(hu, c.u), lv = std::min(lv, c.v), hv = std::max(hv, c.v);
    }
    EXPECT_NEAR(hu - lu, 1.0 / 5, 1e-12);
    EXPECT_NEAR(hv - lv, 1.0 / 3, 1e-12);
    ++cells[{int(u * 5), int(v * 3)}];
  }
  EXPECT_EQ(cells.size(), 15u);
  for (const auto& [cell, count] : cells) EXPECT_EQ(count, 2);
}

// Edges of the regular triangular lattice: along u, v and u + v, all of length 1 / m.
TEST(Tessellation, EqualRatesMakeARegularTriangularLattice) {
  for (uint32_t m = 1; m <= 9; ++m) {
    const Tessellation t = fitTessellation(DomainShape::Triangle, {m, m, m, 1}, m, 1);
    EXPECT_EQ(t.triangleCount(), uint64_t(m) * m);
    const Pattern p = build(t);
    for (size_t i = 0; i < p.triangles.size(); ++i) {
      const ParamCoord a = p.coords[p.triangles[i]], b = p.coords[p.triangles[i % 3 == 2 ? i - 2 : i + 1]];
      const double x = (b.u - a.u) * m, y = (b.v - a.v) * m;
      EXPECT_NEAR(x * x + y * y + x * y, 1.0, 1e-9) << "m = " << m;
    }
  }
}

TEST(Tessellation, BoundaryVerticesAreEvenlySpacedAndExactAtCorners) {
  const Tessellation t = fitTessellation(DomainShape::Quad, {2, 3, 1, 4}, 1, 1);
  const Pattern p = build(t);
  const std::vector<ParamCoord> expected{{0, 0}, {0.5, 0}, {1, 0},    {1, 1.0 / 3}, {1, 2.0 / 3},
                                         {1, 1}, {0, 1},   {0, 0.75}, {0, 0.5},     {0, 0.25}};
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_DOUBLE_EQ(p.coords[i].u, expected[i].u) << i;
    EXPECT_DOUBLE_EQ(p.coords[i].v, expected[i].v) << i;
  }
}

}  // namespace
}  // namespace encore
