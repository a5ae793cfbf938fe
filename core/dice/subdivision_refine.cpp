// Rates of displaced grids: SubdivisionDicer::refine.
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/dice/chords.h"
#include "core/dice/subdivision.h"

namespace encore {
namespace {

constexpr uint32_t kNone = 0xffffffffu;

// Triangles have uniform lattices only.
bool stretchUniformly(Spacing& spacing, double longest, double allowed, double most_rate) {
  return spacing.refineUniformly(std::min(longest, allowed * std::max(1.0, most_rate / spacing.rate())));
}

}  // namespace

// The chords of displaced grids, between vertices that are there.
class SubdivisionDicer::Stretch {
 public:
  Stretch(const SubdivisionDicer& dicer, const DicedMesh& displaced, const Grids& grids)
      : dicer_(dicer),
        mesh_(displaced),
        grids_(grids),
        edges_(dicer.shared_.edgeCount()),
        inside_(dicer.primitives_.size()) {
    tbb::parallel_for(tbb::blocked_range<int32_t>(0, dicer.faceCount()), [&](const tbb::blocked_range<int32_t>& range) {
      for (int32_t face = range.begin(); face != range.end(); ++face)
        for (uint32_t i = dicer.first_primitive_[face]; i < dicer.first_primitive_[face + 1]; ++i) measure(i);
    });
  }

  const ChordLengths& edge(uint32_t edge) const { return edges_[edge]; }
  // Of undiced faces: nothing.
  const GridChords& inside(size_t primitive) const { return inside_[primitive]; }

  double most() const {
    double most = 0;
    for (const ChordLengths& edge : edges_) most = std::max(most, edge.most());
    for (const GridChords& grid : inside_) most = std::max({most, grid.u.most(), grid.v.most(), grid.across});
    return most;
  }

 private:
  double chordOf(size_t a, size_t b) const {
    double longest = 0;
    for (size_t pose = 0; pose < poseCount(mesh_); ++pose)
      longest = std::max(longest, chord(posedPositions(mesh_, pose)[a], posedPositions(mesh_, pose)[b]));
    return longest;
  }

  void measure(uint32_t index) {
    const Primitive& primitive = dicer_.primitives_[index];
    const Tessellation t = dicer_.tessellation(primitive);
    uint32_t first = 0;
    for (int s = 0; s < t.sideCount(); first += t.sides[s++]) measureSide(index, primitive, s, first);
    if (!dicer_.isDiced(primitive.face)) return;
    t.shape == DomainShape::Quad ? measureQuad(index, primitive, t) : measureTriangle(index);
  }

  // Each edge is measured by the face that owns it: of a split face, edges inside by the quads they leave.
  void measureSide(uint32_t index, const Primitive& primitive, int s, uint32_t first) {
    const PrimitiveSide side = dicer_.shared_.side(primitive.face, primitive.corner, s);
    const bool inner = dicer_.topology_.isSplit(primitive.face) && (s == 1 || s == 2);
    if (!dicer_.shared_.isOwned(side.edge, primitive.face) || (inner && s == 2)) return;
    if (!dicer_.isDicedEdge(side.edge, primitive.face)) return;
    ChordLengths& edge = edges_[side.edge];
    edge.longest.resize(dicer_.shared_.rate(side.edge), 0);
    const size_t base = grids_.first_vertex[index], ring = grids_.ringSize(index);
    for (uint32_t i = 0; i < side.count; ++i) {
      const double length = chordOf(base + first + i, base + (first + i + 1) % ring);
      const int64_t from = int64_t(side.first) + int64_t(side.step) * i;
      edge.longest[size_t(std::min(from, from + side.step))] = length;
      edge.line += length;
    }
  }

  // Lines of the lattice, as far as they end in vertices of the sides.
  void measureQuad(uint32_t index, const Primitive& primitive, const Tessellation& t) {
    TessellationLines lines;
    dicer_.findLines(primitive, t, lines);
    GridChords& chords = inside_[index];
    chords.u.longest.assign(t.nu, 0);
    chords.v.longest.assign(t.nv, 0);
    const size_t base = grids_.first_vertex[index];
    std::vector<double> column(t.nu + 1, 0);
    std::vector<uint32_t> row(t.nu + 1, kNone), below(t.nu + 1, kNone);
    for (uint32_t j = 0; j <= t.nv; ++j, std::swap(row, below)) {
      double line = 0;
      for (uint32_t i = 0; i <= t.nu; ++i) {
        row[i] = vertex(t, lines, i, j);
        if (row[i] == kNone) continue;
        if (i > 0 && row[i - 1] != kNone) {
          const double along = chordOf(base + row[i - 1], base + row[i]);
          chords.u.longest[i - 1] = std::max(chords.u.longest[i - 1], along);
          line += along;
        }
        if (j > 0 && below[i] != kNone) {
          const double along = chordOf(base + below[i], base + row[i]);
          chords.v.longest[j - 1] = std::max(chords.v.longest[j - 1], along);
          column[i] += along;
        }
      }
      chords.u.line = std::max(chords.u.line, line);
    }
    chords.v.line = *std::max_element(column.begin(), column.end());
  }

  // The vertex at line i of u and line j of v, if there is one.
  static uint32_t vertex(const Tessellation& t, const TessellationLines& lines, uint32_t i, uint32_t j) {
    if (i > 0 && i < t.nu && j > 0 && j < t.nv) return uint32_t(t.boundaryCount()) + (j - 1) * (t.nu - 1) + i - 1;
    if (j == 0) return onSide(t, lines, 0, lines.u[i]);
    if (i == t.nu) return onSide(t, lines, 1, lines.v[j]);
    if (j == t.nv) return onSide(t, lines, 2, 1 - lines.u[i]);
    return onSide(t, lines, 3, 1 - lines.v[j]);
  }
  static uint32_t onSide(const Tessellation& t, const TessellationLines& lines, int side, double at) {
    const Parameters& parameters = lines.sides[side];
    const auto found = std::lower_bound(parameters.begin(), parameters.end(), at - 1e-9);
    if (found == parameters.end() || *found > at + 1e-9) return kNone;
    uint32_t index = uint32_t(found - parameters.begin());
    for (int s = 0; s < side; ++s) index += t.sides[s];
    return index % uint32_t(t.boundaryCount());
  }

  // Edges of the triangles along the lattice's three directions; but not those that cut off a corner, where sides
  // of other rates end.
  void measureTriangle(uint32_t index) {
    for (size_t i = 3 * grids_.first_triangle[index]; i < 3 * grids_.first_triangle[index + 1]; ++i) {
      const uint32_t a = mesh_.triangles[i], b = mesh_.triangles[i % 3 == 2 ? i - 2 : i + 1];
      const Vec2f p = mesh_.uv[a], q = mesh_.uv[b], d = q - p;
      if (d.x != 0 && d.y != 0 && std::abs(d.x + d.y) > 1e-6f) continue;
      if (sidesAt(p) && sidesAt(q) && !(sidesAt(p) & sidesAt(q))) continue;
      inside_[index].across = std::max(inside_[index].across, chordOf(a, b));
    }
  }
  static int sidesAt(Vec2f p) { return (p.y == 0 ? 1 : 0) | (p.x + p.y > 1 - 1e-6f ? 2 : 0) | (p.x == 0 ? 4 : 0); }

  const SubdivisionDicer& dicer_;
  const DicedMesh& mesh_;
  const Grids& grids_;
  std::vector<ChordLengths> edges_;
  std::vector<GridChords> inside_;
};

bool SubdivisionDicer::refine(const DicedMesh& displaced, const Grids& grids) {
  const Stretch stretch(*this, displaced, grids);
  if (!(stretch.most() > allowed_ * kStretchTolerance)) return false;
  if (first_rates_.edges.empty()) {
    for (uint32_t edge = 0; edge < shared_.edgeCount(); ++edge) first_rates_.edges.push_back(shared_.rate(edge));
    for (const Primitive& primitive : primitives_) {
      const Tessellation t = tessellation(primitive);
      first_rates_.u.push_back(t.nu);
      first_rates_.v.push_back(t.nv);
    }
  }
  stretchGrids(stretch);  // which starts from what the edges have been until now
  stretchEdges(stretch);
  const uint64_t before = micropolygons_;
  count();
  return micropolygons_ != before;
}

void SubdivisionDicer::stretchEdges(const Stretch& stretch) {
  const bool quad = topology_.shape() == DomainShape::Quad;
  const auto refineEdge = [&](uint32_t edge, const auto& curve) {
    const ChordLengths& chords = stretch.edge(edge);
    if (!(chords.most() > allowed_)) return;
    const uint32_t rate = shared_.rate(edge);
    const bool uniform = shared_.edgeParameters(edge).empty();
    Spacing spacing(uniform ? uniformParameters(rate) : shared_.edgeParameters(edge), uniform, allowed_,
                    shared_.hasMiddle(edge));
    const double most_rate = double(kMostStretch) * first_rates_.edges[edge];
    if (!(quad ? spacing.stretch(chords, most_rate) : stretchUniformly(spacing, chords.most(), allowed_, most_rate)))
      return;
    const size_t poses = poses_.count();
    std::vector<Vec3f> points;
    curveChords(curve, spacing.parameters(), poses, points);
    shared_.setRate(edge, spacing.rate());
    shared_.setPoints(edge, spacing.uniform() ? Parameters{} : spacing.parameters(),
                      std::vector<Vec3f>(points.begin() + int64_t(poses), points.end() - int64_t(poses)));
  };
  tbb::parallel_for(tbb::blocked_range<int32_t>(0, faceCount()), [&](const tbb::blocked_range<int32_t>& range) {
    LimitSurface surface = positionSurface();
    for (int32_t face = range.begin(); face != range.end(); ++face) {
      if (!topology_.hasLimit(face)) continue;
      surface.bind(face);
      shared_.visitOwnedEdges(face, surface, refineEdge);
    }
  });
}

void SubdivisionDicer::stretchGrids(const Stretch& stretch) {
  for (size_t i = 0; i < primitives_.size(); ++i) {
    Primitive& primitive = primitives_[i];
    if (!isDiced(primitive.face)) continue;
    const Tessellation t = tessellation(primitive);
    const GridChords& chords = stretch.inside(i);
    if (t.shape == DomainShape::Triangle) {
      Spacing spacing(t.nu, allowed_);
      if (stretchUniformly(spacing, chords.across, allowed_, double(kMostStretch) * first_rates_.u[i]))
        primitive.nu = spacing.rate();
      continue;
    }
    const bool uniform = !primitive.lattice;
    const auto spacingOf = [&](uint32_t rate, const Parameters* lines) {
      return Spacing(uniform ? uniformParameters(rate) : *lines, uniform, allowed_, false);
    };
    Spacing u = spacingOf(t.nu, uniform ? nullptr : &primitive.lattice->u);
    Spacing v = spacingOf(t.nv, uniform ? nullptr : &primitive.lattice->v);
    const bool finer_u = u.stretch(chords.u, double(kMostStretch) * first_rates_.u[i]);
    const bool finer_v = v.stretch(chords.v, double(kMostStretch) * first_rates_.v[i]);
    if (!finer_u && !finer_v) continue;
    primitive.nu = u.rate();
    primitive.nv = v.rate();
    primitive.lattice.reset(u.uniform() && v.uniform() ? nullptr : new Lattice{u.parameters(), v.parameters()});
  }
}

}  // namespace encore
