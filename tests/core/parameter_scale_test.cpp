#include "core/trace/parameter_scale.h"

#include <gtest/gtest.h>

#include "shapes.h"

namespace encore {
namespace {

using test::Stage;

DicedMesh plank(float length_u, float length_v) {
  DicedMesh mesh;
  test::addQuad(mesh, {0, 0, 0}, {length_u, 0, 0}, {length_u, length_v, 0}, {0, length_v, 0});
  return mesh;
}

TEST(ParameterScale, IsInProportionToThePrimitive) {
  Stage stage;
  stage.add(plank(100, 1));
  stage.add(plank(2, 8), 0, test::translation({1, 2, 3}) * test::rotation({0.6, 0, 0.8}, 1) * test::scaling({3, 3, 3}));
  stage.addInstance(0, test::scaling({0.01, 2, 1}));
  const ParameterScales scales(stage.scene, stage.diced);
  EXPECT_EQ(scales.scale(0, 0).x, 1);
  EXPECT_NEAR(scales.scale(0, 0).y, 0.01, 1e-7);
  EXPECT_NEAR(scales.scale(1, 0).x, 0.25, 1e-6);
  EXPECT_EQ(scales.scale(1, 0).y, 1);
  EXPECT_NEAR(scales.scale(2, 0).x, 0.5, 1e-6);
  EXPECT_EQ(scales.scale(2, 0).y, 1);
}

// Rigid instances share a table; a primitive is found by its number in the prototype.
TEST(ParameterScale, CountsPrimitivesThroughTheMeshes) {
  Stage stage;
  const uint32_t a = stage.addMesh(plank(1, 2)), b = stage.addMesh(plank(1, 4));
  const uint32_t prototype = stage.addPrototype({a, b});
  for (int i = 0; i < 50; ++i)
    stage.addInstance(prototype, test::rotation(normalize(Vec3d{1, 2, double(i)}), i) * test::scaling({5, 5, 5}));
  const ParameterScales scales(stage.scene, stage.diced);
  for (uint32_t i = 0; i < 50; ++i) {
    EXPECT_EQ(scales.scale(i, 0), (Vec2f{0.5f, 1}));
    EXPECT_EQ(scales.scale(i, 1), (Vec2f{0.25f, 1}));
  }
  EXPECT_LT(scales.bytes(), 1000u);
  EXPECT_GE(scales.bytes(), 50 * sizeof(uint32_t) + 2 * sizeof(Vec2f));
}

// A sheared sector of a disk in polar parameters: the mean of |dp/dv| is that at the middle radius.
TEST(ParameterScale, IsTheMeanOverThePrimitive) {
  const uint32_t n = 64;
  const float angle = 1.5f;
  DicedMesh mesh;
  for (uint32_t j = 0; j <= n; ++j)
    for (uint32_t i = 0; i <= n; ++i) {
      const float u = float(i) / n, v = float(j) / n, r = 1 + 2 * u;
      mesh.positions.push_back({r * std::cos(angle * v), r * std::sin(angle * v), 0});
      mesh.uv.push_back({u, v});
    }
  for (uint32_t j = 0; j < n; ++j)
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t c = j * (n + 1) + i;
      mesh.triangles.insert(mesh.triangles.end(), {c, c + 1, c + n + 2, c, c + n + 2, c + n + 1});
      mesh.triangle_primitive.insert(mesh.triangle_primitive.end(), {0, 0});
    }
  mesh.primitive_face = {0};
  Stage stage;
  stage.add(mesh);
  const ParameterScales scales(stage.scene, stage.diced);
  EXPECT_NEAR(scales.scale(0, 0).x, 2 / (angle * 2), 1e-3);
  EXPECT_EQ(scales.scale(0, 0).y, 1);
}

TEST(ParameterScale, SurvivesWhatHasNoExtent) {
  Stage stage;
  DicedMesh odd = plank(0, 0);
  test::addQuad(odd, {0, 0, 0}, {1, 0, 0}, {1, 0, 0}, {0, 0, 0});  // a line
  test::addQuad(odd, {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  for (size_t i = 8; i < 12; ++i) odd.uv[i] = {0.5f, 0.5f};  // no parameters
  stage.add(odd);
  stage.addInstance(0, test::scaling({0, 0, 0}));
  const ParameterScales scales(stage.scene, stage.diced);
  for (uint32_t instance = 0; instance < 2; ++instance) {
    EXPECT_EQ(scales.scale(instance, 0), (Vec2f{1, 1}));
    EXPECT_EQ(scales.scale(instance, 1), (Vec2f{1, 0x1p-16f}));
    EXPECT_EQ(scales.scale(instance, 2), (Vec2f{1, 1}));
  }
}

TEST(ParameterScale, IsAppliedToParametersAndFootprints) {
  Stage stage;
  stage.add(plank(100, 1));
  const TraceScene plain(stage.scene, stage.diced), scaled(stage.scene, stage.diced, true);
  const Hit hit{0, 0, 0, 0.25f, 0.5f, 1};
  const SurfacePoint a = plain.surface(hit, {0, 0, -1}), b = scaled.surface(hit, {0, 0, -1});
  EXPECT_EQ(a.uv, (Vec2f{0.75f, 0.5f}));
  EXPECT_NEAR(b.uv.x, 0.75f, 1e-6f);
  EXPECT_NEAR(b.uv.y, 0.005f, 1e-6f);
  const Vec3f along{1, 0, 0}, across{0, 0.5f, 0};
  EXPECT_NEAR(plain.parametricFootprint(hit, a, along, along), 0.01f, 1e-6f);
  EXPECT_NEAR(plain.parametricFootprint(hit, a, across, across), 0.5f, 1e-6f);
  EXPECT_NEAR(scaled.parametricFootprint(hit, b, along, along), 0.01f, 1e-6f);
  EXPECT_NEAR(scaled.parametricFootprint(hit, b, across, across), 0.005f, 1e-6f);
}

}  // namespace
}  // namespace encore
