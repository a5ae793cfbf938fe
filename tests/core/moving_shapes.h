// Things that move, for the tests of tracing: and the same things standing still at one time.
#pragma once

#include <utility>

#include "shapes.h"

namespace encore::test {

// The value at a time in [0, 1] of keys at uniform times.
template <class T, class Lerp>
T atTime(const std::vector<T>& keys, double time, Lerp lerp) {
  const double scaled = time * double(keys.size() - 1);
  const size_t first = std::min(keys.size() - 2, size_t(scaled));
  return lerp(keys[first], keys[first + 1], scaled - double(first));
}
inline Vec3d mix(Vec3d a, Vec3d b, double w) { return a * (1 - w) + b * w; }
inline std::vector<Vec3f> mix(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b, double w) {
  std::vector<Vec3f> values;
  for (size_t i = 0; i < a.size(); ++i) values.push_back(toFloat(mix(toDouble(a[i]), toDouble(b[i]), w)));
  return values;
}
inline Affine3d roundedToFloat(const Affine3d& m) {
  const Affine3f f = toFloat(m);
  return {toDouble(f.ex), toDouble(f.ey), toDouble(f.ez), toDouble(f.origin)};
}
// What a float32 tracer is given at its keys, between them in double precision.
inline Affine3d placedAt(const Instance& instance, double time) {
  if (instance.motion.empty()) return roundedToFloat(instance.to_world);
  return atTime(instance.motion, time, [](const Affine3d& x, const Affine3d& y, double w) {
    const Affine3d a = roundedToFloat(x), b = roundedToFloat(y);
    return Affine3d{mix(a.ex, b.ex, w), mix(a.ey, b.ey, w), mix(a.ez, b.ez, w), mix(a.origin, b.origin, w)};
  });
}

// The stage as it is at a time: nothing moves.
inline Stage frozen(const Stage& stage, double time) {
  Stage still = stage;
  const auto lerp = [](const auto& a, const auto& b, double w) { return mix(a, b, w); };
  for (DicedMesh& mesh : still.diced) {
    if (!mesh.motion_positions.empty()) mesh.positions = atTime(mesh.motion_positions, time, lerp);
    if (!mesh.motion_normals.empty()) mesh.normals = atTime(mesh.motion_normals, time, lerp);
    mesh.motion_positions.clear(), mesh.motion_normals.clear();
  }
  for (size_t i = 0; i < stage.scene.instances.size(); ++i) {
    still.scene.instances[i].to_world = placedAt(stage.scene.instances[i], time);
    still.scene.instances[i].motion.clear();
  }
  return still;
}

// Keys that turn around `axis` and go along `way`, after (to the right of) `start`.
inline std::vector<Affine3d> turning(Vec3d axis, double angle, Vec3d way, const Affine3d& start, size_t keys) {
  std::vector<Affine3d> motion;
  for (size_t i = 0; i < keys; ++i) {
    const double s = double(i) / double(keys - 1);
    motion.push_back(translation(way * s) * start * rotation(axis, angle * s));
  }
  return motion;
}

// Gives the mesh keys at which its vertices are shaken: those of one place alike.
inline void shake(DicedMesh& mesh, size_t keys, float size) {
  for (size_t k = 0; k < keys; ++k) {
    std::vector<Vec3f> positions = mesh.positions;
    const float phase = 2.1f * float(k);
    for (Vec3f& p : positions)
      p += Vec3f{std::sin(3 * p.y + phase), std::cos(2 * p.z + phase), std::sin(4 * p.x - phase)} * size;
    mesh.motion_positions.push_back(std::move(positions));
  }
}

// As randomStage(): half of the instances move, one of its two meshes deforms.
inline Stage movingStage(uint32_t seed) {
  Stage stage = randomStage(seed);
  Stream stream(seed + 1000);
  shake(stage.diced[1], 2 + seed % 3, 0.3f);
  for (size_t i = 0; i < stage.scene.instances.size(); i += 2) {
    Instance& instance = stage.scene.instances[i];
    instance.motion = turning(toDouble(stream.onSphere()), stream.next(0.5f, 1), toDouble(stream.inCube(2)),
                              instance.to_world, i % 4 == 0 ? 2 : 5);
  }
  return stage;
}

inline std::vector<Ray> randomTimedRays(uint32_t seed, size_t count) {
  std::vector<Ray> rays = randomRays(seed, count);
  Stream stream(seed + 7);
  for (size_t i = 0; i < count; ++i) rays[i].time = i % 16 == 0 ? 0 : i % 16 == 1 ? 1 : stream.next();
  return rays;
}

}  // namespace encore::test
