// A scene with what shade() needs, for its tests.
#pragma once

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <vector>

#include "core/shade/shade.h"
#include "shapes.h"

namespace encore::test {

// A stage with what shade() needs. Material 0 is a white diffuse surface without an interface.
class ShadeWorld {
 public:
  Stage stage;
  Settings settings;

  ShadeWorld() { white(material()); }
  static void white(Material& m) {
    m.diffuse_color.value = {1, 1, 1};
    m.ior.value = 1;
  }
  Material& material(size_t i = 0) { return stage.scene.materials[i]; }
  Light& addLight(Light::Kind kind) {
    stage.scene.lights.emplace_back().kind = kind;
    return stage.scene.lights.back();
  }
  void addGround(float z = 0, int32_t material = 0) {
    DicedMesh ground;
    test::addQuad(ground, {-50, -50, z}, {50, -50, z}, {50, 50, z}, {-50, 50, z});
    stage.add(ground, material);
  }

  // What a ray along `direction` hits, as sample `sample` of a pixel.
  PathVertex vertex(Vec3f origin, Vec3f direction, uint32_t sample = 0, uint32_t pixel = 0) {
    build();
    PathVertex v;
    v.throughput = {1, 1, 1};
    v.direction = normalize(direction);
    v.pixel = pixel, v.sample = sample;
    const Ray ray{origin, 0, v.direction};
    trace_->intersect({&ray, 1}, {&v.hit, 1}, Coherence::Coherent);
    if (!v.hit.valid()) throw std::logic_error("the test's ray misses");
    return v;
  }
  std::vector<Vec3f> shadeAll(const std::vector<PathVertex>& vertices, const std::vector<uint32_t>& ends) {
    build();
    std::vector<Vec3f> radiance(vertices.size(), {-1, -1, -1});
    const ShadeContext context{stage.scene, settings, *trace_, *patterns_, rays};
    shade(context, vertices, ends, radiance);
    return radiance;
  }
  Vec3f shadeOne(Vec3f origin, Vec3f direction) { return shadeAll({vertex(origin, direction)}, {1})[0]; }
  // Mean over many samples of one pixel that hit the same point.
  Vec3d mean(Vec3f origin, Vec3f direction, uint32_t count = 256) {
    std::vector<PathVertex> vertices;
    for (uint32_t i = 0; i < count; ++i) vertices.push_back(vertex(origin, direction, i));
    Vec3d sum;
    for (Vec3f r : shadeAll(vertices, {count})) sum = sum + toDouble(r);
    return sum / double(count);
  }
  std::atomic<uint64_t> rays{0};

 private:
  void build() {
    if (trace_) return;
    for (Material& m : stage.scene.materials) m.path = "/material";
    std::vector<uint8_t> passes;
    for (const Material& m : stage.scene.materials) passes.push_back(passesShadows(m, settings));
    if (std::find(passes.begin(), passes.end(), 1) == passes.end()) passes.clear();
    trace_ = std::make_unique<TraceScene>(stage.scene, stage.diced, false, passes);
    static const std::shared_ptr<Device> device = Device::create();
    patterns_ = std::make_unique<Patterns>(*device, stage.scene, settings);
  }
  std::unique_ptr<TraceScene> trace_;
  std::unique_ptr<Patterns> patterns_;
};

}  // namespace encore::test
