// _core.Scene: what the delegate hands over. Every add_ function returns the index of what it added.
#include <tuple>

#include "core/python/bindings.h"
#include "core/python/dictionaries.h"
#include "core/python/scene_reading.h"
#include "core/scene/scene.h"

namespace encore::python {
namespace {

using KeysArray = nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using MotionsArray = nb::ndarray<const double, nb::shape<-1, -1, 4, 4>, nb::c_contig, nb::device::cpu>;
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

size_t addMesh(Scene& scene, std::string path, const ArrayOf<Vec3f>& points, const ArrayOf<int32_t>& face_vertex_counts,
               const ArrayOf<int32_t>& face_vertex_indices, const std::string& scheme,
               const std::string& interpolate_boundary, const std::string& face_varying,
               const std::string& triangle_subdivision, bool left_handed, bool double_sided,
               const OptionalArrayOf<int32_t>& hole_indices, const OptionalArrayOf<int32_t>& corner_indices,
               const OptionalArrayOf<float>& corner_sharpnesses, const OptionalArrayOf<int32_t>& crease_indices,
               const OptionalArrayOf<int32_t>& crease_lengths, const OptionalArrayOf<float>& crease_sharpnesses,
               const std::optional<PrimvarTuple<Vec3f>>& normals,
               const std::optional<PrimvarTuple<Vec3f>>& display_color,
               const std::vector<NamedPrimvarTuple<Vec2f>>& texcoords, const OptionalArrayOf<int32_t>& face_materials,
               int32_t material, float target_edge_length_world, LayerRates shading_rate,
               const std::vector<NamedPrimvarTuple<Vec4f>>& primvars, bool thin_walled, uint32_t link_group,
               const std::optional<KeysArray>& motion_points, const std::optional<KeysArray>& motion_normals) {
  Mesh mesh;
  mesh.path = std::move(path);
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

  mesh.normals = makePrimvar<Vec3f>(mesh, "normals", normals);
  mesh.display_color = makePrimvar<Vec3f>(mesh, "displayColor", display_color);
  for (const auto& [name, interpolation, values, indices] : texcoords)
    mesh.texcoords.push_back(makePrimvar<Vec2f>(mesh, name, interpolation, values, indices));

  mesh.face_materials = toVector<int32_t>(face_materials);
  mesh.material = material;
  mesh.target_edge_length_world = target_edge_length_world;
  mesh.shading_rate = shading_rate;
  for (const auto& [name, interpolation, values, indices] : primvars)
    mesh.primvars.push_back(makePrimvar<Vec4f>(mesh, name, interpolation, values, indices));
  mesh.thin_walled = thin_walled;
  mesh.link_group = link_group;
  mesh.motion_points = toKeys(motion_points);
  mesh.motion_normals = toKeys(motion_normals);
  validateMesh(mesh, scene.materials.size());
  scene.meshes.push_back(std::move(mesh));
  return scene.meshes.size() - 1;
}

size_t addInstances(Scene& scene, const std::string& path, uint32_t prototype, const MatricesArray& matrices,
                    const OptionalArrayOf<int64_t>& ids, int32_t material, const OptionalArrayOf<Vec3f>& shading_rates,
                    const std::optional<MotionsArray>& motions, int32_t link_group) {
  const size_t count = matrices.shape(0), first = scene.instances.size();
  if (ids && ids->shape(0) != count) throw Error(ErrorKind::Internal, "there are not as many ids as matrices", path);
  if (shading_rates && shading_rates->shape(0) != count)
    throw Error(ErrorKind::Internal, "there are not as many shading rates as matrices", path);
  if (motions && motions->shape(0) != count)
    throw Error(ErrorKind::Internal, "there are not as many motions as matrices", path);
  const size_t keys = motions ? motions->shape(1) : 0;
  for (size_t i = 0; i < count; ++i) {
    LayerRates rates{};
    if (shading_rates) std::copy_n(shading_rates->data() + 3 * i, 3, rates.begin());
    std::string name = ids ? path + "[" + std::to_string(ids->data()[i]) + "]" : path;
    std::vector<Affine3d> motion(keys);
    for (size_t k = 0; k < keys; ++k) motion[k] = toAffine(motions->data() + (i * keys + k) * 16);
    scene.instances.push_back({std::move(name), prototype, toAffine(matrices.data() + i * 16), std::move(motion),
                               material, rates, link_group});
  }
  return first;
}

// index as in Python, from 0; throws IndexError.
template <class T>
const T& at(const std::vector<T>& items, size_t index) {
  if (index >= items.size()) throw nb::index_error("there is no such element in the scene");
  return items[index];
}

void bindAdding(nb::class_<Scene>& scene) {
  scene.def("add_mesh", &addMesh, nb::arg("path"), nb::arg("points"), nb::arg("face_vertex_counts"),
            nb::arg("face_vertex_indices"), nb::kw_only(), nb::arg("scheme") = "catmullClark",
            nb::arg("interpolate_boundary") = "edgeAndCorner", nb::arg("face_varying") = "cornersPlus1",
            nb::arg("triangle_subdivision") = "catmullClark", nb::arg("left_handed") = false,
            nb::arg("double_sided") = false, nb::arg("hole_indices") = nb::none(),
            nb::arg("corner_indices") = nb::none(), nb::arg("corner_sharpnesses") = nb::none(),
            nb::arg("crease_indices") = nb::none(), nb::arg("crease_lengths") = nb::none(),
            nb::arg("crease_sharpnesses") = nb::none(), nb::arg("normals") = nb::none(),
            nb::arg("display_color") = nb::none(), nb::arg("texcoords") = nb::list(),
            nb::arg("face_materials") = nb::none(), nb::arg("material") = 0, nb::arg("target_edge_length_world") = 0.0f,
            nb::arg("shading_rate") = LayerRates{}, nb::arg("primvars") = nb::list(), nb::arg("thin_walled") = false,
            nb::arg("link_group") = 0, nb::arg("motion_points") = nb::none(), nb::arg("motion_normals") = nb::none(),
            "Adds a mesh; its index. Raises Error (kind 'scene') when it cannot be rendered.\n\n"
            "points: (n, 3) float32, prototype space; counts and indices: int32. Primvars are tuples\n"
            "(interpolation, values, indices or None), texcoords a list of (name, interpolation, values, indices).\n"
            "face_materials: one material index per face, -1 for `material`. Materials must be there before.\n"
            "shading_rate: per pixel in the direct, reflection and refraction layer; 0: the frame's.\n"
            "primvars: as texcoords, four floats to a value. motion_points and motion_normals: (keys, n, 3).");
  scene.def(
      "add_prototype",
      [](Scene& self, std::string path, std::vector<uint32_t> meshes) {
        self.prototypes.push_back({std::move(path), std::move(meshes)});
        return self.prototypes.size() - 1;
      },
      nb::arg("path"), nb::arg("meshes"), "Adds meshes that are placed together; the prototype's index.");
  scene.def(
      "add_instance",
      [](Scene& self, std::string path, uint32_t prototype, const MatrixArray& matrix, int32_t material,
         LayerRates shading_rate, const std::optional<MatricesArray>& motion, int32_t link_group) {
        self.instances.push_back({std::move(path), prototype, toAffine(matrix.data()), toAffines(motion), material,
                                  shading_rate, link_group});
        return self.instances.size() - 1;
      },
      nb::arg("path"), nb::arg("prototype"), nb::arg("matrix"), nb::arg("material") = -1,
      nb::arg("shading_rate") = LayerRates{}, nb::arg("motion") = nb::none(), nb::arg("link_group") = -1,
      "Places a prototype; the instance's index. matrix: (4, 4) float64, USD's row vectors.\n"
      "material and link_group replace the meshes' own where they are not -1; shading_rate where above 0, per layer.\n"
      "motion: (keys, 4, 4), uniform times over the shutter.");
  scene.def("add_instances", &addInstances, nb::arg("path"), nb::arg("prototype"), nb::arg("matrices"),
            nb::arg("ids") = nb::none(), nb::arg("material") = -1, nb::arg("shading_rates") = nb::none(),
            nb::arg("motions") = nb::none(), nb::arg("link_group") = -1,
            "Places a prototype once per matrix (n, 4, 4); the first index. Paths: path, or path[id] with ids.\n"
            "shading_rates: (n, 3) float32, as add_instance's. motions: (n, keys, 4, 4).");
}

void bindReading(nb::class_<Scene>& scene) {
  scene.def_prop_ro("mesh_count", [](const Scene& s) { return s.meshes.size(); });
  scene.def_prop_ro("prototype_count", [](const Scene& s) { return s.prototypes.size(); });
  scene.def_prop_ro("instance_count", [](const Scene& s) { return s.instances.size(); });
  scene.def_prop_ro("texture_count", [](const Scene& s) { return s.textures.size(); });
  scene.def_prop_ro("material_count", [](const Scene& s) { return s.materials.size(); });
  scene.def_prop_ro("light_count", [](const Scene& s) { return s.lights.size(); });
  scene.def("mesh", [](const Scene& s, size_t i) { return readMesh(at(s.meshes, i)); }, nb::arg("index"));
  scene.def(
      "prototype",
      [](const Scene& s, size_t i) {
        nb::dict d;
        d["path"] = at(s.prototypes, i).path;
        d["meshes"] = s.prototypes[i].meshes;
        return d;
      },
      nb::arg("index"));
  scene.def("instance", [](const Scene& s, size_t i) { return readInstance(at(s.instances, i)); }, nb::arg("index"));
  scene.def("texture", [](const Scene& s, size_t i) { return readTexture(at(s.textures, i)); }, nb::arg("index"));
  scene.def("material", [](const Scene& s, size_t i) { return readMaterial(at(s.materials, i)); }, nb::arg("index"));
  scene.def("light", [](const Scene& s, size_t i) { return readLight(at(s.lights, i)); }, nb::arg("index"));
  scene.def_prop_ro("camera", [](const Scene& s) { return readCamera(s.camera); });
}

}  // namespace

void bindScene(nb::module_& module) {
  nb::class_<Scene> scene(module, "Scene",
                          "What is to be rendered. Filled through the add_ functions; the others read it back as\n"
                          "dictionaries with copied arrays.");
  scene.def(nb::init<>());
  bindAdding(scene);
  bindMaterials(scene);
  bindLights(scene);
  bindReading(scene);
  scene.def("validate", &Scene::validate, "Raises Error (kind 'scene') when the scene cannot be rendered.");
}

}  // namespace encore::python
