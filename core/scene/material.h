// Materials: UsdPreviewSurface with inputs that are constants or outputs of pattern nodes.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/math.h"

namespace encore {

enum class WrapMode { Black, Clamp, Repeat, Mirror };

// Linear working-space pixels, bottom row first (st = (0, 0) is the lower left corner of pixel 0).
struct Texture {
  std::string path;  // resolved asset path, for messages
  uint32_t width = 0, height = 0;
  std::vector<float> rgba;  // width * height * 4
};

// One node of a pattern network. Outputs have up to four channels.
struct PatternNode {
  enum class Kind {
    Texture,       // UsdUVTexture
    DisplayColor,  // primvar displayColor of the mesh, rgb
  };
  Kind kind = Kind::Texture;
  std::string path;             // prim path of the shader, for messages
  int32_t texture = -1;         // index into Scene::textures; -1: the fallback everywhere
  std::string texcoord = "st";  // name of the texture coordinate primvar
  // st' = rows * (s, t, 1): what UsdTransform2d and the texture's own conventions come to.
  std::array<float, 6> st_transform{1, 0, 0, 0, 1, 0};
  WrapMode wrap_s = WrapMode::Repeat, wrap_t = WrapMode::Repeat;
  std::array<float, 4> scale{1, 1, 1, 1}, bias{0, 0, 0, 0}, fallback{0, 0, 0, 1};
};

// A value, or the channels of a node's output starting at channel.
template <class T>
struct Input {
  T value{};
  int32_t node = -1;  // index into Material::nodes; -1: constant
  int32_t channel = 0;

  bool constant() const { return node < 0; }
};

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
  Input<float> opacity{1.0f};
  float opacity_threshold = 0.0f;
  Input<float> ior{1.5f};
};

}  // namespace encore
