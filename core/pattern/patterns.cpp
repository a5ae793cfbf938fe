#include "core/pattern/patterns.h"

#include <cstring>
#include <utility>

#include "core/pattern/network.h"
#include "core/pattern/texture_store.h"
#include "core/scene/error.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;  // of evaluate.glsl

// Push constants of evaluate.glsl.
struct Arguments {
  uint64_t points, values, levels;
  uint32_t count;
};

// The name of the first texture coordinates among the nodes; the scene's validation lets a material have one.
template <class Network>
std::string findTexcoord(const Material& material, const Network& network) {
  for (int32_t n : reachableNodes(network))
    if (const PatternNode& node = material.nodes[size_t(n)]; node.kind == PatternNode::Kind::Texture)
      return node.texcoord;
  return {};
}

// One part of all materials: its constants, its kernel, and the buffers of its batches.
template <class Outputs>
class Part {
 public:
  template <class Network>
  void add(const Network& network) {
    constants_.push_back(constants(network));
    varies_.push_back(!reachableNodes(network).empty());
  }
  void compile(Device& device, const std::string& source, const std::string& name) {
    if (!source.empty()) kernel_ = Kernel(device, name, compileGlsl(source, name));
  }

  bool varies(int32_t material) const { return varies_.at(size_t(material)) != 0; }
  const Outputs& constant(int32_t material) const { return constants_.at(size_t(material)); }

  void evaluate(Device& device, uint64_t levels, std::span<const PatternPoint> points, std::span<Outputs> values) {
    if (points.size() != values.size() || points.size() > 0xffffffffu)
      throw Error(ErrorKind::Internal, "a batch of " + std::to_string(points.size()) + " points came with room for " +
                                           std::to_string(values.size()) + " values");
    if (points.empty()) return;
    for (const PatternPoint& point : points)
      if (point.material >= varies_.size() || !varies_[point.material])
        throw Error(ErrorKind::Internal,
                    "material " + std::to_string(point.material) + " was evaluated, but has no varying input");
    grow(device, points.size());
    std::memcpy(points_.host().data(), points.data(), points.size_bytes());
    points_.toDevice(0, points.size());
    Commands commands(device);
    commands.dispatch(kernel_, groupsFor(points.size(), kLocalSize),
                      Arguments{points_.address(), values_.address(), levels, uint32_t(points.size())});
    commands.run();
    values_.toHost(0, values.size());
    std::memcpy(values.data(), values_.host().data(), values.size_bytes());
  }

 private:
  // In steps of a half, so that slowly growing batches do not allocate every time.
  void grow(Device& device, size_t size) {
    if (size <= points_.size()) return;
    const size_t larger = std::max(size, points_.size() + points_.size() / 2);
    points_.reserve(device, larger, "pattern points");
    values_.reserve(device, larger, "pattern values");
  }

  std::vector<Outputs> constants_;
  std::vector<char> varies_;
  Kernel kernel_;
  Buffer<PatternPoint> points_;
  Buffer<Outputs> values_;
};

}  // namespace

struct Patterns::Impl {
  Impl(Device& on, const Scene& scene) : device(on), textures(on, scene, layoutTextures(scene)) {
    for (const Material& material : scene.materials) {
      const ShadingNetwork shading_network = shadingNetwork(material);
      const PathNetwork path_network = pathNetwork(material);
      shading.add(shading_network);
      path.add(path_network);
      std::string texcoord = findTexcoord(material, shading_network);
      texcoords.push_back(texcoord.empty() ? findTexcoord(material, path_network) : std::move(texcoord));
    }
    const PatternSource source = generatePatterns(scene);
    shading.compile(device, source.shading, "pattern_shading");
    path.compile(device, source.path, "pattern_path");
  }

  Device& device;
  TextureStore textures;
  Part<ShadingInputs> shading;
  Part<PathInputs> path;
  std::vector<std::string> texcoords;
};

Patterns::Patterns(Device& device, const Scene& scene) : impl_(std::make_unique<Impl>(device, scene)) {}
Patterns::~Patterns() = default;

bool Patterns::shadingVaries(int32_t material) const { return impl_->shading.varies(material); }
bool Patterns::pathVaries(int32_t material) const { return impl_->path.varies(material); }
const ShadingInputs& Patterns::constantShading(int32_t material) const { return impl_->shading.constant(material); }
const PathInputs& Patterns::constantPath(int32_t material) const { return impl_->path.constant(material); }
const std::string& Patterns::texcoordName(int32_t material) const { return impl_->texcoords.at(size_t(material)); }

void Patterns::evaluateShading(std::span<const PatternPoint> points, std::span<ShadingInputs> values) {
  impl_->shading.evaluate(impl_->device, impl_->textures.levelsAddress(), points, values);
}
void Patterns::evaluatePath(std::span<const PatternPoint> points, std::span<PathInputs> values) {
  impl_->path.evaluate(impl_->device, impl_->textures.levelsAddress(), points, values);
}

uint64_t Patterns::textureBytes() const { return impl_->textures.bytes(); }

}  // namespace encore
