// Material networks → generated GLSL → values for batches of points.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "core/vulkan/device.h"
#include "shaders/records.h"

namespace encore {

// GLSL (a compute shader, #version 460, target Vulkan 1.3) → SPIR-V. name: for messages. Thread-safe.
// It may include "records.h" and "pattern/*.glsl" (names below shaders/), which the library holds as text.
// Throws Error(Internal) with glslang's log.
std::vector<uint32_t> compileGlsl(const std::string& source, const std::string& name);

// The generated source of the two parts of the scene's networks; empty where everything is constant.
// Exposed for tests and for --dump options.
struct PatternSource {
  std::string shading, path;
};
PatternSource generatePatterns(const Scene& scene);

// Evaluates the scene's materials. Constant parts cost nothing: they are tables. A part varies if one of the
// inputs that it needs has a node with something to read: a missing texture is its fallback, a constant; the base
// colour is needed by metals only; the metallic and the specular workflow ignore each other's input.
// Precondition: scene.validate(). The scene is not needed after construction.
class Patterns {
 public:
  Patterns(Device& device, const Scene& scene);
  ~Patterns();

  bool shadingVaries(int32_t material) const;
  bool pathVaries(int32_t material) const;
  const ShadingInputs& constantShading(int32_t material) const;
  const PathInputs& constantPath(int32_t material) const;
  // Name of the texture coordinates that the material's network reads; empty: none.
  const std::string& texcoordName(int32_t material) const;

  // One dispatch for the batch. Not thread-safe. values.size() == points.size(). Every point's
  // material must vary in the part that is asked for; throws Error(Internal) otherwise.
  void evaluateShading(std::span<const PatternPoint> points, std::span<ShadingInputs> values);
  void evaluatePath(std::span<const PatternPoint> points, std::span<PathInputs> values);

  uint64_t textureBytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
