// Scene::validate(): textures and materials.
#include <algorithm>
#include <cctype>
#include <set>

#include "core/scene/validate_parts.h"

namespace encore::validation {
namespace {

// Texels are addressed with 32 bits, and a texture's levels lie in one allocation.
constexpr uint64_t kMaxTexels = uint64_t{1} << 30;
// UDIM tiles 1001 to 1100 and on: ten columns, a hundred rows.
constexpr size_t kMostTiles = 1000;

void checkNode(const PatternNode& node, size_t texture_count) {
  const auto check = [&](const auto& values, const char* attribute) {
    for (float v : values) checkFinite(std::isfinite(v), node.path + "." + attribute, text(v));
  };
  if (node.kind == PatternNode::Kind::Primvar) {
    if (node.primvar.empty()) raise(node.path + ".inputs:varname", "names no primvar", "Name the primvar to read");
    check(node.fallback, "inputs:fallback");
  }
  if (node.kind != PatternNode::Kind::Texture) return;
  const std::string file = node.path + ".inputs:file";
  checkIndex(node.texture, -1, texture_count, file, "textures");
  if (node.udim.size() > kMostTiles)
    raise(file, text(node.udim.size()) + " UDIM tiles", "Use tiles 1001 to " + text(1000 + kMostTiles));
  for (const int32_t tile : node.udim) checkIndex(tile, -1, texture_count, file, "textures");
  check(node.st_transform, "inputs:st");
  check(node.texcoord_fallback, "inputs:st");
  check(node.scale, "inputs:scale");
  check(node.bias, "inputs:bias");
  check(node.fallback, "inputs:fallback");
}

// A name that no keyword or code of ours can clash with is the compiler's to judge; here only its letters.
bool isIdentifier(const std::string& name) {
  const auto letter = [](char c) { return c == '_' || std::isalnum(static_cast<unsigned char>(c)); };
  return !name.empty() && !std::isdigit(static_cast<unsigned char>(name[0])) &&
         std::all_of(name.begin(), name.end(), letter);
}

template <class T>
void checkInput(const Input<T>& input, const std::string& where, size_t node_count) {
  checkFinite(allFinite(input.value), where, text(input.value));
  checkIndex(input.node, -1, node_count, where, "nodes of the material");
  if (input.constant()) return;
  const int channels = std::is_same_v<T, float> ? 1 : std::is_same_v<T, Vec3f> ? 3 : 1;
  if (input.channel < 0 || input.channel + channels > 4)
    raise(where, "channel " + text(input.channel) + " starts " + text(channels) + " channels of a node's four",
          "Connect an output that the node has");
}

void checkShader(const GlslShader& shader, size_t node_count) {
  if (shader.source.empty())
    raise(shader.path + ".info:glsl:sourceCode", "there is no source", "Author the shader's source");
  std::set<std::string> names;
  for (const GlslParameter& parameter : shader.parameters) {
    const std::string where = shader.path + ".inputs:" + parameter.name;
    if (!isIdentifier(parameter.name) || !names.insert(parameter.name).second)
      raise(where, "'" + parameter.name + "' is not a name of its own in GLSL",
            "Use letters, digits and underscores, and each name once");
    static const std::set<std::string> kTypes{"float", "vec2", "vec3", "vec4", "int"};
    if (!kTypes.contains(parameter.type))
      raise(where, "type " + parameter.type + " has no counterpart", "Use float, float2, float3, float4 or int");
    checkInput(parameter.input, where, node_count);
  }
}

}  // namespace

void checkTexture(const Texture& texture) {
  const uint64_t texels = uint64_t(texture.width) * texture.height;
  const std::string size = text(texture.width) + " × " + text(texture.height);
  if (texels == 0 || texels > kMaxTexels)
    raise(texture.path, "the texture has " + size + " pixels", "Use a texture of 1 to " + text(kMaxTexels) + " pixels");
  if (texture.rgba.empty() && texture.source) return;
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

void checkMaterial(const Material& material, size_t texture_count) {
  const size_t nodes = material.nodes.size();
  for (const PatternNode& node : material.nodes) checkNode(node, texture_count);
  const auto check = [&](const auto& input, const char* name) {
    checkInput(input, material.path + ".inputs:" + name, nodes);
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
  check(material.normal, "normal");
  check(material.displacement, "displacement");
  checkFinite(std::isfinite(material.opacity_threshold), material.path + ".inputs:opacityThreshold",
              text(material.opacity_threshold));
  if (material.surface_shader) checkShader(*material.surface_shader, nodes);
  if (material.displacement_shader) checkShader(*material.displacement_shader, nodes);
}

}  // namespace encore::validation
