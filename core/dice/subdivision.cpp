#include "core/dice/subdivision.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <string>
#include <utility>

#include "core/dice/chords.h"
#include "core/dice/micropolygon_cap.h"

namespace encore {
namespace {

// Segments per side of the coarse measurement that rates start from: it sees curves that come back to
// where they began, which the chords of a rate of 1 would not.
constexpr uint32_t kCoarse = 4;
constexpr uint64_t kSaturated = std::numeric_limits<int64_t>::max();

// The rate that the fastest of kCoarse segments asks for.
uint32_t coarseRate(double longest, double allowed) { return toRate(kCoarse * longest / allowed); }

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

template <class T>
std::vector<LimitPrimvar<T>> prepare(const std::vector<Primvar<T>>& primvars, const Mesh& mesh,
                                     std::vector<FaceVaryingChannel>& channels) {
  std::vector<LimitPrimvar<T>> prepared;
  for (const auto& primvar : primvars) prepared.emplace_back(primvar, mesh, channels);
  return prepared;
}

std::vector<LimitPrimvar<Vec3f>> prepareColor(const Mesh& mesh, std::vector<FaceVaryingChannel>& channels) {
  std::vector<LimitPrimvar<Vec3f>> prepared;
  if (!mesh.display_color.empty()) prepared.emplace_back(mesh.display_color, mesh, channels);
  return prepared;
}

// Float positions are rounded to half a unit in the last place of their coordinates, at both ends of a chord.
double roundingOf(const Poses& poses) { return double(poses.largestCoordinate()) * 0x1p-22; }

}  // namespace

SubdivisionDicer::SubdivisionDicer(const Mesh& mesh, float edge_length, uint64_t max_micropolygons, DicingExtras extras)
    : mesh_(mesh),
      extras_(std::move(extras)),
      edge_length_(edge_length),
      poses_(mesh),
      allowed_(edge_length_ * (1 + 1e-5) + roundingOf(poses_)),
      max_micropolygons_(max_micropolygons),
      texcoords_(prepare(mesh.texcoords, mesh, channels_)),
      display_color_(prepareColor(mesh, channels_)),
      primvars_(prepare(mesh.primvars, mesh, channels_)),
      normals_(prepare(extras_.normals, mesh, channels_)),
      topology_(mesh, channels_),
      shared_(topology_, poses_.count()) {
  listPrimitives();
  measure();
  sampleEdges();
  refineGrids();
  count();
}

LimitSurface SubdivisionDicer::positionSurface() const {
  return {topology_, Interpolation::Vertex, -1, poses_.values(), int(3 * poses_.count())};
}

Tessellation SubdivisionDicer::tessellation(const Primitive& primitive) const {
  std::array<uint32_t, 4> sides{1, 1, 1, 1};
  for (int s = 0; s < (topology_.shape() == DomainShape::Quad ? 4 : 3); ++s)
    sides[s] = shared_.side(primitive.face, primitive.corner, s).count;
  if (primitive.lattice) return {topology_.shape(), sides, primitive.nu, primitive.nv};
  return fitTessellation(topology_.shape(), sides, primitive.nu, primitive.nv);
}

void SubdivisionDicer::findLines(const Primitive& primitive, const Tessellation& t, TessellationLines& lines) const {
  for (int s = 0; s < t.sideCount(); ++s)
    shared_.parameters(shared_.side(primitive.face, primitive.corner, s), lines.sides[s]);
  lines.u = primitive.lattice ? primitive.lattice->u : uniformParameters(t.nu);
  lines.v = primitive.lattice ? primitive.lattice->v : uniformParameters(t.nv);
}

// Whether a face at the edge is to be diced.
bool SubdivisionDicer::isDicedEdge(uint32_t edge, int32_t owner) const {
  if (extras_.diced_faces.empty()) return true;
  if (edge >= uint32_t(topology_.base().GetNumEdges())) return isDiced(owner);
  for (const int32_t face : topology_.base().GetEdgeFaces(int(edge)))
    if (isDiced(face)) return true;
  return false;
}

void SubdivisionDicer::listPrimitives() {
  for (int32_t face = 0; face < int32_t(mesh_.face_vertex_counts.size()); ++face) {
    first_primitive_.push_back(uint32_t(primitives_.size()));
    if (!topology_.hasLimit(face)) continue;
    const int32_t corners = topology_.isSplit(face) ? mesh_.face_vertex_counts[face] : 1;
    for (int32_t corner = 0; corner < corners; ++corner) primitives_.push_back({face, corner, 1, 1, nullptr});
  }
  first_primitive_.push_back(uint32_t(primitives_.size()));
}

// First rates, from coarse chords: what they say about the fastest stretch. Refuses what is far too much
// before any of it is held.
void SubdivisionDicer::measure() {
  const bool quad = topology_.shape() == DomainShape::Quad;
  const Parameters coarse = uniformParameters(kCoarse);
  std::atomic<uint64_t> estimate = 0;
  const auto measurePrimitive = [&](Primitive& primitive, const LimitSurface& surface) {
    const GridChords chords = gridChords(surface, primitive.corner, topology_.shape(), coarse, coarse);
    const double u = chords.u.most(), v = chords.v.most();
    primitive.nu = coarseRate(quad ? u : std::max({u, v, chords.across}), allowed_);
    primitive.nv = quad ? coarseRate(v, allowed_) : 1;
    // As many as an even run would take; limited so that the sum of some millions does not overflow.
    const uint64_t cells = uint64_t(toRate(chords.u.line / allowed_)) * toRate(chords.v.line / allowed_);
    estimate += std::min(cells, uint64_t{1} << 40);
  };
  forEachFace(
      faceCount(), positionSurface(), [this](int32_t face) { return topology_.hasLimit(face); },
      [&](int32_t face, const LimitSurface& surface) {
        std::vector<Vec3f> points;
        shared_.placeCorners(face, surface);
        shared_.visitOwnedEdges(face, surface, [&](uint32_t edge, const auto& curve) {
          const uint32_t rate = isDicedEdge(edge, face)
                                    ? coarseRate(curveChords(curve, coarse, poses_.count(), points).most(), allowed_)
                                    : 1;
          shared_.setRate(edge, shared_.hasMiddle(edge) ? rate + rate % 2 : rate);
        });
        for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1] && isDiced(face); ++i)
          measurePrimitive(primitives_[i], surface);
      });
  if (estimate / 2 > max_micropolygons_)
    throw tooManyMicropolygons(mesh_, "about " + std::to_string(estimate), edge_length_, max_micropolygons_);
}

// Raises the rates of edges until every chord is short enough, and keeps their points.
void SubdivisionDicer::sampleEdges() {
  // Triangles have uniform lattices, which a side of other parameters would never fit.
  const bool may_bisect = topology_.shape() == DomainShape::Quad;
  const uint64_t limit = std::min(2 * max_micropolygons_ + 2, uint64_t{kMaxRate} / 2);
  const size_t poses = poses_.count();
  const auto sample = [&, poses](uint32_t edge, const auto& curve, bool is_diced) {
    if (shared_.rate(edge) == 1) return;
    const double allowed = is_diced ? allowed_ : std::numeric_limits<double>::infinity();
    Spacing spacing(shared_.rate(edge), allowed, shared_.hasMiddle(edge));
    std::vector<Vec3f> points;
    while (true) {
      if (spacing.rate() > limit) return shared_.setRate(edge, kMaxRate);  // count() refuses it
      const ChordLengths chords = curveChords(curve, spacing.parameters(), poses, points);
      if (!(may_bisect ? spacing.refine(chords) : spacing.refineUniformly(chords.most()))) break;
    }
    shared_.setRate(edge, spacing.rate());
    shared_.setPoints(edge, spacing.uniform() ? Parameters{} : spacing.parameters(),
                      std::vector<Vec3f>(points.begin() + int64_t(poses), points.end() - int64_t(poses)));
  };
  forEachFace(
      faceCount(), positionSurface(),
      [this](int32_t face) { return topology_.hasLimit(face) && shared_.ownsDicedEdge(face); },
      [&](int32_t face, const LimitSurface& surface) {
        shared_.visitOwnedEdges(
            face, surface, [&](uint32_t edge, const auto& curve) { sample(edge, curve, isDicedEdge(edge, face)); });
      });
}

void SubdivisionDicer::refineQuad(Primitive& primitive, const LimitSurface& surface) const {
  const Tessellation t = tessellation(primitive);
  if ((t.nu == 1 && t.nv == 1) || isTooMuch(t)) return;  // no edges inside to measure
  Spacing u(t.nu, allowed_), v(t.nv, allowed_);
  while (uint64_t(u.rate()) * v.rate() <= max_micropolygons_) {
    const GridChords chords = gridChords(surface, primitive.corner, t.shape, u.parameters(), v.parameters());
    const bool finer_u = u.refine(chords.u), finer_v = v.refine(chords.v);
    if (!finer_u && !finer_v) break;
  }
  primitive.nu = u.rate();
  primitive.nv = v.rate();
  if (!u.uniform() || !v.uniform()) primitive.lattice.reset(new Lattice{u.parameters(), v.parameters()});
}

void SubdivisionDicer::refineTriangle(Primitive& primitive, const LimitSurface& surface) const {
  const Tessellation t = tessellation(primitive);
  if (t.nu == 1 || isTooMuch(t)) return;
  Spacing lattice(t.nu, allowed_);
  while (uint64_t(lattice.rate()) * lattice.rate() / 2 <= max_micropolygons_) {
    const Parameters& p = lattice.parameters();
    const GridChords chords = gridChords(surface, primitive.corner, t.shape, p, p);
    if (!lattice.refineUniformly(std::max({chords.u.most(), chords.v.most(), chords.across}))) break;
  }
  primitive.nu = lattice.rate();
}

// Raises the rates inside until every chord of the lattices is short enough.
void SubdivisionDicer::refineGrids() {
  const auto isToRefine = [this](int32_t face) {
    if (!isDiced(face)) return false;
    for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i) {
      const Tessellation t = tessellation(primitives_[i]);
      if (t.nu > 1 || t.nv > 1) return true;
    }
    return false;
  };
  forEachFace(faceCount(), positionSurface(), isToRefine, [&](int32_t face, const LimitSurface& surface) {
    for (uint32_t i = first_primitive_[face]; i < first_primitive_[face + 1]; ++i)
      topology_.shape() == DomainShape::Quad ? refineQuad(primitives_[i], surface)
                                             : refineTriangle(primitives_[i], surface);
  });
}

// More than the cap by itself, or than can be counted.
bool SubdivisionDicer::isTooMuch(const Tessellation& t) const {
  const uint32_t most = std::max({t.nu, t.nv, t.sides[0], t.sides[1], t.sides[2], t.sides[3]});
  return most >= kMaxRate / 2 || t.micropolygons() > max_micropolygons_;
}

void SubdivisionDicer::count() {
  micropolygons_ = 0;
  for (const Primitive& primitive : primitives_) {
    const Tessellation t = tessellation(primitive);
    micropolygons_ = std::min(micropolygons_ + t.micropolygons(), kSaturated);
    if (isTooMuch(t)) micropolygons_ = std::max(micropolygons_, max_micropolygons_ + 1);
  }
  if (micropolygons_ > max_micropolygons_)
    throw tooManyMicropolygons(mesh_, std::to_string(micropolygons_), edge_length_, max_micropolygons_);
}

}  // namespace encore
