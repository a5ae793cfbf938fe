#include "core/pattern/network.h"

#include <algorithm>
#include <iterator>

#include "core/pattern/glsl_source.h"

namespace encore {
namespace {

using Kind = PointSlot::Kind;

// Members of Surface.
enum Member {
  kDiffuse,
  kEmissive,
  kSpecular,
  kMetallic,
  kRoughness,
  kClearcoat,
  kClearcoatRoughness,
  kOpacity,
  kIor,
  kNormal
};

bool readsNothing(const PatternNode& node) {
  return node.kind == PatternNode::Kind::Texture && node.texture < 0 &&
         std::all_of(node.udim.begin(), node.udim.end(), [](int32_t texture) { return texture < 0; });
}

NetworkInput fold(const Material& material, NetworkInput input) {
  if (input.constant()) return input;
  const PatternNode& node = material.nodes[size_t(input.node)];
  if (!readsNothing(node)) return input;
  for (uint32_t c = 0; c < input.channels; ++c) input.value[c] = node.fallback[size_t(input.channel) + c];
  input.node = -1;
  return input;
}

NetworkInput read(const Material& material, const Input<float>& input) {
  return fold(material, {{input.value}, 1, input.node, input.channel});
}
NetworkInput read(const Material& material, const Input<Vec3f>& input) {
  return fold(material, {{input.value.x, input.value.y, input.value.z}, 3, input.node, input.channel});
}

NetworkInput constantOf(NetworkInput input) {
  input.node = -1;
  return input;
}

uint32_t channelsOf(const std::string& type) {
  if (type == "vec2") return 2;
  if (type == "vec3") return 3;
  return type == "vec4" ? 4 : 1;
}

std::vector<NetworkInput> surfaceInputs(const Material& m) {
  std::vector<NetworkInput> inputs{
      read(m, m.diffuse_color), read(m, m.emissive_color), read(m, m.specular_color),      read(m, m.metallic),
      read(m, m.roughness),     read(m, m.clearcoat),      read(m, m.clearcoat_roughness), read(m, m.opacity),
      read(m, m.ior),           read(m, m.normal)};
  return inputs;
}

// Which members of Surface a part's record is made of, in its order.
std::vector<Member> membersOf(PatternPart part) {
  switch (part) {
    case PatternPart::Shading:
      return {kDiffuse, kEmissive};
    case PatternPart::Path:
      return {kDiffuse, kSpecular, kMetallic, kRoughness, kClearcoat, kClearcoatRoughness, kOpacity, kIor, kNormal};
    case PatternPart::Opacity:
      return {kOpacity};
    case PatternPart::Displacement:
      break;
  }
  return {};
}

// Without a shader.
std::vector<NetworkInput> plainInputs(PatternPart part, const Material& material) {
  if (part == PatternPart::Displacement) return {NetworkInput{{}, 3, -1, 0}, read(material, material.displacement)};
  std::vector<NetworkInput> all = surfaceInputs(material);
  if (part == PatternPart::Path) {
    // The two workflows of UsdPreviewSurface ignore each other's inputs, and only metals reflect the base colour.
    if (material.use_specular_workflow)
      all[kMetallic] = read(material, Input<float>{material.metallic.value});
    else
      all[kSpecular] = read(material, Input<Vec3f>{material.specular_color.value});
    const bool metal = !all[kMetallic].constant() || all[kMetallic].value[0] != 0;
    if (material.use_specular_workflow || !metal)
      all[kDiffuse] = read(material, Input<Vec3f>{material.diffuse_color.value});
  }
  std::vector<NetworkInput> inputs;
  for (Member member : membersOf(part)) inputs.push_back(all[member]);
  return inputs;
}

// The shader that gives the part a value it does not have without; null: there is none.
const GlslShader* shaderOf(PatternPart part, const Material& material) {
  if (part == PatternPart::Displacement) return material.displacement_shader ? &*material.displacement_shader : nullptr;
  if (!material.surface_shader) return nullptr;
  const GlslSource source(material.surface_shader->source);
  const auto sets = [&](Member member) { return source.mentions(kSurfaceMembers[member]); };
  bool any = false;
  for (Member member : membersOf(part))
    any = any || (sets(member) && !(part == PatternPart::Path && member == kDiffuse));
  // Paths only ask metals for the base colour.
  const bool metal = !material.metallic.constant() || material.metallic.value != 0;
  if (part == PatternPart::Path && metal && !material.use_specular_workflow) any = any || sets(kDiffuse);
  return any ? &*material.surface_shader : nullptr;
}

// All members of Surface: those that are neither part of the record nor read by the shader do not vary.
std::vector<NetworkInput> shaderInputs(PatternPart part, const Material& material, const GlslSource& source) {
  if (part == PatternPart::Displacement) return {read(material, material.displacement)};
  std::vector<NetworkInput> inputs = surfaceInputs(material);
  const std::vector<Member> members = membersOf(part);
  for (size_t i = 0; i < inputs.size(); ++i)
    if (!source.mentions(kSurfaceMembers[i]) && std::find(members.begin(), members.end(), Member(i)) == members.end())
      inputs[i] = constantOf(inputs[i]);
  return inputs;
}

void addSlot(PointLayout& layout, const PointSlot& slot) {
  if (hasSlot(layout, slot)) return;
  layout.slots.push_back(slot);
  layout.size += slot.size();
}

bool same(const PointSlot& a, const PointSlot& b) {
  return a.kind == b.kind && a.name == b.name && a.fallback == b.fallback;
}

}  // namespace

uint32_t PointSlot::size() const {
  switch (kind) {
    case Kind::Texcoord:
      return 6;
    case Kind::Primvar:
      return 4;
    case Kind::Parameter:
      return 2;
    case Kind::DisplayColor:
    case Kind::Position:
    case Kind::ObjectPosition:
    case Kind::Normal:
      break;
  }
  return 3;
}

void PatternPoints::append(const PatternPoints& more) {
  const uint32_t shift = uint32_t(data.size());
  point.reserve(point.size() + more.point.size());
  for (PatternPoint p : more.point) point.push_back({p.material, p.first + shift});
  data.insert(data.end(), more.data.begin(), more.data.end());
}

bool Network::varies() const { return shader || !reachableNodes(*this).empty(); }

Network makeNetwork(PatternPart part, const Material& material) {
  if (const GlslShader* shader = shaderOf(part, material)) return makeShaderNetwork(part, material, *shader);
  return {plainInputs(part, material), nullptr, {}};
}

Network makeShaderNetwork(PatternPart part, const Material& material, const GlslShader& shader) {
  const GlslSource source(shader.source);
  Network network{shaderInputs(part, material, source), &shader, {}};
  for (const GlslParameter& parameter : shader.parameters) {
    const Vec4f v = parameter.input.value;
    NetworkInput input{{v.x, v.y, v.z, v.w}, channelsOf(parameter.type), parameter.input.node, parameter.input.channel};
    input = fold(material, input);
    network.parameters.push_back(source.mentions(parameter.name) ? input : constantOf(input));
  }
  return network;
}

std::vector<float> constantValues(PatternPart part, const Material& material) {
  std::vector<float> values;
  for (const NetworkInput& input : plainInputs(part, material))
    values.insert(values.end(), input.value.begin(), input.value.begin() + input.channels);
  return values;
}

std::vector<int32_t> reachableNodes(const Network& network) {
  std::vector<int32_t> nodes;
  const auto add = [&](const NetworkInput& input) {
    if (!input.constant() && std::find(nodes.begin(), nodes.end(), input.node) == nodes.end())
      nodes.push_back(input.node);
  };
  std::for_each(network.inputs.begin(), network.inputs.end(), add);
  std::for_each(network.parameters.begin(), network.parameters.end(), add);
  return nodes;
}

std::vector<int32_t> textureNodes(const Material& material, const Network& network) {
  std::vector<int32_t> nodes = reachableNodes(network), textures;
  std::copy_if(nodes.begin(), nodes.end(), std::back_inserter(textures),
               [&](int32_t n) { return material.nodes[size_t(n)].kind == PatternNode::Kind::Texture; });
  return textures;
}

PointSlot texcoordSlot(const PatternNode& node) {
  return {Kind::Texcoord, node.texcoord, {node.texcoord_fallback[0], node.texcoord_fallback[1], 0, 0}};
}
PointSlot primvarSlot(const PatternNode& node) { return {Kind::Primvar, node.primvar, node.fallback}; }
PointSlot shaderSlot(PointSlot::Kind kind) { return {kind, kind == Kind::Texcoord ? "st" : "", {}}; }

bool hasSlot(const PointLayout& layout, const PointSlot& slot) {
  return std::any_of(layout.slots.begin(), layout.slots.end(), [&](const PointSlot& s) { return same(s, slot); });
}

uint32_t slotOffset(const PointLayout& layout, const PointSlot& slot) {
  uint32_t offset = 0;
  for (const PointSlot& s : layout.slots) {
    if (same(s, slot)) break;
    offset += s.size();
  }
  return offset;
}

PointLayout makeLayout(PatternPart part, const Material& material, const Network& network) {
  PointLayout layout;
  if (network.shader) {
    const GlslSource source(network.shader->source);
    const auto ask = [&](Kind kind, std::initializer_list<const char*> names) {
      if (std::any_of(names.begin(), names.end(), [&](const char* name) { return source.mentions(name); }))
        addSlot(layout, shaderSlot(kind));
    };
    if (part == PatternPart::Displacement) {
      ask(Kind::ObjectPosition, {"position"});
    } else {
      ask(Kind::Position, {"position"});
      ask(Kind::ObjectPosition, {"objectPosition"});
    }
    ask(Kind::Normal, {"normal"});
    ask(Kind::Parameter, {"uv"});
    ask(Kind::Texcoord, {"st", "dstdx", "dstdy"});
    ask(Kind::DisplayColor, {"displayColor"});
  }
  for (int32_t n : reachableNodes(network)) {
    const PatternNode& node = material.nodes[size_t(n)];
    if (node.kind == PatternNode::Kind::Texture) addSlot(layout, texcoordSlot(node));
    if (node.kind == PatternNode::Kind::DisplayColor) addSlot(layout, shaderSlot(Kind::DisplayColor));
    if (node.kind == PatternNode::Kind::Primvar) addSlot(layout, primvarSlot(node));
  }
  return layout;
}

std::string normalTexcoordOf(const Material& material) {
  if (material.surface_shader && GlslSource(material.surface_shader->source).mentions("normal")) return "st";
  const NetworkInput normal = read(material, material.normal);
  if (normal.constant()) return normal.value == std::array<float, 4>{0, 0, 1, 0} ? "" : "st";
  const PatternNode& node = material.nodes[size_t(normal.node)];
  return node.kind == PatternNode::Kind::Texture ? node.texcoord : "st";
}

}  // namespace encore
