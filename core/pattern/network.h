// What a part of a material's network really depends on, after everything that cannot vary became a constant.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/pattern/patterns.h"
#include "core/scene/scene.h"

namespace encore {

// A value of up to four channels, or those channels of a node's output that start at `channel`.
struct NetworkInput {
  std::array<float, 4> value{};
  uint32_t channels = 1;
  int32_t node = -1;  // index into Material::nodes; -1: constant
  int32_t channel = 0;

  bool constant() const { return node < 0; }
};

// One part of one material. Nodes that have nothing to read are replaced by their fallback, and inputs that the part
// has no use for by their value.
struct Network {
  // The members of the part's record in their order; with a shader, what the shader finds in its `inout` arguments:
  // the members of Surface (shaders/pattern/surface.glsl), or the displacement along the normal.
  std::vector<NetworkInput> inputs;
  const GlslShader* shader = nullptr;    // of the material, where this part depends on it
  std::vector<NetworkInput> parameters;  // of the shader, in its order

  bool varies() const;
};
// Precondition: the material is valid. The network refers to it.
Network makeNetwork(PatternPart part, const Material& material);
// The same as if the part depended on the shader: to check one that nothing depends on.
Network makeShaderNetwork(PatternPart part, const Material& material, const GlslShader& shader);

// The part's values where the material does not vary in it: floats in the order of the part's record. What they are
// where an input varies has no meaning.
std::vector<float> constantValues(PatternPart part, const Material& material);

// The nodes that the network reads, each once, in the order in which they are met.
std::vector<int32_t> reachableNodes(const Network& network);
// Those of them that look up textures: what texel[] of generated code is indexed by.
std::vector<int32_t> textureNodes(const Material& material, const Network& network);

// What the shader's source can ask of a point (SurfacePoint, DisplacementPoint) comes first, so that it lies in the
// same place for all materials that share the source.
PointLayout makeLayout(PatternPart part, const Material& material, const Network& network);
// Where a slot starts among a point's floats. Precondition: the layout has it.
uint32_t slotOffset(const PointLayout& layout, const PointSlot& slot);
PointSlot texcoordSlot(const PatternNode& node);  // what a texture reads
PointSlot primvarSlot(const PatternNode& node);
// The member of SurfacePoint or DisplacementPoint that a slot feeds, and whether the layout has it.
PointSlot shaderSlot(PointSlot::Kind kind);
bool hasSlot(const PointLayout& layout, const PointSlot& slot);

// The members of Surface, in their order, as USD names them.
inline constexpr std::array<const char*, 10> kSurfaceMembers{
    "diffuseColor", "emissiveColor",      "specularColor", "metallic", "roughness",
    "clearcoat",    "clearcoatRoughness", "opacity",       "ior",      "normal"};

// What #line calls the user's source, what follows it, and the declarations of its parameters: for compile errors.
inline constexpr const char* kUserFile = "encore_user_source";
inline constexpr const char* kGeneratedFile = "encore_generated";
inline constexpr const char* kParameterFile = "encore_parameter:";

// Name of the texture coordinates whose tangents PathInputs::normal is given in; empty: it is the surface's own.
std::string normalTexcoordOf(const Material& material);

}  // namespace encore
