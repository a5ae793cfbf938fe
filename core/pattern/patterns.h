// Material networks → generated GLSL → values for batches of points.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "core/scene/settings.h"
#include "core/vulkan/device.h"
#include "shaders/records.h"

namespace encore {

class PatternCache;

// GLSL (a compute shader, #version 460, target Vulkan 1.3) → SPIR-V. name: for messages. Thread-safe.
// It may include "records.h" and "pattern/*.glsl" (names below shaders/), which the library holds as text.
// Throws Error(Internal) with glslang's log.
std::vector<uint32_t> compileGlsl(const std::string& source, const std::string& name);

// The parts of a material's network, each with outputs of its own in records.h: ShadingInputs, PathInputs,
// OpacityInputs (what shadow rays and pass-through ask), DisplacementInputs.
enum class PatternPart : uint32_t { Shading, Path, Opacity, Displacement };
inline constexpr uint32_t kPatternParts = 4;

// One shader of the scene's networks: that of all UsdPreviewSurface materials, or of those that share a shader of the
// user's own.
struct PatternProgram {
  std::string source;
  std::vector<uint32_t> materials;     // that it evaluates, ascending
  const GlslShader* shader = nullptr;  // the user's own, of the first of them
  bool displacement = false;           // it is one of displacement
};
// The generated programs of each part; none where everything is constant. Exposed for tests and for --dump options.
struct PatternSource {
  std::array<std::vector<PatternProgram>, kPatternParts> parts;
  std::vector<PatternProgram> idle;  // shaders of the user's own that set nothing; they must compile all the same
};
// Throws Error(Scene) where a shader's parameters are no GLSL variables.
PatternSource generatePatterns(const Scene& scene);

// What one part of a material reads at a point, in the order in which its floats stand in PatternPoints::data.
struct PointSlot {
  enum class Kind {
    Texcoord,        // 6: st, dst/dx, dst/dy of the named texture coordinates, or of `fallback` without change
    DisplayColor,    // 3
    Primvar,         // 4: the named one of Mesh::primvars, or `fallback`
    Position,        // 3: world space
    ObjectPosition,  // 3: the mesh's space
    Normal,     // 3: unit shading normal, world space, on the side of the arriving ray; of displacement: of the mesh
    Parameter,  // 2: (u, v) within the primitive
  };
  Kind kind;
  std::string name;
  std::array<float, 4> fallback{0, 0, 0, 0};
  uint32_t size() const;
};
struct PointLayout {
  std::vector<PointSlot> slots;
  uint32_t size = 0;  // floats of a point
};

// A batch of points. point[i].first counts in data.
struct PatternPoints {
  std::vector<PatternPoint> point;
  std::vector<float> data;

  size_t size() const { return point.size(); }
  bool empty() const { return point.empty(); }
  void append(const PatternPoints& more);  // keeps their order
};

// All that the values of one part of a material depend on besides the points: equal text, equal values, in whatever
// scene. Empty: a texture without a source cannot be told from others. The text names textures by the addresses of
// their sources, and so is good for as long as these are held.
struct PatternFingerprint {
  std::string text;
  std::vector<std::shared_ptr<const TextureSource>> textures;
};

// Evaluates the scene's materials. Constant parts cost nothing: they are tables. A part varies if one of the
// inputs that it needs has a node with something to read: a missing texture is its fallback, a constant; the base
// colour is needed by metals only; the metallic and the specular workflow ignore each other's input.
// Textures are read when a batch first wants one of their levels, and only levels that were wanted stay, within
// settings.texture_budget_bytes; beyond it, the least recently wanted ones leave.
// Precondition: scene.validate(). The scene must outlive this (its textures' sources are read later).
class Patterns {
 public:
  // Throws Error(Scene) with the prim path, the line and glslang's message where a material's own GLSL does not
  // compile; Error(Memory) when the levels that one batch wants do not fit the budget, with their size.
  // cache: what it holds of the scene's programs and textures need not be made again, and it is left what this one
  // made. It must outlive this, which must be gone before others use the cache, and be for the same device. Null: none.
  Patterns(Device& device, const Scene& scene, const Settings& settings = {}, PatternCache* cache = nullptr);
  ~Patterns();

  bool varies(PatternPart part, int32_t material) const;
  const PointLayout& layout(PatternPart part, int32_t material) const;  // empty where it does not vary
  const ShadingInputs& constantShading(int32_t material) const;
  const PathInputs& constantPath(int32_t material) const;
  float constantOpacity(int32_t material) const;
  const DisplacementInputs& constantDisplacement(int32_t material) const;
  // Name of the texture coordinates whose tangents the material's normal map is given in; empty: it has none.
  const std::string& normalTexcoord(int32_t material) const;
  PatternFingerprint fingerprint(PatternPart part, int32_t material) const;
  // Some material looks up a texture, so that footprints matter.
  bool readsTextures() const;

  // One dispatch for the batch (and one for each shader of the user's own in it), twice where levels had to be read.
  // Not thread-safe.
  // values.size() == points.size(). Every point's material must vary in the part; throws Error(Internal) otherwise.
  void evaluate(const PatternPoints& points, std::span<ShadingInputs> values);
  void evaluate(const PatternPoints& points, std::span<PathInputs> values);
  void evaluate(const PatternPoints& points, std::span<OpacityInputs> values);
  void evaluate(const PatternPoints& points, std::span<DisplacementInputs> values);

  uint64_t textureBytes() const;      // resident now
  uint64_t peakTextureBytes() const;  // most at any time

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
