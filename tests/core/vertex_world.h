// Worlds for the tests of vertex shading.
#pragma once

#include <memory>
#include <vector>

#include "core/render/vertex_shading.h"
#include "dice_meshes.h"
#include "path_world.h"

namespace encore::test {

inline Material emitsDisplayColor() {
  Material m = matte();
  m.diffuse_color = {{0, 0, 0}};
  PatternNode node;
  node.kind = PatternNode::Kind::DisplayColor;
  m.nodes.push_back(node);
  m.emissive_color.node = 0;
  return m;
}
enum : int32_t { kWhite = 3, kRamp = 4 };

// The world of the path tests, a white surface and one that emits its colour.
struct VertexWorld : World {
  VertexWorld() {
    Material white = matte();
    white.diffuse_color = {{1, 1, 1}};
    stage.scene.materials.push_back(white);
    stage.scene.materials.push_back(emitsDisplayColor());
    settings.shading_rate = 1;
    settings.light_samples = 4;
    settings.occlusion_samples = 16;
  }
  std::unique_ptr<VertexShading> shading() { return std::make_unique<VertexShading>(context(), camera(), stage.diced); }
};

inline std::vector<Vec3f> shadeLayer(VertexShading& shading, Layer layer, const Batch& batch) {
  std::vector<Vec3f> radiance(batch.first.size(), {-1, -1, -1});
  shading.shadeLayer(layer, batch.first, batch.ends, radiance);
  return radiance;
}

inline uint64_t totalEvaluations(const VertexShading& shading) {
  return shading.evaluations(Layer::Direct) + shading.evaluations(Layer::Reflection) +
         shading.evaluations(Layer::Refraction);
}

inline Light sun(Vec3f direction) {
  Light light;
  light.direction = normalize(direction);
  light.radiance = {3, 3, 3};
  return light;
}

// (u, v) of a point of a mesh.
inline Vec2f uvAt(const DicedMesh& mesh, const FacePoint& p) {
  const uint32_t* c = &mesh.triangles[3 * size_t{p.triangle}];
  return mesh.uv[c[0]] + ((mesh.uv[c[1]] - mesh.uv[c[0]]) * p.b1 + (mesh.uv[c[2]] - mesh.uv[c[0]]) * p.b2);
}

// An L of six corners: (u, v) of scaledToBounds().
inline Mesh concaveMesh() {
  return makeMesh({{0, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}, {1, 2, 0}, {0, 2, 0}}, {{0, 1, 2, 3, 4, 5}},
                  SubdivisionScheme::None);
}

}  // namespace encore::test
