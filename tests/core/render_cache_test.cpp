// Frames with a cache are those without, to the last bit, after whatever edit; and only what was edited is made anew.
#include "core/render/render_cache.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/pattern/texture_pyramid.h"
#include "core/render/render_loop.h"
#include "core/scene/error.h"

namespace encore {
namespace {

// Waves around a mean; counts what is asked of it.
class Waves : public TextureSource {
 public:
  explicit Waves(float frequency) : frequency_(frequency) {}
  void read(std::span<uint16_t> rgba) const override {
    ++reads;
    for (size_t i = 0; i < rgba.size(); ++i)
      rgba[i] = toHalf(i % 4 == 3 ? 1.0f : 0.5f + 0.4f * std::sin(frequency_ * float(i / 4)));
  }
  void reused() const override { ++reuses; }
  mutable int reads = 0, reuses = 0;

 private:
  float frequency_;
};

Texture waves(float frequency) { return {"/waves.png", 16, 16, {}, std::make_shared<Waves>(frequency)}; }
const Waves& source(const Texture& texture) { return static_cast<const Waves&>(*texture.source); }

Mesh cube(const char* path, int32_t material, float edge_length) {
  Mesh mesh;
  mesh.path = path;
  for (const float z : {-0.5f, 0.5f})
    for (const float y : {-0.5f, 0.5f})
      for (const float x : {-0.5f, 0.5f}) mesh.points.push_back({x, y, z});
  mesh.face_vertex_counts = {4, 4, 4, 4, 4, 4};
  mesh.face_vertex_indices = {0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5};
  std::vector<Vec2f> st;
  for (int face = 0; face < 6; ++face) st.insert(st.end(), {{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  mesh.texcoords = {{"st", Interpolation::FaceVarying, st, {}}};
  mesh.material = material;
  mesh.target_edge_length_world = edge_length;
  identify(mesh);
  return mesh;
}

Mesh floorOf(int32_t material) {
  Mesh mesh;
  mesh.path = "/floor";
  mesh.scheme = SubdivisionScheme::None;
  mesh.points = {{-4, -0.6f, 4}, {4, -0.6f, 4}, {4, -0.6f, -4}, {-4, -0.6f, -4}};
  mesh.face_vertex_counts = {4};
  mesh.face_vertex_indices = {0, 1, 2, 3};
  mesh.texcoords = {{"st", Interpolation::Vertex, {{0, 0}, {1, 0}, {1, 1}, {0, 1}}, {}}};
  mesh.material = material;
  identify(mesh);
  return mesh;
}

enum Materials { kPlain, kTextured, kBumpy, kMirror };
enum Textures { kColor, kHeight, kSky };
enum Meshes { kFloor, kSmooth, kDisplaced, kDefault };

PatternNode lookUp(int32_t texture) {
  PatternNode node;
  node.path = "/texture";
  node.texture = texture;
  return node;
}

class World {
 public:
  World() {
    scene.textures = {waves(0.37f), waves(0.11f), waves(0.05f)};
    scene.materials.resize(4);
    for (Material& material : scene.materials) material.path = "/material";
    scene.materials[kTextured].nodes = {lookUp(kColor)};
    scene.materials[kTextured].diffuse_color.node = 0;
    scene.materials[kBumpy].nodes = {lookUp(kHeight)};
    scene.materials[kBumpy].nodes[0].scale = {0.1f, 0.1f, 0.1f, 1};
    scene.materials[kBumpy].displacement.node = 0;
    scene.materials[kMirror].metallic.value = 1;
    scene.materials[kMirror].roughness.value = 0;
    place(floorOf(kTextured), {0, 0, 0});
    place(cube("/smooth", kPlain, 0.2f), {-1.2, 0, 0});
    place(cube("/displaced", kBumpy, 0.2f), {0, 0, 0});
    place(cube("/default", kMirror, 0), {1.2, 0, 0});
    Light sky, lamp;
    sky.kind = Light::Kind::Dome, sky.path = "/sky", sky.texture = kSky;
    lamp.kind = Light::Kind::Rect, lamp.path = "/lamp", lamp.centre = {0, 3, 1}, lamp.half_v = {0, 0, -0.5f};
    lamp.radiance = {6, 5, 4};
    scene.lights = {sky, lamp};
    scene.camera.path = "/camera";
    scene.camera.to_world.origin = {0, 0.6, 4.5};
    scene.camera.half_tangent = {0.5f, 0.5f * 26 / 40};
    settings.width = 40, settings.height = 26, settings.samples = 2, settings.reuse_tile_pixels = 32;
    settings.edge_length_scale = 4;
    settings.light_samples = 2, settings.occlusion_samples = 4, settings.threads = 1;
  }
  void place(Mesh mesh, Vec3d at) {
    scene.prototypes.push_back({mesh.path, {uint32_t(scene.meshes.size())}});
    Instance& instance = scene.instances.emplace_back();
    instance.path = mesh.path, instance.prototype = uint32_t(scene.prototypes.size() - 1);
    instance.to_world.origin = at;
    scene.meshes.push_back(std::move(mesh));
  }
  // As a delegate does: what is edited is another mesh.
  template <class Edit>
  void editMesh(uint32_t index, const Edit& edit) {
    edit(scene.meshes[index]);
    identify(scene.meshes[index]);
  }

  Scene scene;
  Settings settings;
};

template <class T>
bool same(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void expectSame(const Frame& a, const Frame& b) {
  ASSERT_EQ(a.layers, b.layers);
  for (size_t i = 0; i < a.layers.size(); ++i)
    EXPECT_TRUE(same(a.images.layers[i], b.images.layers[i])) << "layer " << i;
  EXPECT_TRUE(same(a.images.composite, b.images.composite));
  EXPECT_TRUE(same(a.images.alpha, b.images.alpha));
  EXPECT_TRUE(same(a.images.depth, b.images.depth));
  EXPECT_TRUE(same(a.images.normal, b.images.normal));
  EXPECT_EQ(a.statistics.primitives, b.statistics.primitives);
  EXPECT_EQ(a.statistics.micropolygons, b.statistics.micropolygons);
  EXPECT_EQ(a.statistics.rays_traced, b.statistics.rays_traced);
  EXPECT_EQ(a.statistics.warnings, b.statistics.warnings);
  for (const auto& [name, layer] : a.statistics.layers) {
    EXPECT_EQ(layer.shading_evaluations, b.statistics.layers.at(name).shading_evaluations) << name;
    EXPECT_EQ(layer.failed_samples, b.statistics.layers.at(name).failed_samples) << name;
  }
}

class RenderCacheTest : public testing::Test {
 protected:
  Frame cached() { return render(world.scene, world.settings, *device, {}, {}, &cache); }
  Frame fresh() { return render(world.scene, world.settings, *device); }

  // What an edit makes anew.
  struct Expected {
    uint64_t meshes = 0, prototypes = 0, programs = 0, textures = 0, light_images = 0;
  };
  Frame check(const std::string& edit, const Expected& expected) {
    SCOPED_TRACE(edit);
    Frame frame = cached();
    expectSame(frame, fresh());
    const RenderCache::Counts made = cache.made(), held = cache.held();
    EXPECT_EQ(made.meshes, expected.meshes);
    EXPECT_EQ(made.prototypes, expected.prototypes);
    EXPECT_EQ(made.programs, expected.programs);
    EXPECT_EQ(made.textures, expected.textures);
    EXPECT_EQ(made.light_images, expected.light_images);
    EXPECT_EQ(held.meshes, world.scene.meshes.size());
    EXPECT_EQ(held.prototypes, world.scene.prototypes.size());
    EXPECT_LE(held.textures, world.scene.textures.size());
    return frame;
  }

  World world;
  std::shared_ptr<Device> device = Device::create();
  RenderCache cache;
};

bool differs(const Frame& a, const Frame& b) { return !same(a.images.composite, b.images.composite); }

TEST_F(RenderCacheTest, EditsMakeAnewWhatTheyTouch) {
  Scene& scene = world.scene;
  Frame before = cached();
  expectSame(before, fresh());
  EXPECT_EQ(cache.made().meshes, 4u);
  EXPECT_EQ(cache.made().prototypes, 4u);
  EXPECT_GE(cache.made().programs, 2u);
  EXPECT_GE(cache.made().textures, 2u);
  EXPECT_EQ(cache.made().light_images, 1u);
  const auto edit = [&](const char* name, const Expected& expected, const std::function<void()>& apply) {
    apply();
    Frame frame = check(name, expected);
    EXPECT_TRUE(differs(frame, before)) << name << " changes nothing";
    before = std::move(frame);
  };
  const auto bend = [](Mesh& mesh) { mesh.points[7] = {0.9f, 0.8f, 0.6f}; };

  edit("light", {}, [&] { scene.lights[1].radiance = {2, 3, 9}; });
  EXPECT_EQ(cache.made().kernels, 0u);
  edit("material value", {}, [&] { scene.materials[kPlain].diffuse_color.value = {0.1f, 0.5f, 0.2f}; });
  edit("lookup", {}, [&] { scene.materials[kTextured].nodes[0].scale = {0.5f, 1, 1, 1}; });
  edit("added displacement", {1, 1}, [&] { scene.materials[kPlain].displacement.value = 0.1f; });
  edit("other displacement", {1, 1, 0, 1}, [&] { scene.materials[kBumpy].nodes[0].scale[0] = 0.3f; });
  edit("points", {1, 1}, [&] { world.editMesh(kSmooth, bend); });
  edit("added mesh", {1, 1}, [&] { world.place(cube("/added", kPlain, 0.2f), {0, 1, -1}); });
  edit("moved instance", {}, [&] { scene.instances[kSmooth].to_world.origin = {-1, 0.3, 0.2}; });
  edit("turned instance", {}, [&] {
    const double c = std::cos(0.4), s = std::sin(0.4);
    Affine3d& m = scene.instances[kDefault].to_world;
    m.ex = {c, 0, -s}, m.ez = {s, 0, c};
  });
  edit("camera", {}, [&] { scene.camera.to_world.origin = {0.2, 0.5, 4.2}; });
  edit("samples", {}, [&] { world.settings.samples = 3; });
  edit("edge length", {1, 1}, [&] { world.settings.edge_length_scale = 8; });
  edit("cut-out", {0, 1}, [&] {
    scene.materials[kMirror].opacity.value = 0.5f, scene.materials[kMirror].opacity_mode = OpacityMode::Presence;
  });
  edit("deforming mesh", {1, 1}, [&] {
    world.editMesh(kSmooth, [](Mesh& mesh) {
      std::vector<Vec3f> open = mesh.points.get(), shut = open;
      for (Vec3f& p : shut) p.y += 0.4f * p.x;
      mesh.motion_points = std::vector<std::vector<Vec3f>>{open, shut};
    });
  });
  // What deforms in an instance that moves has bounds of its own; the other one only gets keys.
  edit("moving instances", {0, 1}, [&] {
    for (const size_t i : {size_t{kSmooth}, size_t{kDefault}}) {
      Instance& instance = scene.instances[i];
      instance.motion = {instance.to_world, instance.to_world};
      instance.motion[1].origin.y += 0.3;
    }
  });
  edit("motion off", {1, 1}, [&] {
    world.editMesh(kSmooth, [](Mesh& mesh) { mesh.motion_points.clear(); });
    for (Instance& instance : scene.instances) instance.motion.clear();
  });
  edit("texture", {0, 0, 0, 1}, [&] { scene.textures[kColor] = waves(0.9f); });
  edit("texture of displacement", {1, 1, 0, 1}, [&] { scene.textures[kHeight] = waves(0.6f); });
  edit("texture of a light", {0, 0, 0, 0, 1}, [&] { scene.textures[kSky] = waves(0.2f); });
  edit("removed mesh", {}, [&] { scene.meshes.pop_back(), scene.prototypes.pop_back(), scene.instances.pop_back(); });
  edit("new program", {0, 0, 1}, [&] { scene.materials[kTextured].emissive_color.node = 0; });
}

TEST_F(RenderCacheTest, DoesNotGrow) {
  const auto bend = [&](int i) {
    world.editMesh(kSmooth, [&](Mesh& mesh) { mesh.points[7] = {0.5f + 0.02f * float(i), 0.5f, 0.5f}; });
    world.scene.textures[kColor] = waves(0.1f * float(i + 1));
    world.scene.textures[kSky] = waves(0.01f * float(i + 1));
    world.scene.materials[kTextured].diffuse_color.channel = i % 2;  // another program
    cached();
  };
  bend(0), bend(1);
  const RenderCache::Counts first = cache.held();
  const uint64_t bytes = device->allocatedBytes();
  for (int i = 2; i < 22; ++i) {
    bend(i);
    const RenderCache::Counts held = cache.held();
    ASSERT_EQ(held.meshes, first.meshes) << i;
    ASSERT_EQ(held.prototypes, first.prototypes) << i;
    ASSERT_EQ(held.programs, first.programs) << i;
    ASSERT_EQ(held.textures, first.textures) << i;
    ASSERT_EQ(held.light_images, first.light_images) << i;
    ASSERT_LE(held.kernels, first.kernels + 2) << i;
    ASSERT_EQ(device->allocatedBytes(), bytes) << i;
  }
}

// What a scene before has left is what read() would have given; who reports what was read hears of it.
TEST_F(RenderCacheTest, ReadsTexturesOnceAndSaysSo) {
  cached();
  std::vector<int> reads;
  for (const Texture& texture : world.scene.textures) reads.push_back(source(texture).reads);
  world.scene.lights[1].radiance = {1, 1, 1};
  cached();
  for (size_t i = 0; i < reads.size(); ++i) {
    EXPECT_GE(reads[i], 1) << i;
    EXPECT_EQ(source(world.scene.textures[i]).reads, reads[i]) << i;
  }
  EXPECT_EQ(source(world.scene.textures[kColor]).reuses, 1);
  EXPECT_EQ(source(world.scene.textures[kSky]).reuses, 1);
  EXPECT_EQ(source(world.scene.textures[kHeight]).reuses, 1) << "by the displaced mesh that is kept";
}

TEST_F(RenderCacheTest, WhatHasNoIdentityIsMadeAnew) {
  for (Mesh& mesh : world.scene.meshes) mesh.identity = nullptr;
  cached();
  expectSame(cached(), fresh());
  EXPECT_EQ(cache.made().meshes, 4u);
  EXPECT_EQ(cache.made().prototypes, 4u);
  EXPECT_EQ(cache.held().meshes, 0u);
  EXPECT_EQ(cache.held().prototypes, 0u);
}

std::string message(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

// Errors are those of a frame without; what was made before stays good.
TEST_F(RenderCacheTest, ErrorsAndCancellationLeaveItUsable) {
  expectSame(cached(), fresh());
  const uint64_t made = cached().statistics.micropolygons, cap_before = world.settings.max_micropolygons;
  for (const uint64_t cap : {made / 2, uint64_t{5}}) {
    world.settings.max_micropolygons = cap;
    const std::string error = message([&] { cached(); });
    EXPECT_EQ(error, message([&] { fresh(); }));
    EXPECT_NE(error.find("micropolygons"), std::string::npos) << error;
  }
  world.settings.max_micropolygons = cap_before;
  expectSame(cached(), fresh());

  world.editMesh(kSmooth, [](Mesh& mesh) { mesh.points[0] = {-0.8f, -0.5f, -0.5f}; });
  const Progress cancel = [](double, const char* stage) { return std::string(stage) != "render"; };
  EXPECT_NE(message([&] { render(world.scene, world.settings, *device, cancel, {}, &cache); }), "no error");
  EXPECT_EQ(cache.made().meshes, 1u);
  expectSame(cached(), fresh());
  EXPECT_EQ(cache.made().meshes, 0u) << "the cancelled frame has left it";
}

TEST_F(RenderCacheTest, CanBeAskedWhileAFrameIsRendered) {
  cached();
  const uint64_t held = cache.held().meshes;
  bool asked = false;
  std::string inside;
  const Progress ask = [&](double, const char*) {
    asked = cache.made().meshes <= held && cache.held().meshes == held && cache.device() == device;
    if (inside.empty()) inside = message([&] { cached(); });
    return true;
  };
  render(world.scene, world.settings, *device, ask, {}, &cache);
  EXPECT_TRUE(asked);
  EXPECT_NE(inside.find("from inside of another"), std::string::npos) << inside;
}

TEST_F(RenderCacheTest, AnotherDeviceMakesItsOwn) {
  const Frame first = cached();
  device = Device::create();
  expectSame(cached(), first);
  EXPECT_EQ(cache.made().meshes, 1u);  // the displaced one, which kernels have made
  EXPECT_GT(cache.made().kernels, 0u);
  EXPECT_GE(cache.made().textures, 1u);
  EXPECT_EQ(cache.device(), device);
}

// One mesh in two places of a scene, as handles allow.
TEST_F(RenderCacheTest, SharesAMeshWithinAScene) {
  Mesh again = world.scene.meshes[kSmooth];
  again.material = kMirror;
  world.place(again, {-0.4, 1, -0.5});
  cached();
  expectSame(cached(), fresh());
  EXPECT_EQ(cache.made().meshes, 0u);
  EXPECT_EQ(cache.held().meshes, 4u);
}

}  // namespace
}  // namespace encore
