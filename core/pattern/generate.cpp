// generatePatterns(): the scene's networks as GLSL. What every generated shader has in common is in
// shaders/pattern/evaluate.glsl; here are only the scene's own functions.
//
// Textures are looked up by one piece of code that reads what to do from tables, and materials then compose their
// inputs (evaluateMaterial). A lookup within every material's case would be inlined once per material: fifty textured
// materials took 18 s to compile and, mixed, six times as long to run. Shaders of the user's own are programs of
// their own, one for each source, so that nothing they declare can meet another's.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "core/pattern/glsl_source.h"
#include "core/pattern/network.h"
#include "core/pattern/patterns.h"
#include "core/scene/error.h"
#include "core/scene/text.h"

namespace encore {
namespace {

using Kind = PointSlot::Kind;

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

std::string constantText(const NetworkInput& input) {
  if (input.channels == 1) return literal(input.value[0]);
  std::string text = "vec" + std::to_string(input.channels) + "(";
  for (uint32_t i = 0; i < input.channels; ++i) text.append(i ? ", " : "").append(literal(input.value[i]));
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

// switch (material), nested as soon as there are more than a few. cases: ascending, at least one.
std::string switchOver(const std::vector<Case>& cases) {
  if (cases.size() == 1) return "  " + cases[0].statement + "\n";
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

const char* outputsOf(PatternPart part) {
  constexpr std::array<const char*, kPatternParts> kOutputs{"ShadingInputs", "PathInputs", "OpacityInputs",
                                                            "DisplacementInputs"};
  return kOutputs[size_t(part)];
}

// A material's place in a program.
struct Member {
  uint32_t id;
  const Material* material;
  Network network;
  PointLayout layout;
  std::vector<int32_t> textures;  // the node of each slot of texel[]
};

std::string expression(const Member& member, const NetworkInput& input) {
  if (input.constant()) return constantText(input);
  const PatternNode& node = member.material->nodes[size_t(input.node)];
  const auto at = [&](const PointSlot& slot) { return "first + " + number(slotOffset(member.layout, slot)); };
  std::string source;
  switch (node.kind) {
    case PatternNode::Kind::Texture: {
      const auto slot = std::find(member.textures.begin(), member.textures.end(), input.node) - member.textures.begin();
      source = "texel[" + std::to_string(slot) + "]";
      break;
    }
    case PatternNode::Kind::DisplayColor:
      source = "vec4(read3(data, " + at(shaderSlot(Kind::DisplayColor)) + "), 1.0)";
      break;
    case PatternNode::Kind::Primvar:
      source = "read4(data, " + at(primvarSlot(node)) + ")";
      break;
  }
  return source + "." + std::string("rgba").substr(size_t(input.channel), input.channels);
}

std::string list(const Member& member, const std::vector<NetworkInput>& inputs) {
  std::string text;
  for (const NetworkInput& input : inputs) text.append(text.empty() ? "" : ", ").append(expression(member, input));
  return text;
}

// Materials that one program evaluates: all without a shader of their own, or all with the same source.
class ProgramWriter {
 public:
  ProgramWriter(PatternPart part, std::string key) : part_(part), key_(std::move(key)) {}

  const std::string& key() const { return key_; }
  void add(Member member) { members_.push_back(std::move(member)); }

  PatternProgram write() const {
    const GlslShader* shader = members_[0].network.shader;
    size_t slots = 0;
    PatternProgram program{{}, {}, shader, displacement()};
    for (const Member& member : members_) {
      program.materials.push_back(member.id);
      slots = std::max(slots, member.textures.size());
    }
    program.source =
        "#version 460\n"
        "#extension GL_EXT_buffer_reference : require\n"
        "#extension GL_EXT_scalar_block_layout : require\n"
        "#extension GL_GOOGLE_include_directive : require\n"
        "#extension GL_GOOGLE_cpp_style_line_directive : require\n" +
        (shader ? shaderText(*shader) : "") + "#define OUTPUTS " + outputsOf(part_) + "\n#define TEXTURE_SLOTS " +
        std::to_string(slots) + "\n" + filterText() +
        "#include \"records.h\"\n#include \"pattern/finite.glsl\"\n#include \"pattern/points.glsl\"\n"
        "#include \"pattern/texture.glsl\"\n\n" +
        outputsOf(part_) +
        " evaluateMaterial(uint material, Floats data, uint first, vec4 texel[max(TEXTURE_SLOTS, 1)]) {\n" +
        (shader ? callText(*shader) : compositionText()) + "}\n\n#include \"pattern/evaluate.glsl\"\n";
    return program;
  }

 private:
  bool displacement() const { return part_ == PatternPart::Displacement; }

  // Shading samples are few, and what one of them sees is shown by many antialiasing samples: the best filter. What is
  // evaluated at antialiasing rate is averaged anyway.
  const char* filterText() const {
    return part_ == PatternPart::Path || part_ == PatternPart::Opacity
               ? "#define TEXELS_PER_FOOTPRINT 1.75\n#define TAPS_ACROSS 1.0\n"
               : "#define TEXELS_PER_FOOTPRINT 2.0\n#define TAPS_ACROSS 2.0\n";
  }

  std::string compositionText() const {
    std::vector<Case> cases;
    for (const Member& member : members_)
      cases.push_back({member.id, std::string("value = ") + outputsOf(part_) + "(" +
                                      list(member, member.network.inputs) + ");" + comment(member.material->path) +
                                      "\n     "});
    return std::string("  ") + outputsOf(part_) + " value;\n" + switchOver(cases) + "  return value;\n";
  }

  // A parameter with one constant value for all members can be folded by the compiler.
  bool isConstant(size_t parameter) const {
    const NetworkInput& first = members_[0].network.parameters[parameter];
    return std::all_of(members_.begin(), members_.end(), [&](const Member& member) {
      const NetworkInput& input = member.network.parameters[parameter];
      return input.constant() && input.value == first.value;
    });
  }

  static std::string converted(const GlslParameter& parameter, const std::string& value) {
    return parameter.type == "int" ? "int(round(" + value + "))" : value;
  }

  static std::string setter(size_t parameter) { return "encore_set_" + std::to_string(parameter); }

  // The user's source between what it may use and what keeps its names and macros from ours.
  std::string shaderText(const GlslShader& shader) const {
    std::string text = std::string("#include \"pattern/") + (displacement() ? "displacement" : "surface") + ".glsl\"\n";
    for (size_t i = 0; i < shader.parameters.size(); ++i) {
      const GlslParameter& parameter = shader.parameters[i];
      const std::string value = expression(members_[0], members_[0].network.parameters[i]);
      text += std::string("#line 1 \"") + kParameterFile + parameter.name + "\"\n" + (isConstant(i) ? "const " : "") +
              parameter.type + " " + parameter.name + (isConstant(i) ? " = " + converted(parameter, value) : "") +
              ";\n";
    }
    text += std::string("#line 1 \"") + kUserFile + "\"\n" + shader.source + "\n";
    text += std::string("#line 1 \"") + kGeneratedFile + "\"\n";
    const GlslSource source(shader.source);
    for (const std::string& macro : source.macros()) text += "#undef " + macro + "\n";
    for (size_t i = 0; i < shader.parameters.size(); ++i)
      if (!isConstant(i))
        text += "void " + setter(i) + "(" + shader.parameters[i].type + " encore_value) { " +
                shader.parameters[i].name + " = encore_value; }\n";
    text += displacement() ? "void encore_call(DisplacementPoint encore_point, inout vec3 encore_offset, inout float "
                             "encore_along) { displacement(encore_point, encore_offset, encore_along); }\n"
                           : "void encore_call(SurfacePoint encore_point, inout Surface encore_surface) { "
                             "surface(encore_point, encore_surface); }\n";
    return text + "#include \"pattern/private_names.glsl\"\n";
  }

  // What a slot of the layout gives, or zeros where the source does not ask for it.
  std::string pointMember(Kind kind, uint32_t offset, uint32_t channels) const {
    const PointSlot slot = shaderSlot(kind);
    const PointLayout& layout = members_[0].layout;
    if (!hasSlot(layout, slot)) return "vec" + std::to_string(channels) + "(0.0)";
    return "read" + std::to_string(channels) + "(data, first + " + number(slotOffset(layout, slot) + offset) + ")";
  }

  std::string pointText() const {
    const std::string common = pointMember(Kind::Normal, 0, 3) + ", " + pointMember(Kind::Parameter, 0, 2) + ", " +
                               pointMember(Kind::Texcoord, 0, 2) + ", " + pointMember(Kind::Texcoord, 2, 2) + ", " +
                               pointMember(Kind::Texcoord, 4, 2) + ", " + pointMember(Kind::DisplayColor, 0, 3) +
                               ");\n";
    if (displacement())
      return "  DisplacementPoint point = DisplacementPoint(" + pointMember(Kind::ObjectPosition, 0, 3) + ", " + common;
    return "  SurfacePoint point = SurfacePoint(" + pointMember(Kind::Position, 0, 3) + ", " +
           pointMember(Kind::ObjectPosition, 0, 3) + ", " + common;
  }

  // Parameters and inputs of the material, the call, and what it set; what is not finite keeps its value.
  std::string callText(const GlslShader& shader) const {
    std::vector<Case> cases;
    for (const Member& member : members_) {
      std::string statement;
      for (size_t i = 0; i < shader.parameters.size(); ++i)
        if (!isConstant(i))
          statement += setter(i) + "(" +
                       converted(shader.parameters[i], expression(member, member.network.parameters[i])) + "); ";
      statement += displacement() ? "before = " + list(member, member.network.inputs) + ";"
                                  : "before = Surface(" + list(member, member.network.inputs) + ");";
      cases.push_back({member.id, statement + comment(member.material->path) + "\n     "});
    }
    if (displacement())
      return "  float before;\n" + switchOver(cases) + pointText() +
             "  vec3 offset = vec3(0.0);\n  float along = before;\n"
             "  encore_call(point, offset, along);\n"
             "  return DisplacementInputs(finiteOr(offset, vec3(0.0)), finiteOr(along, before));\n";
    std::string values;
    for (const char* name : outputMembers())
      values.append(values.empty() ? "" : ", ")
          .append("finiteOr(after." + std::string(name) + ", before." + std::string(name) + ")");
    return "  Surface before;\n" + switchOver(cases) + pointText() + "  Surface after = before;\n" +
           "  encore_call(point, after);\n  return " + outputsOf(part_) + "(" + values + ");\n";
  }

  std::vector<const char*> outputMembers() const {
    const auto& names = kSurfaceMembers;
    if (part_ == PatternPart::Shading) return {names[0], names[1]};
    if (part_ == PatternPart::Opacity) return {names[7]};
    std::vector<const char*> all(names.begin(), names.end());
    all.erase(all.begin() + 1);  // PathInputs has no emission
    return all;
  }

  PatternPart part_;
  std::string key_;
  std::vector<Member> members_;
};

void checkParameters(const GlslShader& shader) {
  const auto raise = [&](const std::string& name, const std::string& found, const std::string& remedy) {
    throw Error(ErrorKind::Scene, found, shader.path + ".inputs:" + name, remedy);
  };
  std::set<std::string> names;
  for (const GlslParameter& parameter : shader.parameters) {
    constexpr std::array<const char*, 5> kTypes{"float", "vec2", "vec3", "vec4", "int"};
    if (!isGlslIdentifier(parameter.name))
      raise(parameter.name, "the name is no GLSL identifier",
            "Use letters, digits and single underscores, and no name that begins with gl_");
    if (!names.insert(parameter.name).second)
      raise(parameter.name, "there are two parameters of this name", "Drop one");
    if (std::find(kTypes.begin(), kTypes.end(), parameter.type) == kTypes.end())
      raise(parameter.name, "a parameter cannot be of type " + parameter.type, "Use float, vec2, vec3, vec4 or int");
    const Vec4f v = parameter.input.value;
    for (float value : {v.x, v.y, v.z, v.w})
      if (!std::isfinite(value))
        raise(parameter.name, "value " + text(value) + " is not finite", "Author finite numbers");
  }
}

// Materials whose programs can be one: the same text after the same declarations.
std::string programKey(const GlslShader* shader) {
  if (!shader) return {};
  std::string key = shader->file + '\0' + shader->source;
  for (const GlslParameter& parameter : shader->parameters) key += '\0' + parameter.type + ' ' + parameter.name;
  return key;
}

}  // namespace

PatternSource generatePatterns(const Scene& scene) {
  for (const Material& material : scene.materials)
    for (const auto* shader : {&material.surface_shader, &material.displacement_shader})
      if (*shader) checkParameters(**shader);

  PatternSource source;
  const auto member = [&](PatternPart part, uint32_t id, Network network) {
    const Material& material = scene.materials[id];
    PointLayout layout = makeLayout(part, material, network);
    std::vector<int32_t> textures = textureNodes(material, network);
    return Member{id, &material, std::move(network), std::move(layout), std::move(textures)};
  };
  std::set<std::string> used;  // keys of shaders
  for (uint32_t p = 0; p < kPatternParts; ++p) {
    const PatternPart part = PatternPart(p);
    std::vector<ProgramWriter> programs;
    for (uint32_t id = 0; id < scene.materials.size(); ++id) {
      Network network = makeNetwork(part, scene.materials[id]);
      if (!network.varies()) continue;
      const std::string key = programKey(network.shader);
      used.insert(key);
      auto program =
          std::find_if(programs.begin(), programs.end(), [&](const ProgramWriter& w) { return w.key() == key; });
      if (program == programs.end()) program = programs.emplace(programs.end(), part, key);
      program->add(member(part, id, std::move(network)));
    }
    for (const ProgramWriter& program : programs) source.parts[p].push_back(program.write());
  }
  for (uint32_t id = 0; id < scene.materials.size(); ++id) {
    const std::optional<GlslShader>& shader = scene.materials[id].surface_shader;
    if (!shader || !used.insert(programKey(&*shader)).second) continue;
    ProgramWriter program(PatternPart::Shading, {});
    program.add(
        member(PatternPart::Shading, id, makeShaderNetwork(PatternPart::Shading, scene.materials[id], *shader)));
    source.idle.push_back(program.write());
  }
  return source;
}

}  // namespace encore
