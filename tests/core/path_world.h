// A stage with everything that tracing paths needs, and batches of camera rays over it.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "core/path/path.h"
#include "shapes.h"

namespace encore::test {

inline Device& device() {
  static const std::shared_ptr<Device> shared = Device::create();
  return *shared;
}

inline Material matte() {  // nothing but diffuse
  Material m;
  m.ior = {1.0f};
  return m;
}
inline Material mirror(Vec3f tint = {1, 1, 1}) {
  Material m;
  m.metallic = {1.0f}, m.roughness = {0.0f}, m.diffuse_color = {tint};
  return m;
}
inline Material glass(float ior = 1.5f) {
  Material m;
  m.opacity = {0.0f}, m.roughness = {0.0f}, m.ior = {ior};
  return m;
}
enum : int32_t { kMatte = 0, kMirror = 1, kGlass = 2 };

// A stage with everything that tracing paths needs. Camera: at the origin, along -Z.
struct World {
  Stage stage;
  Settings settings;
  std::unique_ptr<TraceScene> trace;
  std::unique_ptr<Patterns> patterns;
  std::atomic<uint64_t> rays_traced{0};

  World() {
    stage.scene.materials = {matte(), mirror(), glass()};
    settings.width = settings.height = 32;
    stage.scene.camera.half_tangent = {0.3f, 0.3f};
  }
  void build() {
    trace = std::make_unique<TraceScene>(stage.scene, stage.diced);
    patterns = std::make_unique<Patterns>(device(), stage.scene);
  }
  ShadeContext context() { return {stage.scene, settings, *trace, *patterns, rays_traced}; }
  CameraRays camera() const { return CameraRays(stage.scene.camera, settings, stage.scene.moves()); }
};

struct Batch {
  std::vector<FirstHit> first;
  std::vector<uint32_t> ends;
  std::vector<PathVertex> vertices;
};

inline FirstHit filmPoint(float x, float y, uint32_t pixel, uint32_t sample) {
  FirstHit f;
  f.film_x = x, f.film_y = y, f.pixel = pixel, f.sample = sample;
  return f;
}

// per_pixel jittered samples in every pixel, in blocks of `block` pixels.
inline Batch film(World& world, uint32_t per_pixel, uint32_t block = 64) {
  Batch batch;
  const uint32_t width = world.settings.width, pixels = width * world.settings.height;
  for (uint32_t p = 0; p < pixels; ++p) {
    for (uint32_t s = 0; s < per_pixel; ++s) {
      const Vec2f u = sobol2(s, p + 1);
      batch.first.push_back(filmPoint(float(p % width) + u.x, float(p / width) + u.y, p, s));
    }
    if (p % block == block - 1 || p == pixels - 1) batch.ends.push_back(uint32_t(batch.first.size()));
  }
  batch.vertices.resize(batch.first.size());
  traceFirstHits(world.context(), world.camera(), batch.first, batch.ends);
  return batch;
}

inline void follow(World& world, Layer layer, Batch& batch) {
  tracePaths(world.context(), world.camera(), layer, batch.first, batch.ends, batch.vertices);
}

inline DicedMesh wall(float z, float size) {  // faces +Z
  DicedMesh mesh;
  addQuad(mesh, {-size, -size, z}, {size, -size, z}, {size, size, z}, {-size, size, z});
  return mesh;
}

inline Light dome(Vec3f radiance) {
  Light light;
  light.kind = Light::Kind::Dome;
  light.radiance = radiance;
  return light;
}

inline Vec3f direction(const World& world, const FirstHit& first) { return world.camera().ray(first).direction; }
inline Vec3d position(const World& world, const PathVertex& v) {
  return toDouble(world.trace->surface(v.hit, v.direction).position);
}

}  // namespace encore::test
