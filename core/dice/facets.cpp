#include "core/dice/facets.h"

#include <cstddef>

#include "core/dice/polygon.h"
#include "core/dice/primvars.h"

namespace encore {
namespace {

// Where the corners of the new faces come from.
struct Cuts {
  std::vector<int32_t> counts;
  std::vector<uint32_t> face;
  std::vector<size_t> corner;
};

Cuts cutConcave(const Mesh& mesh) {
  Cuts cuts;
  std::vector<Vec3f> corners;
  size_t first = 0;
  for (size_t face = 0; face < mesh.face_vertex_counts.size(); ++face) {
    const size_t count = size_t(mesh.face_vertex_counts[face]);
    corners.clear();
    for (size_t k = 0; k < count; ++k) corners.push_back(mesh.points[size_t(mesh.face_vertex_indices[first + k])]);
    if (count == 3 || isConvex(corners)) {
      cuts.counts.push_back(int32_t(count));
      cuts.face.push_back(uint32_t(face));
      for (size_t k = 0; k < count; ++k) cuts.corner.push_back(first + k);
    } else {
      const auto triangles = triangulate(corners).triangles;
      for (size_t i = 0; i < triangles.size(); ++i) {
        if (i % 3 == 0) {
          cuts.counts.push_back(3);
          cuts.face.push_back(uint32_t(face));
        }
        cuts.corner.push_back(first + triangles[i]);
      }
    }
    first += count;
  }
  return cuts;
}

template <class T>
void follow(const Cuts& cuts, Primvar<T>& primvar) {
  std::vector<int32_t> indices;
  if (primvar.empty()) return;
  if (primvar.interpolation == Interpolation::Uniform)
    for (const uint32_t face : cuts.face) indices.push_back(int32_t(valueIndex(primvar, face)));
  else if (primvar.interpolation == Interpolation::FaceVarying)
    for (const size_t corner : cuts.corner) indices.push_back(int32_t(valueIndex(primvar, corner)));
  else
    return;
  primvar.indices = std::move(indices);
}

}  // namespace

Facets diceableFacets(const Mesh& mesh) {
  const Cuts cuts = cutConcave(mesh);
  Facets facets{mesh, cuts.face, {}};
  Mesh& out = facets.mesh;
  out.scheme = SubdivisionScheme::Bilinear;
  // These belong to subdivision (UsdGeomMesh).
  out.hole_indices.clear();
  out.corner_indices.clear();
  out.corner_sharpnesses.clear();
  out.crease_indices.clear();
  out.crease_lengths.clear();
  out.crease_sharpnesses.clear();

  out.face_vertex_counts = cuts.counts;
  out.face_vertex_indices.clear();
  for (const size_t corner : cuts.corner) out.face_vertex_indices.push_back(mesh.face_vertex_indices[corner]);
  if (!mesh.face_materials.empty()) {
    out.face_materials.clear();
    for (const uint32_t face : cuts.face) out.face_materials.push_back(mesh.face_materials[face]);
  }
  follow(cuts, out.normals);
  follow(cuts, out.display_color);
  for (auto& primvar : out.texcoords) follow(cuts, primvar);
  for (auto& primvar : out.primvars) follow(cuts, primvar);
  if (out.normals.empty()) return facets;
  facets.normals = {out.normals};
  if (mesh.motion_points.empty()) return facets;
  for (const auto& values : mesh.motion_normals) {
    facets.normals.push_back(out.normals);
    facets.normals.back().values = values;
  }
  return facets;
}

}  // namespace encore
