// Triangulation of a primitive's (u, v) domain with vertices of its own on every side, so that neighbours
// of different rates share every vertex of their common edge (§3.4: no cracks, no T-junctions).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace encore {

struct ParamCoord {
  double u = 0, v = 0;
};

enum class DomainShape : uint8_t {
  Quad,      // (0,0) (1,0) (1,1) (0,1); sides in that order, side i from corner i to corner i + 1
  Triangle,  // (0,0) (1,0) (0,1)
};

// Ascending parameters from 0 to 1: one more than segments. Uniform: i / n.
using Parameters = std::vector<double>;
Parameters uniformParameters(uint32_t segments);

// Where the vertices of a tessellation lie: along each side, and the lines of the lattice inside.
struct TessellationLines {
  std::array<Parameters, 4> sides;
  Parameters u, v;
};

// Quad: inside lies the lattice of the nu - 1 inner lines of u and nv - 1 of v.
// Triangle: inside lies the lattice (i / nu, j / nu), 0 < i, 0 < j, i + j < nu; nv and sides[3] are unused.
// Between the lattice and the sides run strips. Where a side's vertices lie on the lattice's lines, the
// strip is part of the regular grid.
struct Tessellation {
  DomainShape shape = DomainShape::Quad;
  std::array<uint32_t, 4> sides{1, 1, 1, 1};  // segments
  uint32_t nu = 1, nv = 1;                    // segments of the lattice's lines

  int sideCount() const { return shape == DomainShape::Quad ? 4 : 3; }
  uint64_t boundaryCount() const;
  uint64_t interiorCount() const;
  uint64_t vertexCount() const { return boundaryCount() + interiorCount(); }
  uint64_t triangleCount() const { return boundaryCount() + 2 * interiorCount() - 2; }
  // Quad: cells of the grid (two triangles each). Triangle: facets.
  uint64_t micropolygons() const;

  TessellationLines uniformLines() const;
  // Vertices: the boundary, counterclockwise from corner 0 (a corner opens its side), then the lattice,
  // u fastest. Replaces the contents of coords. lines agree with this in number.
  void coordinates(const TessellationLines& lines, std::vector<ParamCoord>& coords) const;
  // Counterclockwise in (u, v), 3 indices each; together they cover the domain exactly once.
  void triangles(const TessellationLines& lines, std::vector<uint32_t>& indices) const;
};

// The tessellation of least inner rates >= (nu, nv) and >= the sides' that there is. Preconditions:
// rates >= 1.
Tessellation fitTessellation(DomainShape shape, std::array<uint32_t, 4> sides, uint32_t nu, uint32_t nv);

}  // namespace encore
