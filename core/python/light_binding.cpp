// _core.Scene: lights and the camera.
#include "core/python/bindings.h"
#include "core/python/dictionaries.h"
#include "core/python/fields.h"
#include "core/scene/scene.h"

namespace encore::python {
namespace {

size_t addLight(Scene& scene, const std::string& kind, std::string path, const Triple& radiance,
                const nb::kwargs& fields) {
  Light light;
  light.kind = fromName(kLightKinds, kind, path);
  light.path = std::move(path);
  light.radiance = toVec(radiance);
  nb::dict d = copyOf(fields);
  forEachLightField(light, [&](const char* key, auto& field) { takeField(d, key, field, light.path); });
  requireEmpty(d, light.path);
  scene.lights.push_back(std::move(light));
  return scene.lights.size() - 1;
}

void setCamera(Scene& scene, std::string path, const MatrixArray& matrix, const std::array<float, 2>& half_tangent,
               const nb::kwargs& fields) {
  Camera camera;
  camera.path = std::move(path);
  camera.to_world = toAffine(matrix.data());
  camera.half_tangent = {half_tangent[0], half_tangent[1]};
  nb::dict d = copyOf(fields);
  forEachCameraField(camera, [&](const char* key, auto& field) { takeField(d, key, field, camera.path); });
  std::optional<MatricesArray> motion;
  take(d, "motion", motion);
  camera.motion = toAffines(motion);
  std::vector<std::array<float, 4>> planes;
  take(d, "clipping_planes", planes);
  for (const auto& plane : planes) camera.clipping_planes.push_back({{plane[0], plane[1], plane[2]}, plane[3]});
  requireEmpty(d, camera.path);
  scene.camera = std::move(camera);
}

}  // namespace

void bindLights(nb::class_<Scene>& scene) {
  scene.def("add_light", &addLight, nb::arg("kind"), nb::arg("path"), nb::arg("radiance"), nb::arg("fields"),
            "Adds a light in world space; its index. kind: 'distant', 'rect', 'disk', 'sphere', 'cylinder', 'dome'\n"
            "or 'mesh'. radiance: of the surface; irradiance for a distant light with angle 0. Keywords: the other\n"
            "fields of core's Light.");
  scene.def("set_camera", &setCamera, nb::arg("path"), nb::arg("matrix"), nb::arg("half_tangent"), nb::arg("fields"),
            "Sets the camera: film window in tangents (orthographic: in units). Keywords: the other fields of core's\n"
            "Camera; clipping_planes: [(x, y, z, offset)]; motion: (keys, 4, 4).");
}

}  // namespace encore::python
