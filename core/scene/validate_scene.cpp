// Scene::validate(): what ties the parts of a scene together. Meshes: validate_mesh.cpp.
#include <algorithm>
#include <set>

#include "core/scene/validate_parts.h"

namespace encore {
namespace {

using namespace validation;

void checkCamera(const Camera& camera) {
  checkTransform(camera.to_world, camera.path + ".xformOp:transform");
  checkKeys(std::span(camera.motion), camera.path + ".xformOp:transform", checkTransform);
  const auto check = [&](Vec2f value, bool valid, const char* attribute) {
    if (!valid || !allFinite(value))
      raise(camera.path + "." + attribute, "the film window has tangents " + text(value),
            "Give the camera finite apertures and a focal length above 0");
  };
  check(camera.half_tangent, camera.half_tangent.x > 0 && camera.half_tangent.y > 0, "horizontalAperture");
  check(camera.centre_tangent, true, "horizontalApertureOffset");
  if (!(camera.near_clip >= 0 && camera.far_clip > camera.near_clip && std::isfinite(camera.far_clip)))
    raise(camera.path + ".clippingRange", "the range is " + text(Vec2f{camera.near_clip, camera.far_clip}),
          "Choose finite distances, the nearer one at least 0 and below the farther one");
  for (const ClippingPlane& plane : camera.clipping_planes)
    checkFinite(allFinite(plane.normal) && std::isfinite(plane.offset), camera.path + ".clippingPlanes",
                text(plane.normal) + ", " + text(plane.offset));
  if (!(camera.lens_radius >= 0 && std::isfinite(camera.lens_radius)))
    raise(camera.path + ".fStop", "the lens has the radius " + text(camera.lens_radius),
          "Choose an fStop and a focalLength of 0 or above");
  if (camera.lens_radius > 0 && !(camera.focus_distance > 0 && std::isfinite(camera.focus_distance)))
    raise(camera.path + ".focusDistance", "the lens is focused at " + text(camera.focus_distance),
          "Choose a finite distance above 0, or fStop 0 for no blur");
  if (!(camera.exposure_scale >= 0 && std::isfinite(camera.exposure_scale)))
    raise(camera.path + ".exposure", "the exposure multiplies by " + text(camera.exposure_scale),
          "Choose a finite exposure");
}

bool hasVisibleFace(const Mesh& mesh) {
  if (mesh.shape == Shape::Points) return !mesh.points.empty();
  return std::set<int32_t>(mesh.hole_indices.begin(), mesh.hole_indices.end()).size() < mesh.face_vertex_counts.size();
}

void checkInstancePrimvars(const Scene& scene, const Instance& instance) {
  for (const InstancePrimvar& primvar : instance.primvars) {
    checkIndex(primvar.name, 0, scene.instance_primvars.size(), instance.path + ".primvars", "instance primvars");
    const auto where = [&] { return instance.path + ".primvars:" + scene.instance_primvars[primvar.name]; };
    if (!allFinite(primvar.value)) checkFinite(false, where(), text(primvar.value));
    const auto same = [&](const InstancePrimvar& other) { return other.name == primvar.name; };
    if (std::count_if(instance.primvars.begin(), instance.primvars.end(), same) > 1)
      raise(where(), "the instance has it more than once", "Give each instance one value per name");
  }
}

void checkInstancePrimvarNames(const std::vector<std::string>& names) {
  std::set<std::string> known;
  for (const std::string& name : names)
    if (name.empty() || !known.insert(name).second)
      raise("scene", "instances have a primvar called \"" + name + "\", which is empty or there twice",
            "Give each of them a name of its own");
}

// Instances and prototypes; returns whether any face is placed.
bool checkPlacement(const Scene& scene) {
  for (const Prototype& prototype : scene.prototypes)
    for (uint32_t mesh : prototype.meshes) checkIndex(mesh, 0, scene.meshes.size(), prototype.path, "meshes");
  std::vector<char> visible(scene.prototypes.size());
  for (size_t i = 0; i < visible.size(); ++i)
    for (uint32_t mesh : scene.prototypes[i].meshes) visible[i] |= hasVisibleFace(scene.meshes[mesh]);

  checkInstancePrimvarNames(scene.instance_primvars);
  bool any = false;
  for (const Instance& instance : scene.instances) {
    checkIndex(instance.prototype, 0, scene.prototypes.size(), instance.path, "prototypes");
    checkIndex(instance.material, -1, scene.materials.size(), instance.path + ".material:binding", "materials");
    checkTransform(instance.to_world, instance.path + ".xformOp:transform");
    checkKeys(std::span(instance.motion), instance.path + ".xformOp:transform", checkTransform);
    for (size_t layer = 0; layer < instance.shading_rate.size(); ++layer)
      if (!(instance.shading_rate[layer] >= 0 && instance.shading_rate[layer] <= kLargestShadingRate))
        raise(
            instance.path + "." + kLayerRateAttributes[layer],
            "value " + text(instance.shading_rate[layer]) + " is no shading rate",
            "Author a number from 0 (that of the mesh) to " + text(kLargestShadingRate) + " shading samples per pixel");
    checkInstancePrimvars(scene, instance);
    any |= visible[instance.prototype] != 0;
  }
  return any;
}

}  // namespace

bool Scene::moves() const {
  return !camera.motion.empty() ||
         std::any_of(instances.begin(), instances.end(), [](const Instance& i) { return !i.motion.empty(); }) ||
         std::any_of(meshes.begin(), meshes.end(), [](const Mesh& m) { return !m.motion_points.empty(); });
}

void Scene::validate() const {
  if (materials.empty()) raise("scene", "there is no material", "Add a default material as material 0");
  for (const Texture& texture : textures) checkTexture(texture);
  for (const Material& material : materials) checkMaterial(material, textures.size());
  for (const Mesh& mesh : meshes) validateMesh(mesh, materials.size());
  checkCamera(camera);
  const bool placed = checkPlacement(*this);
  for (const Light& light : lights) checkLight(light, *this);
  if (!placed)
    raise("stage", "no renderable prim",
          "Check visibility, purpose and population mask, and that the stage holds meshes or implicit shapes");
}

}  // namespace encore
