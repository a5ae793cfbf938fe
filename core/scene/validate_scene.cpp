// Scene::validate(): what ties the parts of a scene together. Meshes: validate_mesh.cpp.
#include <algorithm>
#include <cstdint>
#include <set>
#include <string>

#include "core/scene/error.h"
#include "core/scene/scene.h"
#include "core/scene/text.h"

namespace encore {
namespace {

// Texels are addressed with 32 bits, and a texture's levels lie in one allocation.
constexpr uint64_t kMaxTexels = uint64_t{1} << 30;

[[noreturn]] void raise(const std::string& where, const std::string& found, const std::string& remedy) {
  throw Error(ErrorKind::Scene, found, where, remedy);
}

void checkFinite(bool finite, const std::string& where, const std::string& value) {
  if (!finite) raise(where, "value " + value + " is not finite", "Remove infinite and NaN values");
}

// Invertible whatever the scale: compares the determinant with the volume of a box with edges of the same lengths.
void checkTransform(const Affine3d& m, const std::string& where) {
  checkFinite(allFinite(m), where, text(m.ex) + ", " + text(m.ey) + ", " + text(m.ez) + ", " + text(m.origin));
  const double volume = length(m.ex) * length(m.ey) * length(m.ez), determinant = m.determinant();
  if (!(std::abs(determinant) > 1e-12 * volume) || !std::isfinite(volume))
    raise(where, "the transform cannot be inverted: its determinant is " + text(determinant),
          "Remove scales of 0 and axes that coincide, or make the prim invisible");
}

void checkIndex(int64_t index, int64_t lowest, size_t count, const std::string& where, const std::string& things) {
  if (index < lowest || index >= int64_t(count))
    raise(where, "index " + text(index) + " is out of range: " + things + " number " + text(count),
          "Refer to one of the scene's " + things);
}

void checkTexture(const Texture& texture) {
  const uint64_t texels = uint64_t(texture.width) * texture.height;
  const std::string size = text(texture.width) + " × " + text(texture.height);
  if (texels == 0 || texels > kMaxTexels)
    raise(texture.path, "the texture has " + size + " pixels", "Use a texture of 1 to " + text(kMaxTexels) + " pixels");
  if (texture.rgba.size() != texels * 4)
    raise(texture.path, "a texture of " + size + " pixels came with " + text(texture.rgba.size()) + " numbers",
          "Pass four channels per pixel");
  const auto bad = std::find_if(texture.rgba.begin(), texture.rgba.end(), [](float v) { return !std::isfinite(v); });
  if (bad != texture.rgba.end()) {
    const uint64_t texel = uint64_t(bad - texture.rgba.begin()) / 4;
    raise(texture.path,
          "the pixel at column " + text(texel % texture.width) + ", row " + text(texel / texture.width) +
              " from the bottom is not finite",
          "Repair the texture");
  }
}

void checkNode(const PatternNode& node, size_t texture_count) {
  if (node.kind != PatternNode::Kind::Texture) return;
  checkIndex(node.texture, -1, texture_count, node.path + ".inputs:file", "textures");
  const auto check = [&](const auto& values, const char* attribute) {
    for (float v : values) checkFinite(std::isfinite(v), node.path + "." + attribute, text(v));
  };
  check(node.st_transform, "inputs:st");
  check(node.scale, "inputs:scale");
  check(node.bias, "inputs:bias");
  check(node.fallback, "inputs:fallback");
}

void checkMaterial(const Material& material, size_t texture_count) {
  for (const PatternNode& node : material.nodes) checkNode(node, texture_count);

  const PatternNode* coordinates = nullptr;  // of the first connected texture
  const auto check = [&](const auto& input, const char* name) {
    using T = std::decay_t<decltype(input.value)>;
    const std::string where = material.path + ".inputs:" + name;
    checkFinite(allFinite(input.value), where, text(input.value));
    checkIndex(input.node, -1, material.nodes.size(), where, "nodes of the material");
    if (input.constant()) return;
    const int channels = std::is_same_v<T, float> ? 1 : 3;
    if (input.channel < 0 || input.channel + channels > 4)
      raise(where, "channel " + text(input.channel) + " starts " + text(channels) + " channels of a node's four",
            "Connect an output that the node has");
    const PatternNode& node = material.nodes[size_t(input.node)];
    if (node.kind != PatternNode::Kind::Texture || node.texture < 0) return;
    if (coordinates && coordinates->texcoord != node.texcoord)
      raise(node.path + ".inputs:st",
            "reads primvar " + node.texcoord + ", but " + coordinates->path + " of the same material reads " +
                coordinates->texcoord,
            "Use one set of texture coordinates per material");
    coordinates = &node;
  };
  check(material.diffuse_color, "diffuseColor");
  check(material.emissive_color, "emissiveColor");
  check(material.specular_color, "specularColor");
  check(material.metallic, "metallic");
  check(material.roughness, "roughness");
  check(material.clearcoat, "clearcoat");
  check(material.clearcoat_roughness, "clearcoatRoughness");
  check(material.opacity, "opacity");
  check(material.ior, "ior");
  checkFinite(std::isfinite(material.opacity_threshold), material.path + ".inputs:opacityThreshold",
              text(material.opacity_threshold));
}

void checkLight(const Light& light) {
  checkFinite(allFinite(light.radiance), light.path + ".inputs:intensity", text(light.radiance));
  checkFinite(allFinite(light.diffuse), light.path + ".inputs:diffuse", text(light.diffuse));
  checkFinite(allFinite(light.specular), light.path + ".inputs:specular", text(light.specular));
  checkFinite(allFinite(light.centre), light.path + ".xformOp:transform", text(light.centre));
  switch (light.kind) {
    case Light::Kind::Distant:
      if (!(std::abs(length(light.direction) - 1) < 1e-3f))
        raise(light.path + ".xformOp:transform", "the light's direction is " + text(light.direction),
              "Give the light a transform that can be inverted");
      if (!(light.angle_radians >= 0 && light.angle_radians <= 2 * kPi * 1.0001f))
        raise(light.path + ".inputs:angle", "the light's angle is " + text(light.angle_radians) + " radians",
              "Choose an angle from 0 to 360 degrees");
      break;
    case Light::Kind::Rect: {
      const float area = length(cross(light.half_u, light.half_v));
      if (!(area > 0 && std::isfinite(area)))
        raise(light.path + ".inputs:width",
              "the light's half edges are " + text(light.half_u) + " and " + text(light.half_v),
              "Give the light a finite width and height above 0");
      break;
    }
    case Light::Kind::Sphere:
      if (!(light.radius > 0 && std::isfinite(light.radius)))
        raise(light.path + ".inputs:radius", "the light's radius is " + text(light.radius),
              "Give the light a finite radius above 0");
      break;
    case Light::Kind::Dome:
      break;
  }
}

void checkCamera(const Camera& camera) {
  checkTransform(camera.to_world, camera.path + ".xformOp:transform");
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
}

bool hasVisibleFace(const Mesh& mesh) {
  return std::set<int32_t>(mesh.hole_indices.begin(), mesh.hole_indices.end()).size() < mesh.face_vertex_counts.size();
}

// Instances and prototypes; returns whether any face is placed.
bool checkPlacement(const Scene& scene) {
  for (const Prototype& prototype : scene.prototypes)
    for (uint32_t mesh : prototype.meshes) checkIndex(mesh, 0, scene.meshes.size(), prototype.path, "meshes");
  std::vector<char> visible(scene.prototypes.size());
  for (size_t i = 0; i < visible.size(); ++i)
    for (uint32_t mesh : scene.prototypes[i].meshes) visible[i] |= hasVisibleFace(scene.meshes[mesh]);

  bool any = false;
  for (const Instance& instance : scene.instances) {
    checkIndex(instance.prototype, 0, scene.prototypes.size(), instance.path, "prototypes");
    checkIndex(instance.material, -1, scene.materials.size(), instance.path + ".material:binding", "materials");
    checkTransform(instance.to_world, instance.path + ".xformOp:transform");
    for (size_t layer = 0; layer < instance.shading_rate.size(); ++layer)
      if (!(instance.shading_rate[layer] >= 0 && instance.shading_rate[layer] <= kLargestShadingRate))
        raise(
            instance.path + "." + kLayerRateAttributes[layer],
            "value " + text(instance.shading_rate[layer]) + " is no shading rate",
            "Author a number from 0 (that of the mesh) to " + text(kLargestShadingRate) + " shading samples per pixel");
    any |= visible[instance.prototype] != 0;
  }
  return any;
}

}  // namespace

void Scene::validate() const {
  if (materials.empty()) raise("scene", "there is no material", "Add a default material as material 0");
  for (const Texture& texture : textures) checkTexture(texture);
  for (const Material& material : materials) checkMaterial(material, textures.size());
  for (const Mesh& mesh : meshes) validateMesh(mesh, materials.size());
  for (const Light& light : lights) checkLight(light);
  checkCamera(camera);
  if (!checkPlacement(*this))
    raise("stage", "no renderable prim",
          "Check visibility, purpose and population mask, and that the stage holds meshes or implicit shapes");
}

}  // namespace encore
