// What networks read at hits, and normals from maps: on a mesh whose values are known in closed form.
#include "core/trace/pattern_points.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "core/dice/dice.h"

namespace encore {
namespace {

using Kind = PointSlot::Kind;

// A square of two triangles in z = 0, x and y from 0 to 2, with st = (x / 2, sign * y / 2), seen from +z. In the world
// it is moved by `shift`.
struct Square {
  explicit Square(float sign = 1, bool smooth = false) {
    Mesh mesh;
    mesh.path = "/square";
    mesh.scheme = SubdivisionScheme::None;
    mesh.double_sided = true;
    mesh.points = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}};
    mesh.face_vertex_counts = {4};
    mesh.face_vertex_indices = {0, 1, 2, 3};
    Primvar<Vec2f> st{"st", Interpolation::Vertex, {{0, 0}, {1, 0}, {1, sign}, {0, sign}}, {}};
    Primvar<Vec2f> flat{"flat", Interpolation::Constant, {{0.5f, 0.5f}}, {}};
    mesh.texcoords = {st, flat};
    mesh.display_color = {"displayColor", Interpolation::Vertex, {{0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}}, {}};
    mesh.primvars = {{"wear", Interpolation::Vertex, {{0, 0, 3, 4}, {2, 0, 3, 4}, {2, 2, 3, 4}, {0, 2, 3, 4}}, {}}};
    const Vec3f tilt = normalize(Vec3f{0.3f, 0, 1});
    if (smooth) mesh.normals = {"normals", Interpolation::Vertex, {tilt, tilt, tilt, tilt}, {}};
    scene.meshes = {mesh};
    scene.prototypes = {{"/square", {0}}};
    Instance instance;
    instance.path = "/square";
    instance.to_world.origin = {10, 0, 0};
    scene.instances = {instance};
    scene.materials.resize(1);
    diced = diceScene(scene, {});
    trace = std::make_unique<TraceScene>(scene, diced);
  }
  // Of the ray along -z (or +z) through (x, y) of the mesh's space.
  Hit hit(float x, float y, bool from_front = true) {
    Ray ray;
    direction = {0, 0, from_front ? -1.0f : 1.0f};
    ray.origin = {10 + x, y, from_front ? 5.0f : -5.0f};
    ray.direction = direction;
    Hit found;
    trace->intersect({&ray, 1}, {&found, 1}, Coherence::Coherent);
    EXPECT_TRUE(found.valid());
    return found;
  }

  Scene scene;
  DicedMeshes diced;
  std::unique_ptr<TraceScene> trace;
  Vec3f direction;
};

void expectNear(Vec3f a, Vec3f b) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(a[i], b[i], 1e-5) << i;
}

TEST(PatternPoints, HoldWhatTheLayoutAsksFor) {
  Square square;
  const Hit hit = square.hit(0.5f, 1.25f);
  const SurfacePoint point = square.trace->surface(hit, square.direction);
  PointLayout layout;
  layout.slots = {{Kind::Position, "", {}},
                  {Kind::Texcoord, "st", {}},
                  {Kind::Texcoord, "none", {0.75f, 0.5f, 0, 0}},
                  {Kind::DisplayColor, "", {}},
                  {Kind::Primvar, "wear", {9, 9, 9, 9}},
                  {Kind::Primvar, "none", {5, 6, 7, 8}},
                  {Kind::ObjectPosition, "", {}},
                  {Kind::Normal, "", {}},
                  {Kind::Parameter, "", {}}};
  for (const PointSlot& slot : layout.slots) layout.size += slot.size();
  PatternPoints points;
  for (int i = 0; i < 2; ++i)
    appendPatternPoint(*square.trace, layout, hit, point, square.direction, {0.5f, 0, 0}, {0, 0.25f, 0}, points);
  ASSERT_EQ(points.size(), 2u);
  ASSERT_EQ(points.data.size(), 2 * layout.size);
  EXPECT_EQ(points.point[1].first, layout.size);
  EXPECT_EQ(points.point[1].material, 0u);
  const std::vector<float> expected{10.5f,      1.25f,     0,                    // position
                                    0.25f,      0.625f,    0.25f, 0, 0, 0.125f,  // st and its changes
                                    0.75f,      0.5f,      0,     0, 0, 0,       // the fallback, without change
                                    0.25f,      0.625f,    1,                    // displayColor
                                    0.5f,       1.25f,     3,     4,             // wear
                                    5,          6,         7,     8,             // the other's fallback
                                    0.5f,       1.25f,     0,                    // position in the mesh's space
                                    0,          0,         1,                    // normal
                                    point.uv.x, point.uv.y};
  for (size_t i = 0; i < points.data.size(); ++i) EXPECT_NEAR(points.data[i], expected[i % layout.size], 1e-5) << i;
}

TEST(PatternPoints, NormalsFaceTheRay) {
  Square square;
  for (bool front : {true, false}) {
    const Hit hit = square.hit(1, 0.5f, front);
    const SurfacePoint point = square.trace->surface(hit, square.direction);
    PatternPoints points;
    const PointLayout layout{{{Kind::Normal, "", {}}}, 3};
    appendPatternPoint(*square.trace, layout, hit, point, square.direction, {}, {}, points);
    EXPECT_EQ(points.data[2], front ? 1.0f : -1.0f);
  }
}

TEST(MappedNormal, FollowsTheTexcoords) {
  const Vec3f map = normalize(Vec3f{0.3f, 0.4f, 0.8f});
  for (float sign : {1.0f, -1.0f}) {
    Square square(sign);
    const Hit hit = square.hit(0.5f, 0.25f);
    const SurfacePoint point = square.trace->surface(hit, square.direction);
    const Vec3f n = mappedNormal(*square.trace, hit, point, "st", map);
    expectNear(n, {map.x, sign * map.y, map.z});  // mirrored coordinates mirror the map
  }
}

TEST(MappedNormal, TangentsAreAcrossTheShadingNormal) {
  Square square(1, true);
  const Hit hit = square.hit(0.5f, 0.25f);
  const SurfacePoint point = square.trace->surface(hit, square.direction);
  const Vec3f ns = normalize(Vec3f{0.3f, 0, 1}), tangent = normalize(Vec3f{1, 0, -0.3f});
  expectNear(point.ns, ns);
  const Vec3f map = normalize(Vec3f{0.3f, 0.4f, 0.8f});
  expectNear(mappedNormal(*square.trace, hit, point, "st", map), tangent * map.x + Vec3f{0, 1, 0} * map.y + ns * map.z);
  EXPECT_EQ(mappedNormal(*square.trace, hit, point, "st", {0, 0, 1}), point.ns);  // to the bit
  // Not of unit length: only the direction counts.
  expectNear(mappedNormal(*square.trace, hit, point, "st", map * 3),
             mappedNormal(*square.trace, hit, point, "st", map));
}

TEST(MappedNormal, StrangeMaps) {
  Square square;
  const Hit hit = square.hit(0.5f, 0.25f);
  const SurfacePoint point = square.trace->surface(hit, square.direction);
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  for (Vec3f map : {Vec3f{0, 0, 0}, Vec3f{nan, 0, 1}, Vec3f{infinity, 0, 1}, Vec3f{1e-38f, 0, 0}, Vec3f{1e30f, 0, 0},
                    Vec3f{0, 0, -1}, Vec3f{1, 0, -1}, Vec3f{0, 1, 0}}) {
    const Vec3f n = mappedNormal(*square.trace, hit, point, "st", map);
    EXPECT_NEAR(length(n), 1, 1e-5) << map.x << " " << map.y << " " << map.z;
    EXPECT_GT(dot(n, point.ng), 0) << map.x << " " << map.y << " " << map.z;
  }
  // Without tangents the surface keeps its own.
  for (const char* texcoord : {"none", "flat", ""})
    EXPECT_EQ(mappedNormal(*square.trace, hit, point, texcoord, {0.6f, 0, 0.8f}), point.ns) << texcoord;
}

}  // namespace
}  // namespace encore
