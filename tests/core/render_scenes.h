// A small scene of every layer, and frames of it.
#pragma once

#include <gtest/gtest.h>

#include <cstring>

#include "core/render/render_loop.h"

namespace encore {

inline Mesh quad(const char* path, Vec3f corner, Vec3f u, Vec3f v, int32_t material) {
  Mesh mesh;
  mesh.path = path;
  mesh.scheme = SubdivisionScheme::None;
  mesh.points = {corner, corner + u, corner + u + v, corner + v};
  mesh.face_vertex_counts = {4};
  mesh.face_vertex_indices = {0, 1, 2, 3};
  mesh.material = material;
  return mesh;
}

// A Catmull-Clark cube; with all edges sharp it would be a box, so this is a rounded one.
inline Mesh cube(const char* path, float half, int32_t material) {
  Mesh mesh;
  mesh.path = path;
  for (const float z : {-half, half})
    for (const float y : {-half, half})
      for (const float x : {-half, half}) mesh.points.push_back({x, y, z});
  mesh.face_vertex_counts = {4, 4, 4, 4, 4, 4};
  mesh.face_vertex_indices = {0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5};
  mesh.material = material;
  mesh.target_edge_length_world = 0.1f;
  return mesh;
}

inline void place(Scene& scene, Mesh mesh, Vec3d at) {
  const uint32_t index = uint32_t(scene.meshes.size());
  scene.prototypes.push_back({mesh.path, {index}});
  Instance instance;
  instance.path = mesh.path;
  instance.prototype = index;
  instance.to_world.origin = at;
  scene.instances.push_back(instance);
  scene.meshes.push_back(std::move(mesh));
}

inline Scene everyLayer() {
  Scene scene;
  Material diffuse, mirror, glass;
  diffuse.path = "/diffuse";
  diffuse.diffuse_color.value = {0.6f, 0.4f, 0.2f};
  mirror.path = "/mirror";
  mirror.metallic.value = 1;
  mirror.roughness.value = 0;
  mirror.diffuse_color.value = {0.9f, 0.9f, 0.9f};
  glass.path = "/glass";
  glass.opacity.value = 0;
  glass.roughness.value = 0;
  scene.materials = {diffuse, mirror, glass};
  place(scene, quad("/floor", {-5, 0, 5}, {10, 0, 0}, {0, 0, -10}, 0), {0, 0, 0});
  place(scene, quad("/mirror", {-3, 0, 0}, {6, 0, 0}, {0, 3, 0}, 1), {0, 0, -2});
  place(scene, cube("/glass", 0.6f, 2), {-0.8, 0.7, 0});
  place(scene, cube("/block", 0.5f, 0), {0.9, 0.5, 0});
  Light dome, rect;
  dome.kind = Light::Kind::Dome;
  dome.path = "/sky";
  dome.radiance = {0.4f, 0.5f, 0.6f};
  rect.kind = Light::Kind::Rect;
  rect.path = "/window";
  rect.radiance = {6, 5, 4};
  rect.centre = {0, 4, 1};
  rect.half_u = {1, 0, 0};
  rect.half_v = {0, 0, -1};
  scene.lights = {dome, rect};
  scene.camera.path = "/camera";
  scene.camera.to_world.origin = {0, 1.2, 6};
  scene.camera.half_tangent = {0.5f, 0.5f * 45 / 70};
  return scene;
}

inline Settings smallFrame() {
  Settings settings;
  settings.width = 70;
  settings.height = 45;
  settings.samples = 3;
  settings.reuse_tile_pixels = 32;
  settings.light_samples = 4;
  settings.occlusion_samples = 8;
  settings.threads = 1;
  return settings;
}

inline std::shared_ptr<Device> device() { return Device::create({.select = "", .validation = true}); }

inline bool sameBits(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(Vec3f)) == 0;
}

inline void expectSameImages(const Frame& a, const Frame& b, const std::string& what) {
  ASSERT_EQ(a.images.layers.size(), b.images.layers.size()) << what;
  for (size_t layer = 0; layer < a.images.layers.size(); ++layer) {
    EXPECT_TRUE(sameBits(a.images.layers[layer], b.images.layers[layer])) << what << layerName(a.layers[layer]);
  }
  EXPECT_TRUE(sameBits(a.images.normal, b.images.normal)) << what;
  EXPECT_EQ(a.images.alpha, b.images.alpha) << what;
  EXPECT_EQ(a.images.depth, b.images.depth) << what;
  ASSERT_EQ(a.images.debug.size(), b.images.debug.size()) << what;
  for (size_t layer = 0; layer < a.images.debug.size(); ++layer) {
    EXPECT_EQ(a.images.debug[layer].evaluations, b.images.debug[layer].evaluations) << what;
    EXPECT_EQ(a.images.debug[layer].reshaded, b.images.debug[layer].reshaded) << what;
    EXPECT_EQ(a.images.debug[layer].distance, b.images.debug[layer].distance) << what;
    EXPECT_TRUE(sameBits(a.images.debug[layer].id, b.images.debug[layer].id)) << what;
  }
}

}  // namespace encore
