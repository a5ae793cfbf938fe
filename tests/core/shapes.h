// Small scenes for the tests of tracing and paths: diced shapes, and a scene that owns them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/dice/dice.h"
#include "core/scene/random.h"
#include "core/scene/scene.h"
#include "core/trace/trace_scene.h"

namespace encore::test {

// A reproducible stream of numbers in [0, 1).
class Stream {
 public:
  explicit Stream(uint32_t seed) : seed_(seed) {}
  float next() { return toUnit(pcg4d(seed_, counter_++, 77, 5)[0]); }
  float next(float low, float high) { return low + (high - low) * next(); }
  uint32_t index(uint32_t count) { return std::min(count - 1, uint32_t(next() * float(count))); }
  Vec3f inCube(float size) { return {next(-size, size), next(-size, size), next(-size, size)}; }
  Vec3f onSphere() {
    const float z = next(-1, 1), phi = next(0, 2 * kPi), r = std::sqrt(std::max(0.0f, 1 - z * z));
    return {r * std::cos(phi), r * std::sin(phi), z};
  }

 private:
  uint32_t seed_, counter_ = 0;
};

// Adds a triangle with its own vertices as a primitive of its own; uv are those of a unit triangle.
inline void addTriangle(DicedMesh& mesh, Vec3f a, Vec3f b, Vec3f c) {
  const uint32_t first = uint32_t(mesh.positions.size()), primitive = uint32_t(mesh.primitive_face.size());
  mesh.positions.insert(mesh.positions.end(), {a, b, c});
  mesh.uv.insert(mesh.uv.end(), {{0, 0}, {1, 0}, {0, 1}});
  mesh.triangles.insert(mesh.triangles.end(), {first, first + 1, first + 2});
  mesh.triangle_primitive.push_back(primitive);
  mesh.primitive_face.push_back(primitive);
  ++mesh.micropolygons;
}

// Adds a quad (two triangles, one primitive) whose outside is where its corners run counter-clockwise.
inline void addQuad(DicedMesh& mesh, Vec3f a, Vec3f b, Vec3f c, Vec3f d) {
  const uint32_t first = uint32_t(mesh.positions.size()), primitive = uint32_t(mesh.primitive_face.size());
  mesh.positions.insert(mesh.positions.end(), {a, b, c, d});
  mesh.uv.insert(mesh.uv.end(), {{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  mesh.triangles.insert(mesh.triangles.end(), {first, first + 1, first + 2, first, first + 2, first + 3});
  mesh.triangle_primitive.insert(mesh.triangle_primitive.end(), {primitive, primitive});
  mesh.primitive_face.push_back(primitive);
  ++mesh.micropolygons;
}

// The box from low to high, outside outwards.
inline DicedMesh box(Vec3f l, Vec3f h) {
  DicedMesh mesh;
  addQuad(mesh, {l.x, l.y, h.z}, {h.x, l.y, h.z}, {h.x, h.y, h.z}, {l.x, h.y, h.z});
  addQuad(mesh, {h.x, l.y, l.z}, {l.x, l.y, l.z}, {l.x, h.y, l.z}, {h.x, h.y, l.z});
  addQuad(mesh, {h.x, l.y, h.z}, {h.x, l.y, l.z}, {h.x, h.y, l.z}, {h.x, h.y, h.z});
  addQuad(mesh, {l.x, l.y, l.z}, {l.x, l.y, h.z}, {l.x, h.y, h.z}, {l.x, h.y, l.z});
  addQuad(mesh, {l.x, h.y, h.z}, {h.x, h.y, h.z}, {h.x, h.y, l.z}, {l.x, h.y, l.z});
  addQuad(mesh, {l.x, l.y, l.z}, {h.x, l.y, l.z}, {h.x, l.y, h.z}, {l.x, l.y, h.z});
  return mesh;
}

// A unit sphere around the origin as a cube's six faces of n × n quads, with the sphere's own normals.
inline DicedMesh sphere(uint32_t n, bool smooth = true) {
  DicedMesh mesh;
  for (int face = 0; face < 6; ++face) {
    const auto at = [&](uint32_t i, uint32_t j) {
      // Equal angles instead of equal lengths: more even quads.
      const float s = std::tan((float(i) / float(n) - 0.5f) * kPi / 2),
                  t = std::tan((float(j) / float(n) - 0.5f) * kPi / 2);
      const float sign = face % 2 ? -1.0f : 1.0f;
      const Vec3f p[3] = {{sign, s * sign, t}, {t, sign, s * sign}, {s * sign, t, sign}};
      return normalize(p[face / 2]);
    };
    for (uint32_t j = 0; j < n; ++j)
      for (uint32_t i = 0; i < n; ++i) {
        const Vec3f p[4] = {at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)};
        // The diagonal that keeps the body convex.
        const bool turn = dot(cross(p[1] - p[0], p[2] - p[0]), p[3] - p[0]) > 0;
        addQuad(mesh, p[turn], p[1 + turn], p[2 + turn], p[(3 + turn) % 4]);
      }
  }
  if (smooth) mesh.normals = mesh.positions;
  return mesh;
}

// A scene of diced meshes, each in a prototype of its own unless said otherwise.
struct Stage {
  Scene scene;
  std::vector<DicedMesh> diced;

  Stage() { scene.materials.emplace_back(); }

  uint32_t addMesh(DicedMesh mesh, int32_t material = 0) {
    Mesh source;
    source.path = "/mesh" + std::to_string(diced.size());
    source.material = material;
    scene.meshes.push_back(std::move(source));
    diced.push_back(std::move(mesh));
    return uint32_t(diced.size() - 1);
  }
  uint32_t addPrototype(std::vector<uint32_t> meshes) {
    scene.prototypes.push_back({"/prototype" + std::to_string(scene.prototypes.size()), std::move(meshes)});
    return uint32_t(scene.prototypes.size() - 1);
  }
  uint32_t addInstance(uint32_t prototype, const Affine3d& to_world = {}, int32_t material = -1) {
    Instance& instance = scene.instances.emplace_back();
    instance.path = "/instance" + std::to_string(scene.instances.size() - 1);
    instance.prototype = prototype, instance.to_world = to_world, instance.material = material;
    return uint32_t(scene.instances.size() - 1);
  }
  uint32_t add(DicedMesh mesh, int32_t material = 0, const Affine3d& to_world = {}) {
    return addInstance(addPrototype({addMesh(std::move(mesh), material)}), to_world);
  }
};

inline Affine3d translation(Vec3d t) { return {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, t}; }
inline Affine3d scaling(Vec3d s) { return {{s.x, 0, 0}, {0, s.y, 0}, {0, 0, s.z}, {0, 0, 0}}; }
// By `angle` radians around the unit vector `axis` (Rodrigues).
inline Affine3d rotation(Vec3d axis, double angle) {
  const auto turn = [&](Vec3d v) {
    return v * std::cos(angle) + cross(axis, v) * std::sin(angle) + axis * (dot(axis, v) * (1 - std::cos(angle)));
  };
  return {turn({1, 0, 0}), turn({0, 1, 0}), turn({0, 0, 1}), {0, 0, 0}};
}

inline Affine3d placed(const Instance& instance) {  // what a float32 tracer is given
  const Affine3f f = toFloat(instance.to_world);
  return {toDouble(f.ex), toDouble(f.ey), toDouble(f.ez), toDouble(f.origin)};
}

inline DicedMesh soup(Stream& stream, uint32_t count) {
  DicedMesh mesh;
  for (uint32_t i = 0; i < count; ++i) {
    const Vec3f centre = stream.inCube(1);
    addTriangle(mesh, centre + stream.inCube(0.4f), centre + stream.inCube(0.4f), centre + stream.inCube(0.4f));
  }
  return mesh;
}

inline Affine3d randomTransform(Stream& stream, int kind) {
  const Vec3d axis = toDouble(stream.onSphere());
  const Affine3d turn = rotation(axis, stream.next(0, 6)), move = translation(toDouble(stream.inCube(2)));
  switch (kind % 4) {
    case 0:
      return move * turn;
    case 1:
      return move * turn * scaling({1.5, -0.5, 0.8});  // mirrored
    case 2:
      return move * turn * scaling({2, 0.3, 1}) * rotation({0, 0, 1}, 0.7);  // sheared
    default:
      return move * turn * Affine3d{{1, 0, 0}, {0.8, -1, 0.2}, {0, 0.3, -0.4}, {0, 0, 0}};
  }
}

inline Stage randomStage(uint32_t seed) {
  Stream stream(seed);
  Stage stage;
  const uint32_t a = stage.addMesh(soup(stream, 30)), b = stage.addMesh(soup(stream, 20)), c = stage.addMesh({});
  const uint32_t first = stage.addPrototype({a, c, b}), second = stage.addPrototype({b});
  stage.addPrototype({a});  // never placed
  for (int i = 0; i < 8; ++i) stage.addInstance(i % 2 ? second : first, randomTransform(stream, i));
  return stage;
}

inline std::vector<Ray> randomRays(uint32_t seed, size_t count) {
  Stream stream(seed);
  std::vector<Ray> rays(count);
  for (Ray& ray : rays) {
    ray.origin = stream.inCube(5);
    ray.direction = normalize(stream.inCube(2) - ray.origin);
  }
  return rays;
}

inline std::vector<Hit> intersect(const TraceScene& trace, const std::vector<Ray>& rays,
                                  Coherence coherence = Coherence::Incoherent) {
  std::vector<Hit> hits(rays.size());
  trace.intersect(rays, hits, coherence);
  return hits;
}

}  // namespace encore::test
