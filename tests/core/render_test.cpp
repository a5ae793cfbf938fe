// The whole loop on a small scene of every layer, against its promises (design: rules that hold everywhere).
#include <gtest/gtest.h>

#include <cstdlib>

#include "core/render/whole_frame.h"
#include "core/scene/error.h"
#include "tests/core/render_scenes.h"

namespace encore {
namespace {

TEST(Render, CompositeIsTheSumOfItsLayersToTheLastBit) {
  Scene scene = everyLayer();
  const auto vulkan = device();
  const Frame frame = render(scene, smallFrame(), *vulkan);
  ASSERT_EQ(frame.layers.size(), 3u);
  for (size_t i = 0; i < frame.images.composite.size(); ++i) {
    Vec3f sum = frame.images.layers[0][i];
    for (size_t layer = 1; layer < 3; ++layer) sum = sum + frame.images.layers[layer][i];
    ASSERT_EQ(sum, frame.images.composite[i]) << "pixel " << i;
  }
  for (size_t layer = 0; layer < 3; ++layer) {
    double total = 0;
    for (const Vec3f c : frame.images.layers[layer]) total += c.y;
    EXPECT_GT(total, 1.0) << layerName(frame.layers[layer]);
  }
  EXPECT_EQ(frame.statistics.non_finite_samples, 0u);
}

// The budget in bytes that the error for a budget of one byte names.
uint64_t smallestBudget(Scene& scene, Settings settings, Device& vulkan) {
  settings.memory_budget_bytes = 1;
  try {
    render(scene, settings, vulkan);
  } catch (const Error& error) {
    const std::string& remedy = error.remedy();
    return std::stoull(remedy.substr(remedy.find_first_of("0123456789"))) << 20;
  }
  ADD_FAILURE() << "a budget of one byte was accepted";
  return 0;
}

// One way in which a frame can be rendered.
struct Control {
  const char* name;
  void (*set)(Scene&, Settings&);
};
const Control kControls[] = {
    {"plain ", [](Scene&, Settings&) {}},
    {"trees ", [](Scene&, Settings& s) { s.search = Search::Tree; }},
    {"groups ", [](Scene&, Settings& s) { s.search = Search::Groups; }},
    {"cells ", [](Scene&, Settings& s) { s.search = Search::Cells; }},
    {"metric ", [](Scene&, Settings& s) { s.footprint_reuse = FootprintReuse::Metric; }},
    {"octaves ", [](Scene&, Settings& s) { s.footprint_reuse = FootprintReuse::Octaves; }},
    {"limit ", [](Scene&, Settings& s) { s.max_reuse_distance = 1.5f; }},
    {"world space ", [](Scene&, Settings& s) { s.world_space_parameters = true; }},
    {"debug ", [](Scene&, Settings& s) { s.debug_aovs = true; }},
    {"rates ",
     [](Scene& scene, Settings& s) {
       scene.meshes[0].shading_rate = {0.5f, 4, 1};
       scene.instances[3].shading_rate = {8, 0, 0};
       s.shading_rate_refraction = 3;
       s.max_reuse_distance = 2;
     }},
    {"everything ",
     [](Scene& scene, Settings& s) {
       scene.meshes[0].shading_rate = {0.5f, 4, 1};
       s.footprint_reuse = FootprintReuse::Metric;
       s.max_reuse_distance = 2;
       s.world_space_parameters = true;
       s.debug_aovs = true;
     }},
    {"reference ", [](Scene&, Settings& s) { s.method = Method::Reference; }},
    {"decoupled ", [](Scene&, Settings& s) { s.method = Method::Decoupled; }},
    {"decoupled-pixel ", [](Scene&, Settings& s) { s.method = Method::DecoupledPixel; }},
    {"vertex ", [](Scene&, Settings& s) { s.method = Method::Vertex; }},
};

TEST(Render, DoesNotDependOnThreadsMemoryOrTheRun) {
  const auto vulkan = device();
  for (const Control& control : kControls) {
    Scene scene = everyLayer();
    Settings settings = smallFrame();
    control.set(scene, settings);
    settings.memory_budget_bytes = 4ull << 30;
    const Frame first = render(scene, settings, *vulkan);
    settings.threads = 2;
    settings.memory_budget_bytes = smallestBudget(scene, settings, *vulkan);
    expectSameImages(first, render(scene, settings, *vulkan), control.name);
  }
}

TEST(Render, EverySearchGivesTheSameImages) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  Settings settings = smallFrame();
  const Frame first = render(scene, settings, *vulkan);
  for (const Search search : {Search::Tree, Search::Groups, Search::Cells}) {
    settings.search = search;
    expectSameImages(first, render(scene, settings, *vulkan), "search " + std::to_string(int(search)) + " ");
  }
}

TEST(Render, EveryMethodTakesEveryKindOfFootprint) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  for (const Method method :
       {Method::Reuse, Method::Reference, Method::Decoupled, Method::DecoupledPixel, Method::Vertex}) {
    Settings settings = smallFrame();
    settings.method = method;
    const Frame first = render(scene, settings, *vulkan);
    for (const FootprintReuse kind : {FootprintReuse::Metric, FootprintReuse::Octaves}) {
      settings.footprint_reuse = kind;
      const Frame other = render(scene, settings, *vulkan);
      // Only reuse measures by footprints; octaves are parts of keys for all.
      if (method != Method::Reuse && kind == FootprintReuse::Metric)
        expectSameImages(first, other, "method " + std::to_string(int(method)) + " ");
    }
  }
}

TEST(Render, TilesTogetherAreTheWholeFrame) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  Settings settings = smallFrame();
  settings.debug_aovs = true;
  const Frame whole = render(scene, settings, *vulkan);
  Frame parts;
  std::vector<int> seen(size_t(settings.width) * settings.height);
  WholeFrame assembled(settings.width, settings.height);
  Frame rest = render(scene, settings, *vulkan, {}, [&](FilmImages&& images) {
    for (int32_t y = images.rect.y0; y < images.rect.y1; ++y)
      for (int32_t x = images.rect.x0; x < images.rect.x1; ++x) ++seen[size_t(y) * settings.width + size_t(x)];
    assembled.add(images);
  });
  EXPECT_TRUE(rest.images.composite.empty());
  for (const int count : seen) ASSERT_EQ(count, 1);
  parts.layers = rest.layers;
  parts.images = assembled.take();
  expectSameImages(whole, parts, "tiles ");
}

// Every surface gets the shades that it asks for, however its neighbours ask.
TEST(Render, SurfacesAreShadedAtTheirOwnRates) {
  const auto vulkan = device();
  const float asked[] = {0.25f, 1, 2, 8};
  Scene scene;
  scene.materials.resize(1);
  scene.materials[0].path = "/matte";
  scene.materials[0].ior.value = 1;
  for (int i = 0; i < 4; ++i) {
    place(scene, quad("/stripe", {float(i) - 2, -2, 0}, {1, 0, 0}, {0, 4, 0}, 0), {0, 0, 0});
    if (i < 2)
      scene.meshes.back().shading_rate = {asked[i], asked[i], asked[i]};
    else
      scene.instances.back().shading_rate = {asked[i], 0, 0};
  }
  scene.camera.to_world.origin = {0, 0, 5};
  scene.camera.half_tangent = {0.4f, 0.4f};  // exactly the four stripes
  Settings settings = smallFrame();
  settings.width = settings.height = 128;
  settings.debug_aovs = true;
  const Frame frame = render(scene, settings, *vulkan);
  double evaluations[4] = {};
  for (uint32_t y = 0; y < 128; ++y)
    for (uint32_t x = 0; x < 128; ++x) evaluations[x / 32] += frame.images.debug[0].evaluations[y * 128 + x];
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(evaluations[i] / (128 * 32) / asked[i], 1, 0.05) << asked[i];
}

TEST(Render, ALimitOfTheReuseDistanceTurnsFarReuseIntoFailures) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  Settings settings = smallFrame();
  const LayerStatistics free = render(scene, settings, *vulkan).statistics.layers.at("direct");
  settings.max_reuse_distance = 0.5f;
  const LayerStatistics limited = render(scene, settings, *vulkan).statistics.layers.at("direct");
  EXPECT_GT(limited.failed_samples, 2 * free.failed_samples);
  settings.max_reuse_distance = 1e6f;
  EXPECT_EQ(render(scene, settings, *vulkan).statistics.layers.at("direct").failed_samples, free.failed_samples);
}

// Without reuse between primitives the modified mapping shades each primitive of each pixel once (at rate 1).
TEST(Render, DecoupledSamplingShadesOncePerCell) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  Settings settings = smallFrame();
  settings.samples = 6;
  settings.shading_rate = 1;
  for (const Method method : {Method::Decoupled, Method::DecoupledPixel}) {
    settings.method = method;
    const Frame frame = render(scene, settings, *vulkan);
    const LayerStatistics& direct = frame.statistics.layers.at("direct");
    EXPECT_EQ(direct.failed_samples, direct.antialiasing_samples);
    EXPECT_GE(direct.shading_evaluations * 36, direct.antialiasing_samples);
    EXPECT_LT(direct.shading_evaluations * 15, direct.antialiasing_samples);
    EXPECT_EQ(direct.reshading_evaluations, 0u);
  }
}

TEST(Render, ReuseShadesLessThanReferenceAndCountsIt) {
  Scene scene = everyLayer();
  const auto vulkan = device();
  Settings settings = smallFrame();
  settings.samples = 6;
  const Frame reuse = render(scene, settings, *vulkan);
  settings.method = Method::Reference;
  const Frame reference = render(scene, settings, *vulkan);
  for (const auto& [name, layer] : reference.statistics.layers) {
    EXPECT_EQ(layer.shading_evaluations, layer.antialiasing_samples) << name;
    EXPECT_EQ(layer.reshading_evaluations, 0u) << name;
    const LayerStatistics& other = reuse.statistics.layers.at(name);
    EXPECT_EQ(other.antialiasing_samples, layer.antialiasing_samples) << name;
    EXPECT_LE(other.reshading_evaluations, other.failed_samples) << name;
    EXPECT_LT(other.shading_evaluations * 6, layer.shading_evaluations) << name;
  }
}

TEST(Render, MovingTheWholeSceneFarAwayChangesLittle) {
  Scene near = everyLayer(), far = everyLayer();
  const Vec3d offset{3e6, -2e6, 1e6};
  for (Instance& instance : far.instances) instance.to_world.origin = instance.to_world.origin + offset;
  for (Light& light : far.lights) light.centre = light.centre + offset;
  far.camera.to_world.origin = far.camera.to_world.origin + offset;
  const auto vulkan = device();
  const Frame a = render(near, smallFrame(), *vulkan), b = render(far, smallFrame(), *vulkan);
  double difference = 0, total = 0;
  for (size_t i = 0; i < a.images.composite.size(); ++i) {
    difference += std::abs(a.images.composite[i].y - b.images.composite[i].y);
    total += a.images.composite[i].y;
  }
  EXPECT_LT(difference, 1e-3 * total);
  // The scene is put back where it was.
  EXPECT_EQ(far.camera.to_world.origin, everyLayer().camera.to_world.origin + offset);
}

TEST(Render, ALayerThatNothingFeedsDoesNotExist) {
  Scene scene = everyLayer();
  for (Mesh& mesh : scene.meshes) mesh.material = 0;
  scene.materials[0].ior.value = 1.0f;  // no interface, so no reflection
  const auto vulkan = device();
  const Frame frame = render(scene, smallFrame(), *vulkan);
  ASSERT_EQ(frame.layers.size(), 1u);
  EXPECT_EQ(frame.layers[0], Layer::Direct);
}

TEST(Render, IsCancelledByItsProgress) {
  Scene scene = everyLayer();
  const auto vulkan = device();
  double last = 0;
  try {
    render(scene, smallFrame(), *vulkan, [&](double done, const char*) {
      EXPECT_GE(done, last);
      last = done;
      return done < 0.3;
    });
    FAIL() << "it went on";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Cancelled);
  }
  EXPECT_GE(last, 0.3);
}

}  // namespace
}  // namespace encore
