// Primvars of instances: what materials read at hits must be what they would read if every instance had meshes of its
// own that hold its values.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "core/dice/dice.h"
#include "core/trace/pattern_points.h"
#include "shapes.h"

namespace encore {
namespace {

using test::Stream;
using Kind = PointSlot::Kind;

const std::vector<std::string> kNames{"displayColor", "st", "wear", "both"};

// A square whose own values are there or not, by chance; different at every corner.
Mesh randomMesh(Stream& stream) {
  Mesh mesh;
  mesh.path = "/square";
  mesh.scheme = SubdivisionScheme::None;
  mesh.points = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}};
  mesh.face_vertex_counts = {4};
  mesh.face_vertex_indices = {0, 1, 2, 3};
  const auto has = [&] { return stream.next() < 0.5f; };
  const auto pair = [&] { return Vec2f{stream.next(), stream.next()}; };
  const auto four = [&] { return Vec4f{stream.next(), stream.next(), stream.next(), stream.next()}; };
  const auto color = [&] { return stream.inCube(1); };
  if (has()) mesh.display_color = {"displayColor", Interpolation::Vertex, {color(), color(), color(), color()}, {}};
  for (const char* name : {"st", "both"})
    if (has()) mesh.texcoords.push_back({name, Interpolation::Vertex, {pair(), pair(), pair(), pair()}, {}});
  for (const char* name : {"wear", "both"})
    if (has()) mesh.primvars.push_back({name, Interpolation::Vertex, {four(), four(), four(), four()}, {}});
  return mesh;
}

std::vector<InstancePrimvar> randomValues(Stream& stream) {
  std::vector<InstancePrimvar> values;
  for (uint32_t name = 0; name < kNames.size(); ++name)
    if (stream.next() < 0.6f)
      values.push_back({name, stream.next() < 0.5f, {stream.next(), stream.next(), stream.next(), stream.next()}});
  return values;
}

// Puts a constant into a mesh, where the instance's value is the one to read.
template <class T>
void bake(std::vector<Primvar<T>>& primvars, const std::string& name, bool wins, T value) {
  const auto own = std::find_if(primvars.begin(), primvars.end(), [&](const Primvar<T>& p) { return p.name == name; });
  if (own == primvars.end())
    primvars.push_back({name, Interpolation::Constant, {value}, {}});
  else if (wins)
    *own = {name, Interpolation::Constant, {value}, {}};
}

void bake(Mesh& mesh, const InstancePrimvar& given) {
  const std::string& name = kNames[given.name];
  const Vec4f v = given.value;
  if (name == "displayColor") {
    if (given.wins || mesh.display_color.empty())
      mesh.display_color = {name, Interpolation::Constant, {Vec3f{v.x, v.y, v.z}}, {}};
    return;
  }
  bake(mesh.texcoords, name, given.wins, Vec2f{v.x, v.y});
  bake(mesh.primvars, name, given.wins, v);
}

// Instances of few prototypes, with primvars; and the same with a prototype for each, and without.
struct Scenes {
  Scene shared, baked;

  explicit Scenes(Stream& stream) {
    shared.materials.resize(1);
    shared.instance_primvars = kNames;
    for (uint32_t i = 0; i < 6; ++i) shared.meshes.push_back(randomMesh(stream));
    shared.prototypes = {{"/a", {0, 1}}, {"/b", {2}}, {"/c", {3, 4, 5}}};
    baked.materials.resize(1);
    for (uint32_t i = 0; i < 40; ++i) {
      Instance instance;
      instance.path = "/instance" + std::to_string(i);
      instance.prototype = stream.index(3);
      instance.to_world = test::translation({double(i) * 5, 0, 0}) * test::scaling({1, 2, i % 2 ? 1.0 : -1.0});
      instance.primvars = randomValues(stream);
      shared.instances.push_back(instance);
      addBaked(instance);
    }
  }

  void addBaked(Instance instance) {
    Prototype prototype{instance.path, {}};
    for (const uint32_t index : shared.prototypes[instance.prototype].meshes) {
      prototype.meshes.push_back(uint32_t(baked.meshes.size()));
      Mesh& mesh = baked.meshes.emplace_back(shared.meshes[index]);
      for (const InstancePrimvar& given : instance.primvars) bake(mesh, given);
    }
    instance.prototype = uint32_t(baked.prototypes.size());
    instance.primvars.clear();
    baked.prototypes.push_back(prototype);
    baked.instances.push_back(instance);
  }
};

TEST(InstancePrimvars, ReadAsThoughTheMeshesHadThem) {
  PointLayout layout;
  layout.slots = {{Kind::DisplayColor, "displayColor", {}}, {Kind::Texcoord, "st", {8, 7, 0, 0}},
                  {Kind::Texcoord, "both", {1, 2, 0, 0}},   {Kind::Primvar, "wear", {5, 4, 3, 2}},
                  {Kind::Primvar, "both", {9, 8, 7, 6}},    {Kind::Texcoord, "none", {3, 4, 0, 0}}};
  Stream stream(21);
  uint32_t given = 0, own = 0;
  for (int round = 0; round < 10; ++round) {
    const Scenes scenes(stream);
    scenes.shared.validate(), scenes.baked.validate();
    const DicedMeshes shared_diced = diceScene(scenes.shared, {}), baked_diced = diceScene(scenes.baked, {});
    const TraceScene shared(scenes.shared, shared_diced), baked(scenes.baked, baked_diced);
    for (uint32_t i = 0; i < scenes.shared.instances.size(); ++i) {
      for (uint32_t mesh = 0; mesh < shared.meshCount(i); ++mesh) {
        const float b1 = stream.next(), b2 = stream.next() * (1 - b1);
        const Hit hit{i, mesh, stream.index(2), b1, b2, 1};
        const Vec3f direction{0, 0, -1}, dpdx = stream.inCube(0.1f), dpdy = stream.inCube(0.1f);
        const SurfacePoint point = shared.surface(hit, direction);
        PatternPoints a, b;
        appendPatternPoint(shared, layout, hit, point, direction, dpdx, dpdy, a);
        appendPatternPoint(baked, layout, hit, baked.surface(hit, direction), direction, dpdx, dpdy, b);
        EXPECT_EQ(a.data, b.data) << "instance " << i << ", mesh " << mesh;
        for (const char* name : {"st", "both"}) {
          const Vec3f normal = normalize(Vec3f{0.2f, 0.1f, 1});
          EXPECT_EQ(mappedNormal(shared, hit, point, name, normal), mappedNormal(baked, hit, point, name, normal));
        }
        const int32_t slot = shared.texcoordSlot(hit, "st");
        if (slot < 0) continue;
        Vec3f dpds, dpdt;
        (shared.tangents(hit, point, slot, dpds, dpdt) ? own : given) += 1;
      }
    }
  }
  EXPECT_GT(given, 50u);  // both cases were met
  EXPECT_GT(own, 50u);
}

// A place of the mesh that has no values of its own yet is not its own value.
TEST(InstancePrimvars, StandInForEmptyOnes) {
  test::Stage stage;
  const uint32_t mesh = stage.addMesh(test::sphere(2));
  stage.scene.meshes[mesh].texcoords.resize(1), stage.scene.meshes[mesh].texcoords[0].name = "st";
  stage.addInstance(stage.addPrototype({mesh})), stage.addInstance(0);
  stage.scene.instance_primvars = {"displayColor", "st"};
  stage.scene.instances[1].primvars = {{1, false, {3, 4, 0, 0}}, {0, false, {0.5f, 0.25f, 1, 9}}};
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_EQ(trace.texcoordSlot({0, 0, 0}, "st"), -1);
  EXPECT_EQ(trace.displayColor({0, 0, 0}), (Vec3f{0.18f, 0.18f, 0.18f}));
  EXPECT_EQ(trace.displayColor({1, 0, 0}), (Vec3f{0.5f, 0.25f, 1}));
  const Hit hit{1, 0, 5, 0.25f, 0.5f, 1};
  const TexcoordPoint st = trace.texcoord(hit, trace.surface(hit, {0, 0, 1}), trace.texcoordSlot(hit, "st"), {}, {});
  EXPECT_EQ(st.st, (Vec2f{3, 4}));
}

}  // namespace
}  // namespace encore
