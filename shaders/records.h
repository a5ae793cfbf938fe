// Records that travel between stages, declared once for C++ and GLSL (scalar layout).
// tests/core/records_test.cpp checks that sizes and offsets agree on both sides.
#ifndef ENCORE_RECORDS_H
#define ENCORE_RECORDS_H

#ifdef __cplusplus
#include <cstdint>

#include "core/scene/math.h"
namespace encore {
using uint = uint32_t;
using vec2 = Vec2f;
using vec3 = Vec3f;
#define ENCORE_CONST inline constexpr uint32_t
#else
#define ENCORE_CONST const uint
#endif

// Pixels of a block's side. The block is the unit of packets, batches and film partials.
ENCORE_CONST kBlockPixels = 16u;
ENCORE_CONST kBlockArea = 256u;

// Instance of a key that is never reused: a miss, a light, the background, an unused slot.
ENCORE_CONST kNoInstance = 0xffffffffu;

// Values of AaSample's shade index that are not indices.
ENCORE_CONST kShadeNotFound = 0xffffffffu;  // no shading sample on this primitive: a failure
ENCORE_CONST kShadeNone = 0xfffffffeu;      // radiance is carried in throughput

// What shading may be reused within: one side of one primitive of one instance (§2.2).
// Writer: core/path. Readers: core/reuse.
struct SurfaceKey {
  uint instance;
  uint primitive_side;  // primitive << 1 | side (1: back)
};

// A shading sample (§2.2) is, as a structure of arrays: SurfaceKey, vec2 uv, vec3 radiance.
// An antialiasing sample: SurfaceKey, vec2 uv, vec3 throughput, uint shade, uint film position.
//   uv          parametric coordinates within the primitive, in [0, 1]²
//   throughput  attenuation along the path; the radiance itself where the key has kNoInstance
//   shade       index of the radiance it is given, or one of kShade*
//   film position  offset within the pixel in units of 2^-16: x in the low, y (down) in the high half

// A point at which pattern networks are evaluated. Writer: core/trace/pattern_points. Reader: shaders/pattern.
// What the material's network reads there is a run of floats (core/pattern/patterns.h, PointLayout).
struct PatternPoint {
  uint material;
  uint first;  // of its floats
};

// Outputs of the parts of a material's network (design §2, "Where things run").
struct ShadingInputs {
  vec3 diffuse_color;
  vec3 emissive_color;
};
struct PathInputs {
  vec3 base_color;  // diffuseColor, which metals reflect with; only valid where metallic is not 0
  vec3 specular_color;
  float metallic;
  float roughness;
  float clearcoat;
  float clearcoat_roughness;
  float opacity;
  float ior;
  vec3 normal;  // in the tangent frame; (0, 0, 1): the surface's own
};
struct OpacityInputs {
  float opacity;
};
struct DisplacementInputs {
  vec3 offset;         // in the mesh's space
  float along_normal;  // and along its normal, in its units
};

#ifdef __cplusplus
static_assert(sizeof(SurfaceKey) == 8 && sizeof(PatternPoint) == 8);
static_assert(sizeof(ShadingInputs) == 24 && sizeof(PathInputs) == 60 && sizeof(DisplacementInputs) == 16);
}  // namespace encore
#endif
#endif
