// Materials: UsdPreviewSurface, or a GLSL surface of the user's own, with inputs that are constants or outputs of
// pattern nodes.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/scene/math.h"

namespace encore {

enum class WrapMode { Black, Clamp, Repeat, Mirror };

// Where a texture's pixels come from when they are wanted.
class TextureSource {
 public:
  virtual ~TextureSource() = default;
  // Fills rgba (width * height * 4 half floats as bits) with linear working-space pixels, bottom row first.
  // Called by one thread at a time, any number of times, always with the same result. Throws Error(Scene).
  virtual void read(std::span<uint16_t> rgba) const = 0;
  // Called where read() would have been, had a frame before not left what it gave.
  virtual void reused() const {}
};

// Linear working-space pixels, bottom row first (st = (0, 0) is the lower left corner of pixel 0).
struct Texture {
  std::string path;  // resolved asset path, for messages
  uint32_t width = 0, height = 0;
  std::vector<float> rgba;  // width * height * 4; empty: they come from source
  std::shared_ptr<const TextureSource> source;
};

// One node of a pattern network. Outputs have up to four channels.
struct PatternNode {
  enum class Kind {
    Texture,       // UsdUVTexture
    DisplayColor,  // primvar displayColor of the mesh, rgb
    Primvar,       // UsdPrimvarReader_*: one of Mesh::primvars
  };
  Kind kind = Kind::Texture;
  std::string path;      // prim path of the shader, for messages
  int32_t texture = -1;  // index into Scene::textures; -1: the fallback everywhere
  // UDIM: udim[i] is the texture of tile 1001 + i, -1: the fallback there. Empty: one texture.
  std::vector<int32_t> udim;
  std::string texcoord = "st";                   // name of the texture coordinate primvar
  std::array<float, 2> texcoord_fallback{0, 0};  // where the mesh has none
  // st' = rows * (s, t, 1): what UsdTransform2d and the texture's own conventions come to.
  std::array<float, 6> st_transform{1, 0, 0, 0, 1, 0};
  WrapMode wrap_s = WrapMode::Repeat, wrap_t = WrapMode::Repeat;
  std::array<float, 4> scale{1, 1, 1, 1}, bias{0, 0, 0, 0};
  std::array<float, 4> fallback{0, 0, 0, 1};  // of textures, and of primvars that the mesh does not have
  std::string primvar;                        // Primvar: its name
};

// A value, or the channels of a node's output starting at channel.
template <class T>
struct Input {
  T value{};
  int32_t node = -1;  // index into Material::nodes; -1: constant
  int32_t channel = 0;

  bool constant() const { return node < 0; }
};

// A shader of the user's own (docs/glsl.md). Its parameters are declared before its source.
struct GlslParameter {
  std::string name;  // a GLSL identifier
  std::string type;  // float, vec2, vec3, vec4 or int
  Input<Vec4f> input;
};
struct GlslShader {
  std::string path;  // prim path, for messages
  std::string file;  // what its lines are counted in: an asset path, or the attribute
  std::string source;
  std::vector<GlslParameter> parameters;
};

// Names are UsdPreviewSurface's.
enum class OpacityMode { Transparent, Presence };

// UsdPreviewSurface 2.6. Defaults are the specification's.
struct Material {
  std::string path;
  std::vector<PatternNode> nodes;

  // Shading inputs: run only where something is shaded.
  Input<Vec3f> diffuse_color{{0.18f, 0.18f, 0.18f}};
  Input<Vec3f> emissive_color{{0, 0, 0}};
  // Path inputs: needed wherever a path arrives.
  bool use_specular_workflow = false;
  Input<Vec3f> specular_color{{0, 0, 0}};
  Input<float> metallic{0.0f};
  Input<float> roughness{0.5f};
  Input<float> clearcoat{0.0f};
  Input<float> clearcoat_roughness{0.01f};
  // With a threshold above 0: a cut-out. Else by mode: presence, or a transparent body.
  Input<float> opacity{1.0f};
  float opacity_threshold = 0.0f;
  OpacityMode opacity_mode = OpacityMode::Transparent;
  Input<float> ior{1.5f};
  Input<Vec3f> normal{{0, 0, 1}};   // in the tangent frame of the texture coordinates that its node reads
  int32_t dielectric_priority = 0;  // where solids overlap the higher one is there; of equals, the one entered last
  // Displacement inputs: along the normal, in the mesh's own units.
  Input<float> displacement{0.0f};

  // Gives the inputs above, where there is one; those that it does not set keep their values.
  std::optional<GlslShader> surface_shader, displacement_shader;

  bool displaces() const { return displacement_shader || !displacement.constant() || displacement.value != 0; }
  // Some of the light, or of the paths, that meet the surface go straight on as if it were not there.
  bool hasPresence() const {
    const bool varies = !opacity.constant() || surface_shader;
    return (opacity_threshold > 0 || opacity_mode == OpacityMode::Presence) && (varies || opacity.value < 1);
  }
};

}  // namespace encore
