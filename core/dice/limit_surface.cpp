#include "core/dice/limit_surface.h"

#include <opensubdiv/far/topologyDescriptor.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "core/dice/poses.h"
#include "core/scene/error.h"

namespace encore {

namespace Bfr = OpenSubdiv::Bfr;
namespace Far = OpenSubdiv::Far;
namespace Sdc = OpenSubdiv::Sdc;

namespace {

Sdc::SchemeType schemeType(SubdivisionScheme scheme) {
  switch (scheme) {
    case SubdivisionScheme::Loop:
      return Sdc::SCHEME_LOOP;
    case SubdivisionScheme::Bilinear:
      return Sdc::SCHEME_BILINEAR;
    default:
      return Sdc::SCHEME_CATMARK;
  }
}

Sdc::Options schemeOptions(const Mesh& mesh) {
  using Boundary = InterpolateBoundary;
  using FaceVarying = FaceVaryingInterpolation;
  Sdc::Options options;
  options.SetVtxBoundaryInterpolation(mesh.boundary == Boundary::None ? Sdc::Options::VTX_BOUNDARY_NONE
                                      : mesh.boundary == Boundary::EdgeOnly
                                          ? Sdc::Options::VTX_BOUNDARY_EDGE_ONLY
                                          : Sdc::Options::VTX_BOUNDARY_EDGE_AND_CORNER);
  const auto linear = [&] {
    switch (mesh.face_varying) {
      case FaceVarying::None:
        return Sdc::Options::FVAR_LINEAR_NONE;
      case FaceVarying::CornersOnly:
        return Sdc::Options::FVAR_LINEAR_CORNERS_ONLY;
      case FaceVarying::CornersPlus1:
        return Sdc::Options::FVAR_LINEAR_CORNERS_PLUS1;
      case FaceVarying::CornersPlus2:
        return Sdc::Options::FVAR_LINEAR_CORNERS_PLUS2;
      case FaceVarying::Boundaries:
        return Sdc::Options::FVAR_LINEAR_BOUNDARIES;
      case FaceVarying::All:
        break;
    }
    return Sdc::Options::FVAR_LINEAR_ALL;
  };
  options.SetFVarLinearInterpolation(linear());
  options.SetTriangleSubdivision(mesh.triangle_subdivision == TriangleSubdivision::Smooth
                                     ? Sdc::Options::TRI_SUB_SMOOTH
                                     : Sdc::Options::TRI_SUB_CATMARK);
  return options;
}

// Creases as edges. Pairs of points that no face joins have no effect, and are left out because OpenSubdiv
// would print a warning for each.
struct SharpEdges {
  std::vector<int32_t> points;  // two per edge
  std::vector<float> sharpnesses;
};

std::pair<int32_t, int32_t> ordered(int32_t a, int32_t b) { return {std::min(a, b), std::max(a, b)}; }

std::vector<std::pair<int32_t, int32_t>> sortedEdges(const Mesh& mesh) {
  std::vector<std::pair<int32_t, int32_t>> edges;
  size_t first = 0;
  for (const int32_t count : mesh.face_vertex_counts) {
    for (int32_t i = 0; i < count; ++i)
      edges.push_back(ordered(mesh.face_vertex_indices[first + i], mesh.face_vertex_indices[first + (i + 1) % count]));
    first += count;
  }
  std::sort(edges.begin(), edges.end());
  return edges;
}

SharpEdges sharpEdges(const Mesh& mesh) {
  SharpEdges sharp;
  if (mesh.crease_lengths.empty()) return sharp;
  const auto edges = sortedEdges(mesh);
  const bool per_crease = mesh.crease_sharpnesses.size() == mesh.crease_lengths.size();
  size_t point = 0, edge = 0;
  for (size_t crease = 0; crease < mesh.crease_lengths.size(); ++crease) {
    for (int32_t i = 0; i + 1 < mesh.crease_lengths[crease]; ++i, ++edge) {
      const int32_t a = mesh.crease_indices[point + i], b = mesh.crease_indices[point + i + 1];
      if (a == b || !std::binary_search(edges.begin(), edges.end(), ordered(a, b))) continue;
      sharp.points.insert(sharp.points.end(), {a, b});
      sharp.sharpnesses.push_back(std::max(0.0f, mesh.crease_sharpnesses[per_crease ? crease : edge]));
    }
    point += mesh.crease_lengths[crease];
  }
  return sharp;
}

Error unusable(const Mesh& mesh, const std::string& what) {
  return Error(ErrorKind::Scene, what, mesh.path,
               "Repair the mesh's topology, or author subdivisionScheme = \"none\" on it");
}

// What OpenSubdiv refuses, found beforehand: it would only print a message.
void checkTopology(const Mesh& mesh) {
  std::vector<int32_t> valence(mesh.points.size(), 0);
  for (const int32_t point : mesh.face_vertex_indices) ++valence[point];
  for (size_t i = 0; i < valence.size(); ++i)
    if (valence[i] > Far::VALENCE_LIMIT)
      throw unusable(mesh, "Point " + std::to_string(i) + " is used by " + std::to_string(valence[i]) +
                               " face corners; subdivision takes at most " + std::to_string(Far::VALENCE_LIMIT));
  for (size_t face = 0; face < mesh.face_vertex_counts.size(); ++face) {
    const int32_t count = mesh.face_vertex_counts[face];
    if (mesh.scheme == SubdivisionScheme::Loop && count != 3)
      throw unusable(mesh, "subdivisionScheme \"loop\" needs triangles, but face " + std::to_string(face) + " has " +
                               std::to_string(count) + " corners");
    if (count < 3 || count > Far::VALENCE_LIMIT)
      throw unusable(mesh, "Face " + std::to_string(face) + " has " + std::to_string(count) +
                               " corners; subdivision takes 3 to " + std::to_string(Far::VALENCE_LIMIT));
  }
}

}  // namespace

LimitTopology::LimitTopology(const Mesh& mesh, std::span<const FaceVaryingChannel> channels)
    : shape_(mesh.scheme == SubdivisionScheme::Loop ? DomainShape::Triangle : DomainShape::Quad) {
  checkTopology(mesh);
  const SharpEdges creases = sharpEdges(mesh);
  std::vector<float> corners = mesh.corner_sharpnesses;
  for (float& sharpness : corners) sharpness = std::max(0.0f, sharpness);
  std::vector<Far::TopologyDescriptor::FVarChannel> fvar(channels.size());
  for (size_t i = 0; i < channels.size(); ++i) {
    fvar[i].numValues = channels[i].value_count;
    fvar[i].valueIndices = channels[i].indices.data();
  }

  Far::TopologyDescriptor descriptor;
  descriptor.numVertices = int(mesh.points.size());
  descriptor.numFaces = int(mesh.face_vertex_counts.size());
  descriptor.numVertsPerFace = mesh.face_vertex_counts.data();
  descriptor.vertIndicesPerFace = mesh.face_vertex_indices.data();
  descriptor.numCreases = int(creases.sharpnesses.size());
  descriptor.creaseVertexIndexPairs = creases.points.data();
  descriptor.creaseWeights = creases.sharpnesses.data();
  descriptor.numCorners = int(mesh.corner_indices.size());
  descriptor.cornerVertexIndices = mesh.corner_indices.data();
  descriptor.cornerWeights = corners.data();
  descriptor.numHoles = int(mesh.hole_indices.size());
  descriptor.holeIndices = mesh.hole_indices.data();
  descriptor.numFVarChannels = int(fvar.size());
  descriptor.fvarChannels = fvar.data();
  // Orientation is left to the dicer, which turns triangles and normals: isLeftHanded would reorder corners.

  using RefinerFactory = Far::TopologyRefinerFactory<Far::TopologyDescriptor>;
  refiner_.reset(RefinerFactory::Create(descriptor, {schemeType(mesh.scheme), schemeOptions(mesh)}));
  if (!refiner_) throw unusable(mesh, "OpenSubdiv cannot use the topology");
  factory_ = std::make_unique<Factory>(*refiner_);

  has_limit_.assign(mesh.face_vertex_counts.size(), 1);
  for (size_t face = 0; face < has_limit_.size(); ++face)
    has_limit_[face] = factory_->FaceHasLimitSurface(int(face)) ? 1 : 0;
}

LimitSurface::LimitSurface(const LimitTopology& topology, Interpolation kind, int32_t channel, const float* values,
                           int width)
    : topology_(topology), kind_(kind), channel_(channel), values_(values), width_(width) {}

void LimitSurface::bind(int32_t face) {
  const auto& factory = *topology_.factory_;
  const bool bound = kind_ == Interpolation::Vertex    ? factory.InitVertexSurface(face, &surface_)
                     : kind_ == Interpolation::Varying ? factory.InitVaryingSurface(face, &surface_)
                                                       : factory.InitFaceVaryingSurface(face, &surface_, channel_);
  if (!bound) throw Error(ErrorKind::Internal, "Face " + std::to_string(face) + " has no limit surface");
  patch_points_.resize(size_t(surface_.GetNumPatchPoints()) * width_);
  surface_.GatherControlPoints(values_, width_, patch_points_.data(), width_);
  surface_.ComputePatchPoints(patch_points_.data(), width_);
}

ParamCoord LimitSurface::toFace(int32_t corner, ParamCoord at) const {
  const auto domain = surface_.GetParameterization();
  if (!domain.HasSubFaces()) return at;
  const double local[2] = {at.u, at.v};
  double face[2];
  domain.ConvertNormalizedSubFaceToCoord(corner, local, face);
  return {face[0], face[1]};
}

void LimitSurface::evaluate(int32_t corner, ParamCoord at, double* out) const {
  const ParamCoord face = toFace(corner, at);
  const double uv[2] = {face.u, face.v};
  surface_.Evaluate(uv, patch_points_.data(), width_, out);
}

void LimitSurface::evaluate(int32_t corner, ParamCoord at, double* out, double* du, double* dv) const {
  const ParamCoord face = toFace(corner, at);
  const double uv[2] = {face.u, face.v};
  surface_.Evaluate(uv, patch_points_.data(), width_, out, du, dv);
}

void LimitSurface::evaluateEdge(int32_t edge, double t, double* out) const {
  double uv[2];
  surface_.GetParameterization().GetEdgeCoord(edge, t, uv);
  surface_.Evaluate(uv, patch_points_.data(), width_, out);
}

void LimitSurface::positions(int32_t corner, ParamCoord at, Vec3f* out) const {
  std::array<double, 3 * kMostPoses> p;
  evaluate(corner, at, p.data());
  for (size_t i = 0; i < poses(); ++i) out[i] = toFloat(Vec3d{p[3 * i], p[3 * i + 1], p[3 * i + 2]});
}

void LimitSurface::edgePositions(int32_t edge, double t, Vec3f* out) const {
  std::array<double, 3 * kMostPoses> p;
  evaluateEdge(edge, t, p.data());
  for (size_t i = 0; i < poses(); ++i) out[i] = toFloat(Vec3d{p[3 * i], p[3 * i + 1], p[3 * i + 2]});
}

}  // namespace encore
