#include "core/dice/subdivision.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "core/dice/micropolygon_cap.h"
#include "core/scene/error.h"

namespace encore {
namespace {

// Segments per side of the coarse measurement that rates start from: it sees curves that come back to
// where they began, which the chords of a rate of 1 would not.
constexpr uint32_t kCoarse = 4;
// Far above every useful rate; sums of four fit uint32_t.
constexpr uint32_t kMaxRate = 1u << 28;

// Lengths of chords are measured between the float positions that are output.
double chord(Vec3f a, Vec3f b) { return length(toDouble(b) - toDouble(a)); }

uint32_t toRate(double rate) { return rate < kMaxRate ? std::max(1u, uint32_t(std::ceil(rate))) : kMaxRate; }

// The rate that should bring the longest chord down to allowed; grows by at least one.
uint32_t raised(uint32_t rate, double longest, double allowed) {
  return std::max(std::min(rate + 1, kMaxRate), toRate(rate * (longest / allowed)));
}

uint32_t roundedUp(uint32_t rate, bool even) { return even ? rate + rate % 2 : rate; }

Vec3f position(const LimitSurface& surface, int32_t corner, ParamCoord at) {
  double p[3];
  surface.evaluate(corner, at, p);
  return toFloat(Vec3d{p[0], p[1], p[2]});
}

// Longest chords of the (nu, nv) lattice on a primitive, borders included: along u, along v, and, of the
// lattice of a triangle, across. Holds one row at a time.
std::array<double, 3> longestChords(const LimitSurface& surface, int32_t corner, DomainShape shape, uint32_t nu,
                                    uint32_t nv) {
  const bool quad = shape == DomainShape::Quad;
  std::array<double, 3> longest{};
  std::vector<Vec3f> row(nu + 1), below(nu + 1);
  for (uint32_t j = 0; j <= nv; ++j) {
    const uint32_t end = quad ? nu : nu - j;
    for (uint32_t i = 0; i <= end; ++i) {
      row[i] = position(surface, corner, {double(i) / nu, double(j) / nv});
      if (i > 0) longest[0] = std::max(longest[0], chord(row[i - 1], row[i]));
      if (j > 0) longest[1] = std::max(longest[1], chord(below[i], row[i]));
      if (j > 0 && !quad) longest[2] = std::max(longest[2], chord(below[i + 1], row[i]));
    }
    std::swap(row, below);
  }
  return longest;
}

double maxOf(const std::array<double, 3>& values) { return *std::max_element(values.begin(), values.end()); }

// Calls body(face) for faces with a limit surface, the surface of positions bound to it.
template <class Needed, class Body>
void forEachFace(int32_t count, const LimitSurface& prototype, const Needed& needed, const Body& body) {
  tbb::parallel_for(tbb::blocked_range<int32_t>(0, count), [&](const tbb::blocked_range<int32_t>& range) {
    LimitSurface surface = prototype;
    for (int32_t face = range.begin(); face != range.end(); ++face) {
      if (!needed(face)) continue;
      surface.bind(face);
      body(face, surface);
    }
  });
}

std::vector<LimitPrimvar<Vec2f>> prepareTexcoords(const Mesh& mesh, std::vector<FaceVaryingChannel>& channels) {
  std::vector<LimitPrimvar<Vec2f>> prepared;
  for (const auto& primvar : mesh.texcoords) prepared.emplace_back(primvar, mesh, channels);
  return prepared;
}

std::vector<LimitPrimvar<Vec3f>> prepareColor(const Mesh& mesh, std::vector<FaceVaryingChannel>& channels) {
  std::vector<LimitPrimvar<Vec3f>> prepared;
  if (!mesh.display_color.empty()) prepared.emplace_back(mesh.display_color, mesh, channels);
  return prepared;
}

// Float positions are rounded to half a unit in the last place of their coordinates, at both ends of a chord.
double roundingOf(const Mesh& mesh) {
  float largest = 0;
  for (const Vec3f p : mesh.points) largest = std::max(largest, maxComponent(absolute(p)));
  return double(largest) * 0x1p-22;
}

}  // namespace

SubdivisionDicer::SubdivisionDicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons)
    : mesh_(mesh),
      edge_length_(edge_length),
      allowed_(edge_length_ * (1 + 1e-5) + roundingOf(mesh)),
      max_micropolygons_(max_micropolygons),
      texcoords_(prepareTexcoords(mesh, channels_)),
      display_color_(prepareColor(mesh, channels_)),
      topology_(mesh, channels_),
      shared_(topology_) {
  listPrimitives();
  measure();
  count();  // refuses what is far too much before any of it is held
  sampleEdges();
  refineGrids();
  count();
}

LimitSurface SubdivisionDicer::positionSurface() const {
  return {topology_, Interpolation::Vertex, -1, &mesh_.points[0].x, 3};
}

Tessellation SubdivisionDicer::tessellation(const Primitive& primitive) const {
  std::array<uint32_t, 4> sides{1, 1, 1, 1};
  for (int s = 0; s < (topology_.shape() == DomainShape::Quad ? 4 : 3); ++s)
    sides[s] = shared_.side(primitive.face, primitive.corner, s).count;
  return fitTessellation(topology_.shape(), sides, primitive.nu, primitive.nv);
}

void SubdivisionDicer::listPrimitives() {
  for (int32_t face = 0; face < int32_t(mesh_.face_vertex_counts.size()); ++face) {
    first_primitive_.push_back(uint32_t(primitives_.size()));
    if (!topology_.hasLimit(face)) continue;
    const int32_t corners = topology_.isSplit(face) ? mesh_.face_vertex_counts[face] : 1;
    for (int32_t corner = 0; corner < corners; ++corner) primitives_.push_back({face, corner, 1, 1});
  }
  first_primitive_.push_back(uint32_t(primitives_.size()));
}

// First rates, from coarse chords: what they say about the fastest stretch.
void SubdivisionDicer::measure() {
  const auto curveRate = [this](const auto& curve) {
    double longest = 0;
    Vec3f last = curve(0.0);
    for (uint32_t i = 1; i <= kCoarse; ++i) {
      const Vec3f next = curve(double(i) / kCoarse);
      longest = std::max(longest, chord(last, next));
      last = next;
    }
    return toRate(kCoarse * longest / allowed_);
  };
  forEachFace(
      faceCount(), positionSurface(), [this](int32_t face) { return topology_.hasLimit(face); },
      [&](int32_t face, const LimitSurface& surface) {
        shared_.placeCorners(face, surface);
        shared_.visitOwnedEdges(face, surface, [&](uint32_t edge, const auto& curve) {
          shared_.setRate(edge, roundedUp(curveRate(curve), shared_.isEven(edge)));
        });
        for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i) {
          Primitive& primitive = primitives_[i];
          const auto longest = longestChords(surface, primitive.corner, topology_.shape(), kCoarse, kCoarse);
          const bool quad = topology_.shape() == DomainShape::Quad;
          primitive.nu = toRate(kCoarse * (quad ? longest[0] : maxOf(longest)) / allowed_);
          primitive.nv = quad ? toRate(kCoarse * longest[1] / allowed_) : 1;
        }
      });
}

// Raises the rates of edges until every chord is short enough, and keeps their points.
void SubdivisionDicer::sampleEdges() {
  const auto sample = [this](uint32_t edge, const auto& curve) {
    uint32_t rate = shared_.rate(edge);
    std::vector<Vec3f> points;
    while (rate > 1 && rate < kMaxRate && rate <= max_micropolygons_) {
      points.clear();
      Vec3f last = curve(0.0);
      double longest = 0;
      for (uint32_t i = 1; i <= rate; ++i) {
        const Vec3f next = curve(double(i) / rate);
        longest = std::max(longest, chord(last, next));
        if (i < rate) points.push_back(next);
        last = next;
      }
      if (longest <= allowed_) break;
      rate = roundedUp(raised(rate, longest, allowed_), shared_.isEven(edge));
    }
    points.shrink_to_fit();
    shared_.setRate(edge, rate);
    shared_.setPoints(edge, std::move(points));
  };
  forEachFace(
      faceCount(), positionSurface(),
      [this](int32_t face) { return topology_.hasLimit(face) && shared_.ownsDicedEdge(face); },
      [&](int32_t face, const LimitSurface& surface) { shared_.visitOwnedEdges(face, surface, sample); });
}

void SubdivisionDicer::refineQuad(Primitive& primitive, const LimitSurface& surface) const {
  while (true) {
    const Tessellation t = tessellation(primitive);
    // Without a lattice there are no edges inside to measure.
    if ((t.nu == 1 && t.nv == 1) || t.micropolygons() > max_micropolygons_) return;
    const auto longest = longestChords(surface, primitive.corner, t.shape, t.nu, t.nv);
    primitive.nu = longest[0] > allowed_ ? raised(t.nu, longest[0], allowed_) : t.nu;
    primitive.nv = longest[1] > allowed_ ? raised(t.nv, longest[1], allowed_) : t.nv;
    if (primitive.nu == t.nu && primitive.nv == t.nv) return;
  }
}

void SubdivisionDicer::refineTriangle(Primitive& primitive, const LimitSurface& surface) const {
  while (true) {
    const Tessellation t = tessellation(primitive);
    if (t.nu == 1 || t.micropolygons() > max_micropolygons_) return;
    const double longest = maxOf(longestChords(surface, primitive.corner, t.shape, t.nu, t.nu));
    primitive.nu = longest > allowed_ ? raised(t.nu, longest, allowed_) : t.nu;
    if (primitive.nu == t.nu) return;
  }
}

// Raises the rates inside until every chord of the lattices is short enough.
void SubdivisionDicer::refineGrids() {
  const auto isDiced = [this](int32_t face) {
    for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i) {
      const Tessellation t = tessellation(primitives_[i]);
      if (t.nu > 1 || t.nv > 1) return true;
    }
    return false;
  };
  forEachFace(faceCount(), positionSurface(), isDiced, [&](int32_t face, const LimitSurface& surface) {
    for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i)
      topology_.shape() == DomainShape::Quad ? refineQuad(primitives_[i], surface)
                                             : refineTriangle(primitives_[i], surface);
  });
}

void SubdivisionDicer::count() {
  constexpr uint64_t kSaturated = std::numeric_limits<int64_t>::max();
  micropolygons_ = 0;
  for (const Primitive& primitive : primitives_) {
    const Tessellation t = tessellation(primitive);
    micropolygons_ = std::min(micropolygons_ + t.micropolygons(), kSaturated);
    if (t.nu >= kMaxRate || t.nv >= kMaxRate) micropolygons_ = kSaturated;
  }
  checkMicropolygonCap(mesh_, micropolygons_, edge_length_, max_micropolygons_);
}

}  // namespace encore
