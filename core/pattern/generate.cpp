// generatePatterns(): the scene's networks as GLSL. What every generated shader has in common is in
// shaders/pattern/evaluate.glsl; here are only the scene's own functions.
//
// Materials say which textures they look up (textureOf), one piece of code looks them up, and materials then
// compose their inputs (evaluateMaterial). A lookup within every case would be inlined once per material: fifty
// textured materials took 18 s to compile and, mixed, six times as long to run.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "core/pattern/network.h"
#include "core/pattern/patterns.h"
#include "core/pattern/texture_pyramid.h"

namespace encore {
namespace {

// Cases that share an outer case, so that no material is more than two short chains of comparisons away.
constexpr uint32_t kCasesPerGroup = 16;

std::string number(uint32_t value) { return std::to_string(value) + "u"; }

// The shortest text that gives back the same float.
std::string literal(float value) {
  if (!std::isfinite(value)) return "uintBitsToFloat(0x7fc00000u)";
  std::array<char, 32> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  std::string text(buffer.data(), end);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

std::string vector(const float* values, int count) {
  std::string text = "vec" + std::to_string(count) + "(";
  for (int i = 0; i < count; ++i) text.append(i ? ", " : "").append(literal(values[i]));
  return text + ")";
}

// Prim paths may hold any letters; a comment must not.
std::string comment(const std::string& path) {
  std::string text = "  // ";
  for (char c : path) text += (c > ' ' && c < 127 && c != '\\') ? c : '?';
  return text;
}

struct Case {
  uint32_t material;
  std::string statement;
};

// switch (material), nested as soon as there are more than a few. cases: ascending.
std::string switchOver(const std::vector<Case>& cases) {
  const auto inner = [&](size_t begin, size_t end, const std::string& indent) {
    std::string text = indent + "switch (material) {\n";
    for (size_t i = begin; i < end; ++i)
      text += indent + "  case " + number(cases[i].material) + ": " + cases[i].statement + " break;\n";
    return text + indent + "}\n";
  };
  if (cases.size() <= kCasesPerGroup) return inner(0, cases.size(), "  ");
  std::string text = "  switch (material / " + number(kCasesPerGroup) + ") {\n";
  for (size_t begin = 0; begin < cases.size();) {
    const uint32_t group = cases[begin].material / kCasesPerGroup;
    size_t end = begin;
    while (end < cases.size() && cases[end].material / kCasesPerGroup == group) ++end;
    text += "    case " + number(group) + ":\n" + inner(begin, end, "      ") + "      break;\n";
    begin = end;
  }
  return text + "  }\n";
}

// Collects one part of all materials.
class PartWriter {
 public:
  PartWriter(const Scene& scene, const TextureLayout& layout, std::string outputs)
      : scene_(scene), layout_(layout), outputs_(std::move(outputs)) {}

  template <class Network>
  void add(uint32_t id, const Network& network) {
    const std::vector<int32_t> nodes = reachableNodes(network);
    if (nodes.empty()) return;
    const Material& material = scene_.materials[id];

    std::vector<int32_t> textures;  // the node of each slot
    std::string lookups;
    for (int32_t n : nodes) {
      if (material.nodes[size_t(n)].kind != PatternNode::Kind::Texture) continue;
      const std::string function = "texture_" + std::to_string(id) + "_" + std::to_string(n);
      functions_ += textureFunction(function, material.nodes[size_t(n)]);
      lookups.append(lookups.empty() ? "if (slot == " : " if (slot == ");
      lookups.append(number(uint32_t(textures.size()))).append(") node = ").append(function).append("();");
      textures.push_back(n);
    }
    if (!textures.empty()) lookups_.push_back({id, lookups});
    slots_ = std::max(slots_, uint32_t(textures.size()));

    std::string values;
    forEachInput(network, [&](const auto& input) {
      values.append(values.empty() ? "" : ", ").append(expression(material, textures, input));
    });
    compositions_.push_back({id, "value = " + outputs_ + "(" + values + ");" + comment(material.path) + "\n     "});
  }

  // Empty where nothing varies.
  std::string finish() const {
    if (compositions_.empty()) return {};
    return "#version 460\n"
           "#extension GL_EXT_buffer_reference : require\n"
           "#extension GL_EXT_scalar_block_layout : require\n"
           "#extension GL_GOOGLE_include_directive : require\n"
           "#define OUTPUTS " +
           outputs_ + "\n#define TEXTURE_SLOTS " + std::to_string(slots_) +
           "\n#include \"records.h\"\n"
           "#include \"pattern/texture.glsl\"\n\n" +
           functions_ + "\nTextureNode textureOf(uint material, uint slot) {\n  TextureNode node = noTexture();\n" +
           (lookups_.empty() ? "" : switchOver(lookups_)) + "  return node;\n}\n\n" + outputs_ +
           " evaluateMaterial(uint material, PatternPoint point, vec4 texel[max(TEXTURE_SLOTS, 1)]) {\n  " + outputs_ +
           " value;\n" + switchOver(compositions_) +
           "  return value;\n}\n\n"
           "#include \"pattern/evaluate.glsl\"\n";
  }

 private:
  std::string textureFunction(const std::string& name, const PatternNode& node) const {
    const Texture& texture = scene_.textures[size_t(node.texture)];
    const uint32_t levels = uint32_t(pyramidLevels(texture.width, texture.height).size());
    return "TextureNode " + name + "() {" + comment(node.path) + "\n  return TextureNode(" +
           number(layout_.first_level[size_t(node.texture)]) + ", " + number(levels) + ", " +
           number(uint32_t(node.wrap_s)) + ", " + number(uint32_t(node.wrap_t)) + ", " +
           vector(node.st_transform.data(), 3) + ", " + vector(node.st_transform.data() + 3, 3) + ", " +
           vector(node.scale.data(), 4) + ", " + vector(node.bias.data(), 4) + ", " + vector(node.fallback.data(), 4) +
           ");\n}\n";
  }

  template <class T>
  static std::string expression(const Material& material, const std::vector<int32_t>& textures, const Input<T>& input) {
    constexpr bool kScalar = std::is_same_v<T, float>;
    if (input.constant()) {
      if constexpr (kScalar)
        return literal(input.value);
      else
        return vector(&input.value.x, 3);
    }
    std::string source = "vec4(point.color, 1.0)";
    if (material.nodes[size_t(input.node)].kind == PatternNode::Kind::Texture) {
      const auto slot = std::find(textures.begin(), textures.end(), input.node) - textures.begin();
      source = "texel[" + std::to_string(slot) + "]";
    }
    return source + "." + std::string("rgba").substr(size_t(input.channel), kScalar ? 1 : 3);
  }

  const Scene& scene_;
  const TextureLayout& layout_;
  std::string outputs_;  // name of the struct that the part computes
  std::string functions_;
  std::vector<Case> lookups_, compositions_;
  uint32_t slots_ = 0;  // most textures that one material looks up
};

}  // namespace

PatternSource generatePatterns(const Scene& scene) {
  const TextureLayout layout = layoutTextures(scene);
  PartWriter shading(scene, layout, "ShadingInputs"), path(scene, layout, "PathInputs");
  for (uint32_t id = 0; id < scene.materials.size(); ++id) {
    shading.add(id, shadingNetwork(scene.materials[id]));
    path.add(id, pathNetwork(scene.materials[id]));
  }
  return {shading.finish(), path.finish()};
}

}  // namespace encore
