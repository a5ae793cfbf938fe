// _core.Scene: what the delegate hands over. Every add_ function returns the index of what it added.
#include <algorithm>
#include <tuple>

#include "core/python/bindings.h"
#include "core/python/dictionaries.h"
#include "core/python/scene_reading.h"
#include "core/scene/scene.h"

namespace encore::python {
namespace {

using MotionsArray = nb::ndarray<const double, nb::shape<-1, -1, 4, 4>, nb::c_contig, nb::device::cpu>;
// (name, wins, values): see InstancePrimvar.
using InstancePrimvarTuple = std::tuple<std::string, bool, ArrayOf<Vec4f>>;

// The index of a name in Scene::instance_primvars, where it is added if need be.
uint32_t primvarName(Scene& scene, const std::string& name) {
  std::vector<std::string>& names = scene.instance_primvars;
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return uint32_t(found - names.begin());
  names.push_back(name);
  return uint32_t(names.size() - 1);
}

// Of the scene's last `count` instances, one value each.
void setInstancePrimvars(Scene& scene, size_t count, const std::vector<InstancePrimvarTuple>& primvars) {
  if (primvars.empty()) return;
  const size_t first = scene.instances.size() - count;
  for (size_t i = 0; i < count; ++i) scene.instances[first + i].primvars.reserve(primvars.size());
  for (const auto& [name, wins, values] : primvars) {
    const uint32_t index = primvarName(scene, name);
    const std::vector<Vec4f> all = toVector<Vec4f>(values);
    for (size_t i = 0; i < count; ++i) scene.instances[first + i].primvars.push_back({index, wins, all[i]});
  }
}

size_t addInstances(Scene& scene, const std::string& path, uint32_t prototype, const MatricesArray& matrices,
                    const OptionalArrayOf<int64_t>& ids, int32_t material, const OptionalArrayOf<Vec3f>& shading_rates,
                    const std::optional<MotionsArray>& motions, int32_t link_group,
                    const std::vector<InstancePrimvarTuple>& primvars) {
  const size_t count = matrices.shape(0), first = scene.instances.size();
  if (ids && ids->shape(0) != count) throw Error(ErrorKind::Internal, "there are not as many ids as matrices", path);
  if (shading_rates && shading_rates->shape(0) != count)
    throw Error(ErrorKind::Internal, "there are not as many shading rates as matrices", path);
  if (motions && motions->shape(0) != count)
    throw Error(ErrorKind::Internal, "there are not as many motions as matrices", path);
  for (const auto& [name, wins, values] : primvars)
    if (values.shape(0) != count)
      throw Error(ErrorKind::Internal, "there are not as many values of " + name + " as matrices", path);
  // By a half at least, so that many small calls do not move all that is there each time.
  if (scene.instances.capacity() < first + count) scene.instances.reserve(std::max(first + count, first + first / 2));
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
  setInstancePrimvars(scene, count, primvars);
  return first;
}

size_t addEach(Scene& scene, const std::vector<std::string>& paths, const ArrayOf<int32_t>& prototypes,
               const MatricesArray& matrices, const OptionalArrayOf<int32_t>& materials,
               const OptionalArrayOf<Vec3f>& shading_rates, const OptionalArrayOf<int32_t>& link_groups) {
  const size_t count = paths.size(), first = scene.instances.size();
  const auto check = [&](size_t found, const char* what) {
    if (found != count)
      throw Error(ErrorKind::Internal, std::string("there are not as many ") + what + " as paths",
                  count ? paths[0] : "instances");
  };
  check(prototypes.shape(0), "prototypes");
  check(matrices.shape(0), "matrices");
  if (materials) check(materials->shape(0), "materials");
  if (shading_rates) check(shading_rates->shape(0), "shading rates");
  if (link_groups) check(link_groups->shape(0), "link groups");
  scene.instances.reserve(std::max(first + count, scene.instances.capacity()));
  for (size_t i = 0; i < count; ++i) {
    Instance& instance = scene.instances.emplace_back();
    instance.path = paths[i];
    instance.prototype = uint32_t(prototypes.data()[i]);  // a negative one is beyond them all
    instance.to_world = toAffine(matrices.data() + i * 16);
    if (materials) instance.material = materials->data()[i];
    if (shading_rates) std::copy_n(shading_rates->data() + 3 * i, 3, instance.shading_rate.begin());
    if (link_groups) instance.link_group = link_groups->data()[i];
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
            nb::arg("motions") = nb::none(), nb::arg("link_group") = -1, nb::arg("primvars") = nb::list(),
            "Places a prototype once per matrix (n, 4, 4); the first index. Paths: path, or path[id] with ids.\n"
            "shading_rates: (n, 3) float32, as add_instance's. motions: (n, keys, 4, 4).\n"
            "primvars: a list of (name, wins, values), which materials read as if the meshes had them: where wins,\n"
            "instead of the meshes' own, else where they have none. values: (n, 4) float32, missing floats 0.");
  scene.def("add_each_instance", &addEach, nb::arg("paths"), nb::arg("prototypes"), nb::arg("matrices"),
            nb::arg("materials") = nb::none(), nb::arg("shading_rates") = nb::none(),
            nb::arg("link_groups") = nb::none(),
            "Places prototypes that may differ, each once; the first index: as add_instance() for each, but much\n"
            "faster for many. paths: n names; prototypes: (n) int32; matrices: (n, 4, 4) float64;\n"
            "materials and link_groups: (n) int32, -1: the meshes' own; shading_rates: (n, 3) float32.");
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
  scene.def("instance", [](const Scene& s, size_t i) { return readInstance(s, at(s.instances, i)); }, nb::arg("index"));
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
  bindMeshes(module, scene);
  bindAdding(scene);
  bindMaterials(module, scene);
  bindLights(scene);
  bindReading(scene);
  scene.def("validate", &Scene::validate, "Raises Error (kind 'scene') when the scene cannot be rendered.");
}

}  // namespace encore::python
