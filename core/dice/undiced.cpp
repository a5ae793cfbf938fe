#include "core/dice/undiced.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <limits>
#include <string>
#include <vector>

#include "core/dice/micropolygon_cap.h"
#include "core/dice/polygon.h"
#include "core/dice/primvars.h"

namespace encore {
namespace {

class Writer {
 public:
  Writer(const Mesh& mesh, DicedMesh& out) : mesh_(mesh), out_(out) {}

  // first: the face's first corner, which is its first vertex, too. Triangles of the faces before: every
  // face with n corners has n - 2.
  void write(size_t face, size_t first) {
    const size_t corners = size_t(mesh_.face_vertex_counts[face]);
    positions_.clear();
    for (size_t k = 0; k < corners; ++k)
      positions_.push_back(mesh_.points[size_t(mesh_.face_vertex_indices[first + k])]);
    const TriangulatedPolygon polygon = triangulate(positions_);
    for (size_t k = 0; k < corners; ++k) writeCorner(face, first + k, positions_[k], polygon.uv[k]);
    size_t triangle = first - 2 * face;
    for (size_t i = 0; i < polygon.triangles.size(); i += 3, ++triangle) {
      for (int k = 0; k < 3; ++k) {
        const int from = mesh_.left_handed && k > 0 ? 3 - k : k;
        out_.triangles[3 * triangle + k] = uint32_t(first + polygon.triangles[i + from]);
      }
      out_.triangle_primitive[triangle] = uint32_t(face);
    }
    out_.primitive_face[face] = uint32_t(face);
  }

 private:
  void writeCorner(size_t face, size_t corner, Vec3f position, Vec2f uv) {
    const size_t point = size_t(mesh_.face_vertex_indices[corner]);
    out_.positions[corner] = position;
    for (size_t key = 0; key < mesh_.motion_points.size(); ++key)
      out_.motion_positions[key][corner] = mesh_.motion_points[key][point];
    out_.uv[corner] = uv;
    if (!mesh_.normals.empty()) writeNormals(face, point, corner);
    for (size_t i = 0; i < mesh_.texcoords.size(); ++i)
      out_.texcoords[i][corner] = cornerValue(mesh_.texcoords[i], face, point, corner);
    if (!mesh_.display_color.empty())
      out_.display_color[corner] = cornerValue(mesh_.display_color, face, point, corner);
    for (size_t i = 0; i < mesh_.primvars.size(); ++i)
      out_.primvars[i][corner] = cornerValue(mesh_.primvars[i], face, point, corner);
  }

  void writeNormals(size_t face, size_t point, size_t corner) {
    const size_t value = cornerIndex(mesh_.normals, face, point, corner);
    out_.normals[corner] = authoredNormal(mesh_.normals.values[value]);
    for (size_t key = 0; key < out_.motion_normals.size(); ++key)
      out_.motion_normals[key][corner] =
          mesh_.motion_normals.empty() ? out_.normals[corner] : authoredNormal(mesh_.motion_normals[key][value]);
  }

  // Authored normals point outside whatever the orientation (UsdGeomMesh). Where one has no length, the
  // polygon's own at the frame's time stands in.
  Vec3f authoredNormal(Vec3f value) const {
    const Vec3d authored = toDouble(value);
    if (length(authored) > 0) return toFloat(normalize(authored));
    const Vec3d own = normalize(newellNormal(positions_));
    if (length(own) == 0) return {0, 0, 1};
    return toFloat(mesh_.left_handed ? -own : own);
  }

  const Mesh& mesh_;
  DicedMesh& out_;
  std::vector<Vec3f> positions_;  // of the face, at the frame's time: what says how it is cut
};

}  // namespace

DicedMesh undicedMesh(const Mesh& mesh) {
  const size_t faces = mesh.face_vertex_counts.size(), vertices = mesh.face_vertex_indices.size();
  if (vertices > std::numeric_limits<uint32_t>::max())
    throw Error(ErrorKind::Memory, std::to_string(vertices) + " face corners are more than 32-bit indices reach",
                mesh.path + ".faceVertexIndices", "Split the mesh");
  DicedMesh out;
  out.positions.resize(vertices);
  out.normals.resize(mesh.normals.empty() ? 0 : vertices);
  const size_t keys = mesh.motion_points.size();
  out.motion_positions.assign(keys, std::vector<Vec3f>(vertices));
  if (!mesh.normals.empty()) out.motion_normals.assign(keys, std::vector<Vec3f>(vertices));
  out.uv.resize(vertices);
  out.texcoords.assign(mesh.texcoords.size(), std::vector<Vec2f>(vertices));
  out.display_color.resize(mesh.display_color.empty() ? 0 : vertices);
  out.primvars.assign(mesh.primvars.size(), std::vector<Vec4f>(vertices));
  out.triangles.resize(3 * (vertices - 2 * faces));
  out.triangle_primitive.resize(vertices - 2 * faces);
  out.primitive_face.resize(faces);
  out.micropolygons = faces;

  std::vector<size_t> first(faces + 1, 0);
  for (size_t face = 0; face < faces; ++face) first[face + 1] = first[face] + size_t(mesh.face_vertex_counts[face]);
  tbb::parallel_for(tbb::blocked_range<size_t>(0, faces, 1024), [&](const tbb::blocked_range<size_t>& range) {
    Writer writer(mesh, out);
    for (size_t face = range.begin(); face != range.end(); ++face) writer.write(face, first[face]);
  });
  return out;
}

}  // namespace encore
