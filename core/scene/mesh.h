// Meshes, curves and points as USD describes them, before dicing.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/math.h"
#include "core/scene/shared_vector.h"

namespace encore {

// Names and meanings of the enumerations are UsdGeomMesh's.
enum class SubdivisionScheme { None, CatmullClark, Loop, Bilinear };
enum class InterpolateBoundary { None, EdgeOnly, EdgeAndCorner };
enum class FaceVaryingInterpolation { None, CornersOnly, CornersPlus1, CornersPlus2, Boundaries, All };
enum class TriangleSubdivision { CatmullClark, Smooth };
// What a Mesh is made of. Curves are UsdGeomBasisCurves, Points are UsdGeomPoints: spheres.
enum class Shape { Faces, Curves, Points };
enum class CurveBasis { Linear, Bezier, BSpline, CatmullRom };
enum class CurveWrap { Nonperiodic, Periodic, Pinned };
enum class Interpolation { Constant, Uniform, Vertex, Varying, FaceVarying };

// values[indices[i]] (or values[i] without indices) belongs to element i of the interpolation:
// of faces:  the mesh, a face, a point, a point, a face corner;
// of curves: all of them, a curve, a point, an end of a segment, as varying (UsdGeomBasisCurves counts them);
// of points: all of them, and otherwise a point.
template <class T>
struct Primvar {
  std::string name;
  Interpolation interpolation = Interpolation::Constant;
  SharedVector<T> values;
  SharedVector<int32_t> indices;  // empty: identity

  bool empty() const { return values.empty(); }
};

// Shading samples per pixel in the direct, reflection and refraction layer; 0: not said here.
using LayerRates = std::array<float, 3>;
inline constexpr std::array<const char*, 3> kLayerRateAttributes{"primvars:encore:shadingRate:direct",
                                                                 "primvars:encore:shadingRate:reflection",
                                                                 "primvars:encore:shadingRate:refraction"};
inline constexpr float kLargestShadingRate = 256;

struct Mesh {
  std::string path;  // prim path, for messages
  // Meshes that share it differ in nothing but their material, face_materials, shading_rate and link_group, so that
  // what was made of one can be used for the other, and all but these is known to be valid: identify() gives it.
  // Null: unknown.
  std::shared_ptr<const void> identity;
  Shape shape = Shape::Faces;
  SubdivisionScheme scheme = SubdivisionScheme::CatmullClark;
  InterpolateBoundary boundary = InterpolateBoundary::EdgeAndCorner;
  FaceVaryingInterpolation face_varying = FaceVaryingInterpolation::CornersPlus1;
  TriangleSubdivision triangle_subdivision = TriangleSubdivision::CatmullClark;
  bool left_handed = false;
  bool double_sided = false;

  SharedVector<Vec3f> points;  // prototype space, at the frame's time
  // Points at uniform times from shutter open to close, two or more; empty: the mesh does not deform.
  SharedVector<std::vector<Vec3f>> motion_points;
  SharedVector<int32_t> face_vertex_counts;  // of curves: points per curve; of points: empty
  SharedVector<int32_t> face_vertex_indices;
  SharedVector<int32_t> hole_indices;
  SharedVector<int32_t> corner_indices;
  SharedVector<float> corner_sharpnesses;
  SharedVector<int32_t> crease_indices;  // runs of crease_lengths[i] points
  SharedVector<int32_t> crease_lengths;
  SharedVector<float> crease_sharpnesses;  // one per crease, or one per edge of every crease

  // Of curves and points.
  CurveBasis basis = CurveBasis::Linear;
  CurveWrap wrap = CurveWrap::Nonperiodic;
  Primvar<float> widths;  // diameters, prototype space; empty: 1

  Primvar<Vec3f> normals;  // used only where scheme is None; of curves: the way that ribbons face, empty: tubes
  // normals.values at the times of motion_points; empty: they stay, or are those of the geometry.
  SharedVector<std::vector<Vec3f>> motion_normals;
  Primvar<Vec3f> display_color;           // linear working space
  std::vector<Primvar<Vec2f>> texcoords;  // by name; a material asks for them by name
  std::vector<Primvar<Vec4f>> primvars;   // what else materials read, by name; missing channels are 0

  // Material of every base face: empty (all faces use material), or one index per face; -1: material.
  SharedVector<int32_t> face_materials;
  int32_t material = 0;

  float target_edge_length_world = 0;  // primvars:encore:targetEdgeLength; 0: the default
  // Of transparent materials: a sheet that light passes straight, and not the skin of a solid that bends it.
  bool thin_walled = false;
  uint32_t link_group = 0;    // what lights tell apart: Light::lit_groups
  LayerRates shading_rate{};  // primvars:encore:shadingRate and its per-layer forms; 0: the frame's
};

}  // namespace encore
