// Scene::validate(): lights.
#include "core/scene/validate_parts.h"

namespace encore::validation {
namespace {

bool isUnit(Vec3f v) { return std::abs(length(v) - 1) < 1e-3f; }

// One of four shapes whose sizes have to be above 0.
void checkSize(bool valid, const Light& light, const char* attribute, const std::string& found,
               const std::string& remedy) {
  if (!valid) raise(light.path + "." + attribute, found, remedy);
}

void checkShape(const Light& light, const Scene& scene) {
  const auto above = [](float v) { return v > 0 && std::isfinite(v); };
  const std::string edges = "the light's half edges are " + text(light.half_u) + " and " + text(light.half_v);
  const std::string radius = "the light's radius is " + text(light.radius);
  switch (light.kind) {
    case Light::Kind::Distant:
      checkSize(isUnit(light.direction), light, "xformOp:transform",
                "the light's direction is " + text(light.direction), "Give the light a transform that can be inverted");
      checkSize(light.angle_radians >= 0 && light.angle_radians <= 2 * kPi * 1.0001f, light, "inputs:angle",
                "the light's angle is " + text(light.angle_radians) + " radians",
                "Choose an angle from 0 to 360 degrees");
      break;
    case Light::Kind::Rect:
      checkSize(above(length(cross(light.half_u, light.half_v))), light, "inputs:width", edges,
                "Give the light a finite width and height above 0");
      break;
    case Light::Kind::Disk:
      checkSize(above(length(cross(light.half_u, light.half_v))), light, "inputs:radius", edges,
                "Give the light a finite radius above 0");
      break;
    case Light::Kind::Sphere:
      checkSize(above(light.radius), light, "inputs:radius", radius, "Give the light a finite radius above 0");
      break;
    case Light::Kind::Cylinder:
      checkSize(above(light.radius), light, "inputs:radius", radius, "Give the light a finite radius above 0");
      checkSize(above(length(light.half_u)), light, "inputs:length", edges, "Give the light a finite length above 0");
      break;
    case Light::Kind::Dome:
      for (const Vec3f axis : {light.axis_x, light.axis_y, light.axis_z})
        checkSize(isUnit(axis), light, "xformOp:transform", "an axis of the light is " + text(axis),
                  "Give the light a rotation");
      break;
    case Light::Kind::Mesh:
      checkIndex(light.instance, 0, scene.instances.size(), light.path, "instances");
      break;
  }
}

void checkShaping(const Light& light) {
  if (!light.shaped) return;
  checkSize(isUnit(light.shaping_axis), light, "xformOp:transform",
            "the light shines along " + text(light.shaping_axis), "Give the light a transform that can be inverted");
  checkFinite(light.focus >= 0 && std::isfinite(light.focus), light.path + ".inputs:shaping:focus", text(light.focus));
  checkFinite(allFinite(light.focus_tint), light.path + ".inputs:shaping:focusTint", text(light.focus_tint));
  checkFinite(std::isfinite(light.cone_angle_radians), light.path + ".inputs:shaping:cone:angle",
              text(light.cone_angle_radians));
  checkFinite(std::isfinite(light.cone_softness), light.path + ".inputs:shaping:cone:softness",
              text(light.cone_softness));
}

}  // namespace

void checkLight(const Light& light, const Scene& scene) {
  const auto finite = [&](auto value, const char* attribute) {
    checkFinite(allFinite(value), light.path + "." + attribute, text(value));
  };
  finite(light.radiance, "inputs:intensity");
  finite(light.diffuse, "inputs:diffuse");
  finite(light.specular, "inputs:specular");
  finite(light.centre, "xformOp:transform");
  finite(light.shadow_color, "inputs:shadow:color");
  finite(light.shadow_distance, "inputs:shadow:distance");
  finite(light.shadow_falloff, "inputs:shadow:falloff");
  finite(light.shadow_falloff_gamma, "inputs:shadow:falloffGamma");
  checkIndex(light.texture, -1, scene.textures.size(), light.path + ".inputs:texture:file", "textures");
  checkShape(light, scene);
  checkShaping(light);
  for (const auto* groups : {&light.lit_groups, &light.shadow_groups}) {
    if (groups->empty()) continue;
    const auto known = [&](int64_t group) { checkIndex(group, -1, groups->size(), light.path, "link groups"); };
    for (const Mesh& mesh : scene.meshes) known(mesh.link_group);
    for (const Instance& instance : scene.instances) known(instance.link_group);
  }
}

}  // namespace encore::validation
