// validateMesh(): everything that dicing and tracing take for granted about one mesh.
#include <cstdint>
#include <numeric>
#include <string>

#include "core/scene/curve_counts.h"
#include "core/scene/error.h"
#include "core/scene/scene.h"
#include "core/scene/text.h"

namespace encore {
namespace {

// Throws errors about one mesh; attributes go by their USD names.
class MeshErrors {
 public:
  explicit MeshErrors(const Mesh& mesh) : path_(mesh.path) {}

  [[noreturn]] void raise(const std::string& attribute, const std::string& found, const std::string& remedy) const {
    throw Error(ErrorKind::Scene, found, path_ + "." + attribute, remedy);
  }
  // indices[i] must lie in [lowest, count).
  void checkIndices(const std::string& attribute, const std::vector<int32_t>& indices, size_t count,
                    const std::string& things, int64_t lowest = 0) const {
    for (size_t i = 0; i < indices.size(); ++i)
      if (indices[i] < lowest || indices[i] >= int64_t(count))
        raise(attribute,
              "index " + text(indices[i]) + " at " + text(i) + " is out of range: " + things + " number " + text(count),
              "Author indices from " + text(lowest) + " to the number of " + things + " less one");
  }
  void checkSize(const std::string& attribute, size_t found, size_t expected, const std::string& because) const {
    if (found != expected)
      raise(attribute, "has " + text(found) + " elements, but " + because + " ask for " + text(expected),
            "Author " + text(expected) + " elements");
  }
  template <class Values>
  void checkFinite(const std::string& attribute, const Values& values) const {
    for (size_t i = 0; i < values.size(); ++i)
      if (!allFinite(values[i]))
        raise(attribute, "value " + text(values[i]) + " at " + text(i) + " is not finite",
              "Remove infinite and NaN values from " + attribute);
  }
  void checkLength(const std::string& attribute, float value) const {
    if (!std::isfinite(value) || value < 0)
      raise(attribute, "value " + text(value) + " is not a finite number of at least 0",
            "Author a positive number, or remove the primvar");
  }

 private:
  std::string path_;
};

const char* curveKind(const Mesh& mesh) {
  switch (mesh.basis) {
    case CurveBasis::Linear:
      return "linear";
    case CurveBasis::Bezier:
      return "bezier";
    case CurveBasis::BSpline:
      return "bspline";
    case CurveBasis::CatmullRom:
      return "catmullRom";
  }
  return "unknown";
}

std::string countRule(const Mesh& mesh) {
  const std::string step = vstep(mesh.basis) == 3 ? "multiples of 3" : "";
  if (isPeriodic(mesh)) return mesh.basis == CurveBasis::Linear ? "3 or more" : step.empty() ? "1 or more" : step;
  if (hasPhantomPoints(mesh) || mesh.basis == CurveBasis::Linear) return "2 or more";
  return step.empty() ? "4 or more" : "4, 7, 10 and so on";
}

void checkCurves(const Mesh& mesh, const MeshErrors& errors) {
  const std::vector<int32_t>& counts = mesh.face_vertex_counts.get();
  for (size_t i = 0; i < counts.size(); ++i)
    if (!isCurveCount(mesh, counts[i]))
      errors.raise("curveVertexCounts",
                   "curve " + text(i) + " has " + text(counts[i]) + " points, which are no " +
                       (isPeriodic(mesh)         ? "periodic "
                        : hasPhantomPoints(mesh) ? "pinned "
                                                 : "nonperiodic ") +
                       curveKind(mesh) + " curve",
                   "Curves of this basis and wrap have " + countRule(mesh) + " points");
  const int64_t points = std::accumulate(counts.begin(), counts.end(), int64_t{0});
  errors.checkSize("points", mesh.points.size(), size_t(points), "curveVertexCounts");
  errors.checkFinite("points", mesh.points);
}

void checkTopology(const Mesh& mesh, const MeshErrors& errors) {
  if (mesh.shape == Shape::Curves) return checkCurves(mesh, errors);
  if (mesh.shape == Shape::Points) return errors.checkFinite("points", mesh.points);
  const auto& counts = mesh.face_vertex_counts;
  for (size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] < 3)
      errors.raise("faceVertexCounts", "face " + text(i) + " has " + text(counts[i]) + " vertices",
                   "Remove faces with fewer than 3 vertices");
    if (mesh.scheme == SubdivisionScheme::Loop && counts[i] != 3)
      errors.raise("faceVertexCounts",
                   "face " + text(i) + " has " + text(counts[i]) + " vertices, but subdivisionScheme is loop",
                   "Triangulate the mesh, or use the catmullClark scheme");
  }
  const int64_t corners = std::accumulate(counts.begin(), counts.end(), int64_t{0});
  errors.checkSize("faceVertexIndices", mesh.face_vertex_indices.size(), size_t(corners), "faceVertexCounts");
  errors.checkIndices("faceVertexIndices", mesh.face_vertex_indices, mesh.points.size(), "points");
  errors.checkFinite("points", mesh.points);
}

void checkSharpFeatures(const Mesh& mesh, const MeshErrors& errors) {
  errors.checkIndices("holeIndices", mesh.hole_indices, mesh.face_vertex_counts.size(), "faces");
  errors.checkIndices("cornerIndices", mesh.corner_indices, mesh.points.size(), "points");
  errors.checkSize("cornerSharpnesses", mesh.corner_sharpnesses.size(), mesh.corner_indices.size(), "cornerIndices");
  errors.checkFinite("cornerSharpnesses", mesh.corner_sharpnesses);

  size_t vertices = 0;
  for (size_t i = 0; i < mesh.crease_lengths.size(); ++i) {
    if (mesh.crease_lengths[i] < 2)
      errors.raise("creaseLengths", "crease " + text(i) + " has " + text(mesh.crease_lengths[i]) + " vertices",
                   "Remove creases with fewer than 2 vertices");
    vertices += size_t(mesh.crease_lengths[i]);
  }
  errors.checkSize("creaseIndices", mesh.crease_indices.size(), vertices, "creaseLengths");
  errors.checkIndices("creaseIndices", mesh.crease_indices, mesh.points.size(), "points");
  const size_t creases = mesh.crease_lengths.size(), edges = vertices - creases, found = mesh.crease_sharpnesses.size();
  if (found != creases && found != edges)
    errors.raise("creaseSharpnesses",
                 "has " + text(found) + " elements for " + text(creases) + " creases with " + text(edges) + " edges",
                 "Author one sharpness per crease or one per edge of every crease");
  errors.checkFinite("creaseSharpnesses", mesh.crease_sharpnesses);
}

// Ends of segments of all curves.
size_t varyingCount(const Mesh& mesh) {
  int64_t sum = 0;
  for (const int32_t count : mesh.face_vertex_counts.get()) sum += varyingCount(mesh, count);
  return size_t(sum);
}

size_t elementCount(const Mesh& mesh, Interpolation interpolation) {
  if (mesh.shape != Shape::Faces && interpolation == Interpolation::FaceVarying) interpolation = Interpolation::Varying;
  if (mesh.shape == Shape::Points && interpolation == Interpolation::Uniform) return mesh.points.size();
  if (mesh.shape == Shape::Curves && interpolation == Interpolation::Varying) return varyingCount(mesh);
  switch (interpolation) {
    case Interpolation::Constant:
      return 1;
    case Interpolation::Uniform:
      return mesh.face_vertex_counts.size();
    case Interpolation::Vertex:
    case Interpolation::Varying:
      return mesh.points.size();
    case Interpolation::FaceVarying:
      return mesh.face_vertex_indices.size();
  }
  return 0;
}

const char* interpolationName(Interpolation interpolation) {
  switch (interpolation) {
    case Interpolation::Constant:
      return "constant";
    case Interpolation::Uniform:
      return "uniform";
    case Interpolation::Vertex:
      return "vertex";
    case Interpolation::Varying:
      return "varying";
    case Interpolation::FaceVarying:
      return "faceVarying";
  }
  return "unknown";
}

template <class T>
void checkPrimvar(const Mesh& mesh, const Primvar<T>& primvar, const std::string& attribute, const MeshErrors& errors) {
  if (primvar.empty() && primvar.indices.empty()) return;
  const size_t expected = elementCount(mesh, primvar.interpolation);
  const std::string because = std::string(interpolationName(primvar.interpolation)) + " interpolation and the topology";
  if (primvar.indices.empty()) {
    errors.checkSize(attribute, primvar.values.size(), expected, because);
  } else {
    errors.checkSize(attribute + ":indices", primvar.indices.size(), expected, because);
    errors.checkIndices(attribute + ":indices", primvar.indices, primvar.values.size(), "values");
  }
  errors.checkFinite(attribute, primvar.values);
}

void checkWidths(const Mesh& mesh, const MeshErrors& errors) {
  if (mesh.shape == Shape::Faces) return;
  checkPrimvar(mesh, mesh.widths, "widths", errors);
  const std::vector<float>& widths = mesh.widths.values.get();
  for (size_t i = 0; i < widths.size(); ++i)
    if (widths[i] < 0)
      errors.raise("widths", "width " + text(widths[i]) + " at " + text(i) + " is below 0",
                   "Author widths of 0 or above: they are diameters");
}

void checkMotion(const Mesh& mesh, const MeshErrors& errors) {
  const size_t keys = mesh.motion_points.size();
  if (keys == 1 || keys > kMaxMotionKeys)
    errors.raise("points", text(keys) + " motion keys", "Pass from 2 to " + text(kMaxMotionKeys) + " keys, or none");
  for (const auto& points : mesh.motion_points) {
    errors.checkSize("points (motion keys)", points.size(), mesh.points.size(), "points");
    errors.checkFinite("points (motion keys)", points);
  }
  if (!mesh.motion_normals.empty())
    errors.checkSize("normals (motion keys)", mesh.motion_normals.size(), keys, "keys of points");
  for (const auto& normals : mesh.motion_normals) {
    errors.checkSize("normals (motion keys)", normals.size(), mesh.normals.values.size(), "normals");
    errors.checkFinite("normals (motion keys)", normals);
  }
}

// All that does not depend on the scene.
void checkOwn(const Mesh& mesh, const MeshErrors& errors) {
  checkTopology(mesh, errors);
  checkSharpFeatures(mesh, errors);

  checkPrimvar(mesh, mesh.normals, "normals", errors);
  checkWidths(mesh, errors);
  checkPrimvar(mesh, mesh.display_color, "primvars:displayColor", errors);
  for (const Primvar<Vec2f>& texcoord : mesh.texcoords)
    checkPrimvar(mesh, texcoord, "primvars:" + texcoord.name, errors);

  for (const Primvar<Vec4f>& primvar : mesh.primvars) checkPrimvar(mesh, primvar, "primvars:" + primvar.name, errors);
  checkMotion(mesh, errors);
  errors.checkLength("primvars:encore:targetEdgeLength", mesh.target_edge_length_world);
}

}  // namespace

void identify(Mesh& mesh) {
  mesh.identity = nullptr;
  checkOwn(mesh, MeshErrors(mesh));
  mesh.identity = std::make_shared<char>();
}

void validateMesh(const Mesh& mesh, size_t material_count) {
  const MeshErrors errors(mesh);
  if (!mesh.identity) checkOwn(mesh, errors);
  if (!mesh.face_materials.empty()) {
    errors.checkSize("material:binding", mesh.face_materials.size(), elementCount(mesh, Interpolation::Uniform),
                     "the GeomSubsets' faces");
    errors.checkIndices("material:binding", mesh.face_materials, material_count, "materials", -1);
  }
  errors.checkIndices("material:binding", {mesh.material}, material_count, "materials");
  for (size_t layer = 0; layer < mesh.shading_rate.size(); ++layer)
    if (!(mesh.shading_rate[layer] >= 0 && mesh.shading_rate[layer] <= kLargestShadingRate))
      errors.raise(
          kLayerRateAttributes[layer], "value " + text(mesh.shading_rate[layer]) + " is no shading rate",
          "Author a number from 0 (that of the frame) to " + text(kLargestShadingRate) + " shading samples per pixel");
}

}  // namespace encore
