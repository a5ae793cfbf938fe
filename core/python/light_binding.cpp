// _core.Scene: lights and the camera.
#include "core/python/bindings.h"
#include "core/python/dictionaries.h"
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
  take(d, "diffuse", light.diffuse);
  take(d, "specular", light.specular);
  take(d, "samples", light.samples);
  take(d, "direction", light.direction);
  take(d, "angle_radians", light.angle_radians);
  take(d, "centre", light.centre);
  take(d, "half_u", light.half_u);
  take(d, "half_v", light.half_v);
  take(d, "radius", light.radius);
  take(d, "instance", light.instance);
  take(d, "texture", light.texture);
  takeName(d, "format", light.format, kDomeFormats, light.path);
  take(d, "axis_x", light.axis_x);
  take(d, "axis_y", light.axis_y);
  take(d, "axis_z", light.axis_z);
  take(d, "shaped", light.shaped);
  take(d, "shaping_axis", light.shaping_axis);
  take(d, "focus", light.focus);
  take(d, "focus_tint", light.focus_tint);
  take(d, "cone_angle_radians", light.cone_angle_radians);
  take(d, "cone_softness", light.cone_softness);
  take(d, "shadow_enable", light.shadow_enable);
  take(d, "shadow_color", light.shadow_color);
  take(d, "shadow_distance", light.shadow_distance);
  take(d, "shadow_falloff", light.shadow_falloff);
  take(d, "shadow_falloff_gamma", light.shadow_falloff_gamma);
  take(d, "lit_groups", light.lit_groups);
  take(d, "shadow_groups", light.shadow_groups);
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
  takeName(d, "projection", camera.projection, kProjections, camera.path);
  std::optional<MatricesArray> motion;
  take(d, "motion", motion);
  camera.motion = toAffines(motion);
  take(d, "centre_tangent", camera.centre_tangent);
  take(d, "near_clip", camera.near_clip);
  take(d, "far_clip", camera.far_clip);
  std::vector<std::array<float, 4>> planes;
  take(d, "clipping_planes", planes);
  for (const auto& plane : planes) camera.clipping_planes.push_back({{plane[0], plane[1], plane[2]}, plane[3]});
  take(d, "lens_radius", camera.lens_radius);
  take(d, "focus_distance", camera.focus_distance);
  take(d, "aperture_blades", camera.aperture_blades);
  take(d, "aperture_rotation_radians", camera.aperture_rotation_radians);
  take(d, "exposure_scale", camera.exposure_scale);
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
