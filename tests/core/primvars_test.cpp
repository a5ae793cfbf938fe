#include <gtest/gtest.h>

#include "core/trace/trace_scene.h"
#include "moving_shapes.h"

namespace encore {
namespace {

using test::Stage;
using test::Stream;

TEST(Primvars, AreFoundByNameAndInterpolated) {
  Stage stage;
  DicedMesh mesh = test::sphere(5);
  mesh.primvars.resize(2);
  for (const Vec3f& p : mesh.positions) mesh.primvars[1].push_back({p.x, 2 * p.y, 3 * p.z, 7});
  const uint32_t index = stage.addMesh(mesh);
  stage.scene.meshes[index].primvars.resize(3);
  stage.scene.meshes[index].primvars[0].name = "empty", stage.scene.meshes[index].primvars[1].name = "wear";
  stage.scene.meshes[index].primvars[2].name = "not diced";
  stage.addInstance(stage.addPrototype({index}), test::translation({1, 2, 3}) * test::scaling({2, -1, 1}));
  const TraceScene trace(stage.scene, stage.diced);
  Stream stream(3);
  for (uint32_t triangle = 0; triangle < mesh.triangleCount(); ++triangle) {
    const float b1 = stream.next(), b2 = stream.next() * (1 - b1);
    const Hit hit{0, 0, triangle, b1, b2, 1};
    EXPECT_EQ(trace.primvarSlot(hit, "empty"), -1);
    EXPECT_EQ(trace.primvarSlot(hit, "not diced"), -1);
    EXPECT_EQ(trace.primvarSlot(hit, "other"), -1);
    ASSERT_EQ(trace.primvarSlot(hit, "wear"), 1);
    const Vec3f p = trace.objectPosition(hit);
    const Vec4f value = trace.primvar(hit, 1);
    EXPECT_NEAR(value.x, p.x, 1e-6f);
    EXPECT_NEAR(value.y, 2 * p.y, 1e-6f);
    EXPECT_NEAR(value.z, 3 * p.z, 1e-6f);
    EXPECT_EQ(value.w, 7);
    EXPECT_EQ(trace.primvar(hit, -1), Vec4f{});
    const Vec3f world = trace.surface(hit, {0, 0, 1}).position;
    EXPECT_LT(length(world - Vec3f{2 * p.x + 1, 2 - p.y, p.z + 3}), 1e-6f);
  }
}

// Texture coordinates that are a linear function of the plane: dp/ds and dp/dt are its inverse, at any size.
TEST(Primvars, TangentsInvertTheTextureCoordinates) {
  Stream stream(5);
  for (const float size : {1e-5f, 1.0f, 1e5f})
    for (int round = 0; round < 50; ++round) {
      const Vec3f dpds = stream.inCube(size), dpdt = stream.inCube(size);
      DicedMesh mesh;
      const auto st = [&] { return Vec2f{stream.next(-2, 2), stream.next(-2, 2)}; };
      const Vec2f a = st(), b = st(), c = st();
      if (std::abs((b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y)) < 0.05f) continue;
      const auto at = [&](Vec2f t) { return dpds * t.x + dpdt * t.y; };
      test::addTriangle(mesh, at(a), at(b), at(c));
      mesh.texcoords = {{a, b, c}, {a, a, a}, {a, b, b}};
      Stage stage;
      stage.add(mesh, 0, test::translation({1, 2, 3}) * test::scaling({2, 1, -1}));
      stage.scene.instances[0].motion = {stage.scene.instances[0].to_world,
                                         test::translation({1, 2, 3}) * test::scaling({4, 1, -1})};
      const TraceScene trace(stage.scene, stage.diced);
      const Hit hit{0, 0, 0, 0.3f, 0.2f, 1, 0.5f};  // the scale in x is 3 then
      const SurfacePoint point = trace.surface(hit, {0, 0, 1});
      Vec3f s, t;
      ASSERT_TRUE(trace.tangents(hit, point, 0, s, t));
      EXPECT_LT(length(s - dpds * Vec3f{3, 1, -1}), 1e-3f * size);
      EXPECT_LT(length(t - dpdt * Vec3f{3, 1, -1}), 1e-3f * size);
      EXPECT_FALSE(trace.tangents(hit, point, -1, s, t));
      EXPECT_FALSE(trace.tangents(hit, point, 1, s, t));  // constant
      EXPECT_FALSE(trace.tangents(hit, point, 2, s, t));  // constant along a line
    }
}

TEST(Primvars, GroupsAndThinnessComeFromMeshOrInstance) {
  Stage stage;
  const uint32_t a = stage.addMesh(test::box({-1, -1, -1}, {1, 1, 1})), b = stage.addMesh(test::sphere(3));
  stage.scene.meshes[a].link_group = 3, stage.scene.meshes[a].thin_walled = true;
  const uint32_t both = stage.addPrototype({a, b});
  stage.addInstance(both), stage.addInstance(both);
  stage.scene.instances[1].link_group = 5;
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_EQ(trace.linkGroup({0, 0, 0}), 3u);
  EXPECT_EQ(trace.linkGroup({0, 1, 0}), 0u);
  EXPECT_EQ(trace.linkGroup({1, 0, 0}), 5u);
  EXPECT_EQ(trace.linkGroup({1, 1, 0}), 5u);
  EXPECT_TRUE(trace.surface({0, 0, 0}, {0, 0, 1}).thin);
  EXPECT_FALSE(trace.surface({0, 1, 0}, {0, 0, 1}).thin);
  EXPECT_EQ(trace.meshCount(0), 2u);
  EXPECT_EQ(trace.triangleCount(0, 0), 12u);
  EXPECT_EQ(trace.triangleCount(1, 1), stage.diced[b].triangleCount());
}

}  // namespace
}  // namespace encore
