// _core.Mesh: what is known of a mesh without the scene that it is rendered in, and how scenes take it.
#include <tuple>

#include "core/python/bindings.h"
#include "core/python/dictionaries.h"
#include "core/scene/scene.h"

namespace encore::python {
namespace {

using KeysArray = nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
// (interpolation, values, indices or None)
template <class T>
using PrimvarTuple = std::tuple<std::string, ArrayOf<T>, OptionalArrayOf<int32_t>>;
// (name, interpolation, values, indices or None)
template <class T>
using NamedPrimvarTuple = std::tuple<std::string, std::string, ArrayOf<T>, OptionalArrayOf<int32_t>>;

template <class T>
Primvar<T> makePrimvar(const Mesh& mesh, std::string name, const std::string& interpolation, const ArrayOf<T>& values,
                       const OptionalArrayOf<int32_t>& indices) {
  const Interpolation kind = fromName(kInterpolations, interpolation, mesh.path + "." + name);
  return {std::move(name), kind, toVector<T>(values), toVector<int32_t>(indices)};
}
template <class T>
Primvar<T> makePrimvar(const Mesh& mesh, std::string name, const std::optional<PrimvarTuple<T>>& primvar) {
  if (!primvar) return {};
  const auto& [interpolation, values, indices] = *primvar;
  return makePrimvar<T>(mesh, std::move(name), interpolation, values, indices);
}

std::vector<std::vector<Vec3f>> toKeys(const std::optional<KeysArray>& array) {
  if (!array) return {};
  const size_t count = array->shape(1);
  std::vector<std::vector<Vec3f>> keys(array->shape(0), std::vector<Vec3f>(count));
  for (size_t k = 0; k < keys.size(); ++k)
    if (count) std::memcpy(static_cast<void*>(keys[k].data()), array->data() + k * count * 3, count * sizeof(Vec3f));
  return keys;
}

void initMesh(Mesh* self, std::string path, const ArrayOf<Vec3f>& points, const ArrayOf<int32_t>& face_vertex_counts,
              const ArrayOf<int32_t>& face_vertex_indices, const std::string& scheme,
              const std::string& interpolate_boundary, const std::string& face_varying,
              const std::string& triangle_subdivision, bool left_handed, bool double_sided,
              const OptionalArrayOf<int32_t>& hole_indices, const OptionalArrayOf<int32_t>& corner_indices,
              const OptionalArrayOf<float>& corner_sharpnesses, const OptionalArrayOf<int32_t>& crease_indices,
              const OptionalArrayOf<int32_t>& crease_lengths, const OptionalArrayOf<float>& crease_sharpnesses,
              const std::optional<PrimvarTuple<Vec3f>>& normals,
              const std::optional<PrimvarTuple<Vec3f>>& display_color,
              const std::vector<NamedPrimvarTuple<Vec2f>>& texcoords, float target_edge_length_world,
              const std::vector<NamedPrimvarTuple<Vec4f>>& primvars, bool thin_walled,
              const std::optional<KeysArray>& motion_points, const std::optional<KeysArray>& motion_normals,
              const std::string& shape, const std::string& basis, const std::string& wrap,
              const std::optional<PrimvarTuple<float>>& widths) {
  Mesh mesh;
  mesh.path = std::move(path);
  mesh.shape = fromName(kShapes, shape, mesh.path);
  mesh.basis = fromName(kCurveBases, basis, mesh.path + ".basis");
  mesh.wrap = fromName(kCurveWraps, wrap, mesh.path + ".wrap");
  mesh.scheme = fromName(kSchemes, scheme, mesh.path + ".subdivisionScheme");
  mesh.boundary = fromName(kBoundaries, interpolate_boundary, mesh.path + ".interpolateBoundary");
  mesh.face_varying = fromName(kFaceVarying, face_varying, mesh.path + ".faceVaryingLinearInterpolation");
  mesh.triangle_subdivision =
      fromName(kTriangleSubdivisions, triangle_subdivision, mesh.path + ".triangleSubdivisionRule");
  mesh.left_handed = left_handed;
  mesh.double_sided = double_sided;

  mesh.points = toVector<Vec3f>(points);
  mesh.face_vertex_counts = toVector<int32_t>(face_vertex_counts);
  mesh.face_vertex_indices = toVector<int32_t>(face_vertex_indices);
  mesh.hole_indices = toVector<int32_t>(hole_indices);
  mesh.corner_indices = toVector<int32_t>(corner_indices);
  mesh.corner_sharpnesses = toVector<float>(corner_sharpnesses);
  mesh.crease_indices = toVector<int32_t>(crease_indices);
  mesh.crease_lengths = toVector<int32_t>(crease_lengths);
  mesh.crease_sharpnesses = toVector<float>(crease_sharpnesses);

  mesh.widths = makePrimvar<float>(mesh, "widths", widths);
  mesh.normals = makePrimvar<Vec3f>(mesh, "normals", normals);
  mesh.display_color = makePrimvar<Vec3f>(mesh, "displayColor", display_color);
  for (const auto& [name, interpolation, values, indices] : texcoords)
    mesh.texcoords.push_back(makePrimvar<Vec2f>(mesh, name, interpolation, values, indices));
  mesh.target_edge_length_world = target_edge_length_world;
  for (const auto& [name, interpolation, values, indices] : primvars)
    mesh.primvars.push_back(makePrimvar<Vec4f>(mesh, name, interpolation, values, indices));
  mesh.thin_walled = thin_walled;
  mesh.motion_points = toKeys(motion_points);
  mesh.motion_normals = toKeys(motion_normals);
  identify(mesh);
  new (self) Mesh(std::move(mesh));
}

size_t addMesh(Scene& scene, const Mesh& handle, int32_t material, const OptionalArrayOf<int32_t>& face_materials,
               LayerRates shading_rate, uint32_t link_group) {
  Mesh mesh = handle;
  mesh.material = material;
  if (face_materials) mesh.face_materials = toVector<int32_t>(face_materials);
  mesh.shading_rate = shading_rate;
  mesh.link_group = link_group;
  validateMesh(mesh, scene.materials.size());
  scene.meshes.push_back(std::move(mesh));
  return scene.meshes.size() - 1;
}

// A handle that nobody else has.
size_t addNewMesh(Scene& scene, const nb::args& positional, const nb::kwargs& keywords) {
  nb::dict own = copyOf(keywords);
  nb::kwargs placed = nb::steal<nb::kwargs>(nb::dict().release());
  for (const char* key : {"material", "face_materials", "shading_rate", "link_group"})
    if (own.contains(key)) {
      placed[key] = nb::object(own[key]);
      nb::del(own[key]);
    }
  const nb::object mesh = nb::type<Mesh>()(*positional, **nb::borrow<nb::kwargs>(own));
  return nb::cast<size_t>(nb::find(scene).attr("add_mesh")(mesh, **placed));
}

}  // namespace

void bindMeshes(nb::module_& module, nb::class_<Scene>& scene) {
  nb::class_<Mesh>(
      module, "Mesh",
      "A mesh that scenes can take again and again. Scenes that have it share its arrays, and frames that\n"
      "follow one another with one RenderCache what was made of it.")
      .def("__init__", &initMesh, nb::arg("path"), nb::arg("points"), nb::arg("face_vertex_counts"),
           nb::arg("face_vertex_indices"), nb::kw_only(), nb::arg("scheme") = "catmullClark",
           nb::arg("interpolate_boundary") = "edgeAndCorner", nb::arg("face_varying") = "cornersPlus1",
           nb::arg("triangle_subdivision") = "catmullClark", nb::arg("left_handed") = false,
           nb::arg("double_sided") = false, nb::arg("hole_indices") = nb::none(),
           nb::arg("corner_indices") = nb::none(), nb::arg("corner_sharpnesses") = nb::none(),
           nb::arg("crease_indices") = nb::none(), nb::arg("crease_lengths") = nb::none(),
           nb::arg("crease_sharpnesses") = nb::none(), nb::arg("normals") = nb::none(),
           nb::arg("display_color") = nb::none(), nb::arg("texcoords") = nb::list(),
           nb::arg("target_edge_length_world") = 0.0f, nb::arg("primvars") = nb::list(), nb::arg("thin_walled") = false,
           nb::arg("motion_points") = nb::none(), nb::arg("motion_normals") = nb::none(), nb::arg("shape") = "faces",
           nb::arg("basis") = "linear", nb::arg("wrap") = "nonperiodic", nb::arg("widths") = nb::none(),
           "Copies and checks the arrays, once. Raises Error (kind 'scene') when they cannot be rendered.\n\n"
           "points: (n, 3) float32, prototype space; counts and indices: int32. Primvars are tuples\n"
           "(interpolation, values, indices or None), texcoords a list of (name, interpolation, values, indices).\n"
           "primvars: as texcoords, four floats to a value. motion_points and motion_normals: (keys, n, 3).\n"
           "shape: faces, curves or points; basis: linear or UsdGeomBasisCurves'; wrap: likewise; widths: diameters.")
      .def_ro("path", &Mesh::path);
  scene.def("add_mesh", &addMesh, nb::arg("mesh"), nb::arg("material") = 0, nb::arg("face_materials") = nb::none(),
            nb::arg("shading_rate") = LayerRates{}, nb::arg("link_group") = 0,
            "Adds a mesh; its index. Raises Error (kind 'scene') when it does not fit the scene.\n\n"
            "face_materials: int32, one material index per face, -1 for `material`. Materials must be there before.\n"
            "shading_rate: per pixel in the direct, reflection and refraction layer; 0: the frame's.");
  scene.def("add_mesh", &addNewMesh, nb::arg("arguments"), nb::arg("keywords"),
            "The same with the arguments of Mesh instead of one.");
}

}  // namespace encore::python
