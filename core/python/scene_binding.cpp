// _core.Scene: what the delegate hands over. Every add_ function returns the index of what it added.
#include <tuple>

#include "core/python/arrays.h"
#include "core/python/bindings.h"
#include "core/python/names.h"
#include "core/python/scene_reading.h"
#include "core/scene/scene.h"

namespace encore::python {
namespace {

using Triple = std::array<float, 3>;
using TripleD = std::array<double, 3>;
// USD's row-vector convention: point * matrix, translation in the last row.
using MatrixArray = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using MatricesArray = nb::ndarray<const double, nb::shape<-1, 4, 4>, nb::c_contig, nb::device::cpu>;
using PixelArray = nb::ndarray<const float, nb::shape<-1, -1, 4>, nb::c_contig, nb::device::cpu>;
// (interpolation, values, indices or None)
template <class T>
using PrimvarTuple = std::tuple<std::string, ArrayOf<T>, OptionalArrayOf<int32_t>>;
// (name, interpolation, values, indices or None)
using TexcoordTuple = std::tuple<std::string, std::string, ArrayOf<Vec2f>, OptionalArrayOf<int32_t>>;

template <class T>
Vec3<T> toVec(const std::array<T, 3>& v) {
  return {v[0], v[1], v[2]};
}

// The rows of USD's matrix are the images of the axes and of the origin.
Affine3d toAffine(const double* m) {
  return {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}, {m[12], m[13], m[14]}};
}

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

size_t addMesh(Scene& scene, std::string path, const ArrayOf<Vec3f>& points, const ArrayOf<int32_t>& face_vertex_counts,
               const ArrayOf<int32_t>& face_vertex_indices, const std::string& scheme,
               const std::string& interpolate_boundary, const std::string& face_varying,
               const std::string& triangle_subdivision, bool left_handed, bool double_sided,
               const OptionalArrayOf<int32_t>& hole_indices, const OptionalArrayOf<int32_t>& corner_indices,
               const OptionalArrayOf<float>& corner_sharpnesses, const OptionalArrayOf<int32_t>& crease_indices,
               const OptionalArrayOf<int32_t>& crease_lengths, const OptionalArrayOf<float>& crease_sharpnesses,
               const std::optional<PrimvarTuple<Vec3f>>& normals,
               const std::optional<PrimvarTuple<Vec3f>>& display_color, const std::vector<TexcoordTuple>& texcoords,
               const OptionalArrayOf<int32_t>& face_materials, int32_t material, float target_edge_length_world,
               LayerRates shading_rate) {
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
  validateMesh(mesh, scene.materials.size());
  scene.meshes.push_back(std::move(mesh));
  return scene.meshes.size() - 1;
}

size_t addInstances(Scene& scene, const std::string& path, uint32_t prototype, const MatricesArray& matrices,
                    const OptionalArrayOf<int64_t>& ids, int32_t material,
                    const OptionalArrayOf<Vec3f>& shading_rates) {
  const size_t count = matrices.shape(0), first = scene.instances.size();
  if (ids && ids->shape(0) != count) throw Error(ErrorKind::Internal, "there are not as many ids as matrices", path);
  if (shading_rates && shading_rates->shape(0) != count)
    throw Error(ErrorKind::Internal, "there are not as many shading rates as matrices", path);
  for (size_t i = 0; i < count; ++i) {
    LayerRates rates{};
    if (shading_rates) std::copy_n(shading_rates->data() + 3 * i, 3, rates.begin());
    std::string name = ids ? path + "[" + std::to_string(ids->data()[i]) + "]" : path;
    scene.instances.push_back({std::move(name), prototype, toAffine(matrices.data() + i * 16), material, rates});
  }
  return first;
}

size_t addTexture(Scene& scene, std::string path, const PixelArray& pixels) {
  Texture texture{std::move(path), uint32_t(pixels.shape(1)), uint32_t(pixels.shape(0)), {}};
  texture.rgba.assign(pixels.data(), pixels.data() + pixels.size());
  scene.textures.push_back(std::move(texture));
  return scene.textures.size() - 1;
}

nb::dict copyOf(nb::handle dictionary) { return nb::cast<nb::dict>(dictionary.attr("copy")()); }
// Reads `d[key]` into value when there is such a key, and takes the key off the dictionary.
template <class T>
void take(nb::dict& d, const char* key, T& value) {
  if (!d.contains(key)) return;
  value = nb::cast<T>(nb::object(d[key]));
  nb::del(d[key]);
}
template <class E, size_t N>
void takeName(nb::dict& d, const char* key, E& value, const Names<E, N>& names, const std::string& where) {
  std::string name = toName(names, value);
  take(d, key, name);
  value = fromName(names, name, where + "." + key);
}
void requireEmpty(const nb::dict& d, const std::string& where) {
  if (d.size() == 0) return;
  throw Error(ErrorKind::Internal, "unknown key '" + nb::cast<std::string>(nb::str(nb::list(d.keys())[0])) + "'",
              where);
}

PatternNode toNode(nb::handle source) {
  nb::dict d = copyOf(source);
  PatternNode node;
  take(d, "path", node.path);
  takeName(d, "kind", node.kind, kNodeKinds, node.path);
  take(d, "texture", node.texture);
  take(d, "texcoord", node.texcoord);
  take(d, "st_transform", node.st_transform);
  takeName(d, "wrap_s", node.wrap_s, kWrapModes, node.path);
  takeName(d, "wrap_t", node.wrap_t, kWrapModes, node.path);
  take(d, "scale", node.scale);
  take(d, "bias", node.bias);
  take(d, "fallback", node.fallback);
  requireEmpty(d, node.path);
  return node;
}

// A constant, or {'value': constant, 'node': index, 'channel': first channel}.
template <class T>
void takeInput(nb::dict& inputs, const char* key, Input<T>& input) {
  if (!inputs.contains(key)) return;
  nb::object source(inputs[key]);
  nb::del(inputs[key]);
  if (nb::isinstance<nb::dict>(source)) {
    nb::dict d = nb::cast<nb::dict>(source);
    input.node = nb::cast<int32_t>(nb::object(d["node"]));
    input.channel = nb::cast<int32_t>(nb::object(d["channel"]));
    source = nb::object(d["value"]);
  }
  if constexpr (std::is_same_v<T, float>)
    input.value = nb::cast<float>(source);
  else
    input.value = toVec(nb::cast<Triple>(source));
}

size_t addMaterial(Scene& scene, std::string path, const nb::dict& inputs, const nb::list& nodes,
                   bool use_specular_workflow, float opacity_threshold) {
  Material material;
  material.path = std::move(path);
  material.use_specular_workflow = use_specular_workflow;
  material.opacity_threshold = opacity_threshold;
  for (nb::handle node : nodes) material.nodes.push_back(toNode(node));
  nb::dict d = copyOf(inputs);
  takeInput(d, "diffuse_color", material.diffuse_color);
  takeInput(d, "emissive_color", material.emissive_color);
  takeInput(d, "specular_color", material.specular_color);
  takeInput(d, "metallic", material.metallic);
  takeInput(d, "roughness", material.roughness);
  takeInput(d, "clearcoat", material.clearcoat);
  takeInput(d, "clearcoat_roughness", material.clearcoat_roughness);
  takeInput(d, "opacity", material.opacity);
  takeInput(d, "ior", material.ior);
  requireEmpty(d, material.path);
  scene.materials.push_back(std::move(material));
  return scene.materials.size() - 1;
}

size_t addLight(Scene& scene, const std::string& kind, std::string path, const Triple& radiance, float diffuse,
                float specular, const Triple& direction, float angle_radians, const TripleD& centre,
                const Triple& half_u, const Triple& half_v, float radius) {
  Light light;
  light.kind = fromName(kLightKinds, kind, path);
  light.path = std::move(path);
  light.radiance = toVec(radiance);
  light.diffuse = diffuse;
  light.specular = specular;
  light.direction = toVec(direction);
  light.angle_radians = angle_radians;
  light.centre = toVec(centre);
  light.half_u = toVec(half_u);
  light.half_v = toVec(half_v);
  light.radius = radius;
  scene.lights.push_back(std::move(light));
  return scene.lights.size() - 1;
}

void setCamera(Scene& scene, std::string path, const MatrixArray& matrix, const std::array<float, 2>& half_tangent,
               const std::array<float, 2>& centre_tangent, float near_clip, float far_clip) {
  scene.camera = {std::move(path),
                  toAffine(matrix.data()),
                  {half_tangent[0], half_tangent[1]},
                  {centre_tangent[0], centre_tangent[1]},
                  near_clip,
                  far_clip};
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
            nb::arg("shading_rate") = LayerRates{},
            "Adds a mesh; its index. Raises Error (kind 'scene') when it cannot be rendered.\n\n"
            "points: (n, 3) float32, prototype space; counts and indices: int32. Primvars are tuples\n"
            "(interpolation, values, indices or None), texcoords a list of (name, interpolation, values, indices).\n"
            "face_materials: one material index per face, -1 for `material`. Materials must be there before.\n"
            "shading_rate: per pixel in the direct, reflection and refraction layer; 0: the frame's.");
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
         LayerRates shading_rate) {
        self.instances.push_back({std::move(path), prototype, toAffine(matrix.data()), material, shading_rate});
        return self.instances.size() - 1;
      },
      nb::arg("path"), nb::arg("prototype"), nb::arg("matrix"), nb::arg("material") = -1,
      nb::arg("shading_rate") = LayerRates{},
      "Places a prototype; the instance's index. matrix: (4, 4) float64, USD's row vectors.\n"
      "material: replaces the meshes' own where it is not -1; shading_rate where above 0, per layer.");
  scene.def("add_instances", &addInstances, nb::arg("path"), nb::arg("prototype"), nb::arg("matrices"),
            nb::arg("ids") = nb::none(), nb::arg("material") = -1, nb::arg("shading_rates") = nb::none(),
            "Places a prototype once per matrix (n, 4, 4); the first index. Paths: path, or path[id] with ids.\n"
            "shading_rates: (n, 3) float32, as add_instance's.");
  scene.def("add_texture", &addTexture, nb::arg("path"), nb::arg("pixels"),
            "Adds linear pixels (height, width, 4) float32, bottom row first; the texture's index.");
  scene.def("add_material", &addMaterial, nb::arg("path"), nb::arg("inputs") = nb::dict(),
            nb::arg("nodes") = nb::list(), nb::arg("use_specular_workflow") = false,
            nb::arg("opacity_threshold") = 0.0f,
            "Adds a material; its index. inputs: fields of UsdPreviewSurface in snake case, each a constant or\n"
            "{'value', 'node', 'channel'}; nodes: dictionaries with the fields of core's PatternNode.");
  scene.def("add_light", &addLight, nb::arg("kind"), nb::arg("path"), nb::arg("radiance"), nb::kw_only(),
            nb::arg("diffuse") = 1.0f, nb::arg("specular") = 1.0f, nb::arg("direction") = Triple{0, 0, -1},
            nb::arg("angle_radians") = 0.0f, nb::arg("centre") = TripleD{0, 0, 0},
            nb::arg("half_u") = Triple{0.5f, 0, 0}, nb::arg("half_v") = Triple{0, 0.5f, 0}, nb::arg("radius") = 0.5f,
            "Adds a light in world space; its index. kind: 'distant', 'rect', 'sphere' or 'dome'.\n\n"
            "radiance: of the surface; irradiance for a distant light with angle 0.");
  scene.def("set_camera", &setCamera, nb::arg("path"), nb::arg("matrix"), nb::arg("half_tangent"),
            nb::arg("centre_tangent") = std::array<float, 2>{0, 0}, nb::arg("near_clip") = 0.0f,
            nb::arg("far_clip") = 1e30f, "Sets the camera: film window in tangents, clipping distances along -Z.");
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
  bindReading(scene);
  scene.def("validate", &Scene::validate, "Raises Error (kind 'scene') when the scene cannot be rendered.");
}

}  // namespace encore::python
