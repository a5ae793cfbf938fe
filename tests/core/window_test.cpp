// Windows: every pixel has the bits that it has in any other window, and overscan goes on with the picture.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "core/render/whole_frame.h"
#include "core/scene/error.h"
#include "tests/core/render_scenes.h"

namespace encore {
namespace {

constexpr Window kImage{0, 0, 70, 45};

std::vector<Aov> someAovs() {
  using Kind = Aov::Kind;
  return {{Kind::Position, "P", "", 0},          {Kind::EyeNormal, "Neye", "", 0},    {Kind::PrimId, "primId", "", 0},
          {Kind::InstanceId, "instance", "", 0}, {Kind::ElementId, "element", "", 0}, {Kind::Primvar, "c", "ramp", 2}};
}

Scene sceneWithPrimvar() {
  Scene scene = everyLayer();
  scene.meshes[0].primvars = {
      {"ramp", Interpolation::Vertex, std::vector<Vec4f>{{0, 1, 2, 3}, {1, 0, 5, 1}, {3, 1, 0, 0}, {2, 2, 1, 1}}, {}}};
  return scene;
}

Settings quickFrame() {
  Settings settings = smallFrame();
  settings.samples = 2;
  settings.light_samples = 1;
  settings.occlusion_samples = 4;
  settings.aovs = someAovs();
  settings.debug_aovs = true;
  return settings;
}

Frame renderWindow(Scene& scene, Settings settings, Device& vulkan, Window window) {
  settings.window = window;
  Frame frame = render(scene, settings, vulkan);
  EXPECT_EQ(int32_t(frame.images.rect.width()), window.x1 - window.x0);
  EXPECT_EQ(int32_t(frame.images.rect.height()), window.y1 - window.y0);
  return frame;
}

// Calls visit(name, values of a, values of b, values per pixel) for every image of both.
template <class Visit>
void forEachImage(const FilmImages& a, const FilmImages& b, const Visit& visit) {
  for (size_t i = 0; i < a.layers.size(); ++i) visit("layer", a.layers[i], b.layers[i], 1);
  visit("composite", a.composite, b.composite, 1);
  visit("alpha", a.alpha, b.alpha, 1);
  visit("depth", a.depth, b.depth, 1);
  visit("normal", a.normal, b.normal, 1);
  for (size_t i = 0; i < a.debug.size(); ++i) {
    visit("evaluations", a.debug[i].evaluations, b.debug[i].evaluations, 1);
    visit("reshaded", a.debug[i].reshaded, b.debug[i].reshaded, 1);
    visit("distance", a.debug[i].distance, b.debug[i].distance, 1);
  }
  for (size_t i = 0; i < a.aovs.size(); ++i) {
    visit("values", a.aovs[i].values, b.aovs[i].values, a.aovs[i].values.empty() ? 0 : a.aovs[i].components);
    visit("ids", a.aovs[i].ids, b.aovs[i].ids, a.aovs[i].ids.empty() ? 0 : 1);
  }
}

// What both windows show is the same to the last bit.
void expectSameWhereTheyMeet(const FilmImages& a, Window wa, const FilmImages& b, Window wb, const std::string& what) {
  const Window both{std::max(wa.x0, wb.x0), std::max(wa.y0, wb.y0), std::min(wa.x1, wb.x1), std::min(wa.y1, wb.y1)};
  ASSERT_FALSE(both.empty());
  ASSERT_EQ(a.layers.size(), b.layers.size());
  ASSERT_EQ(a.aovs.size(), b.aovs.size());
  forEachImage(a, b, [&](const char* name, const auto& of_a, const auto& of_b, size_t values) {
    for (int32_t y = both.y0; y < both.y1 && values > 0; ++y) {
      const auto at = [&](const auto& image, Window w) {
        const size_t first = size_t(y - w.y0) * size_t(w.x1 - w.x0) + size_t(both.x0 - w.x0);
        return image.data() + first * values;
      };
      const size_t bytes = size_t(both.x1 - both.x0) * values * sizeof(of_a[0]);
      ASSERT_LE(size_t(y - wa.y0 + 1) * size_t(wa.x1 - wa.x0) * values, of_a.size()) << what << name;
      ASSERT_EQ(std::memcmp(at(of_a, wa), at(of_b, wb), bytes), 0) << what << ": " << name << ", row " << y;
    }
  });
}

struct Way {
  const char* name;
  void (*set)(Settings&);
};
const Way kWays[] = {
    {"reuse", [](Settings&) {}},
    {"small tiles, Mitchell",
     [](Settings& s) {
       s.reuse_tile_pixels = 16;
       s.filter = FilterKind::Mitchell;
       s.filter_radius_pixels = 2;
     }},
    {"wide filter, two threads",
     [](Settings& s) {
       s.reuse_tile_pixels = 48;
       s.filter = FilterKind::Gaussian;
       s.filter_radius_pixels = 8;
       s.threads = 2;
     }},
    {"reference, box",
     [](Settings& s) {
       s.method = Method::Reference;
       s.filter = FilterKind::Box;
       s.filter_radius_pixels = 0.5f;
       s.threads = 2;
     }},
    {"decoupled", [](Settings& s) { s.method = Method::Decoupled; }},
    {"vertex", [](Settings& s) { s.method = Method::Vertex; }},
};

TEST(Window, ACropIsAPartOfTheImageToTheLastBit) {
  const auto vulkan = device();
  Scene scene = sceneWithPrimvar();
  for (const Way& way : kWays) {
    Settings settings = quickFrame();
    way.set(settings);
    const Frame whole = render(scene, settings, *vulkan);
    settings.threads = 3 - settings.threads;
    for (const Window window : {Window{31, 5, 51, 33}, {66, 40, 70, 45}}) {
      const Frame part = renderWindow(scene, settings, *vulkan, window);
      expectSameWhereTheyMeet(whole.images, kImage, part.images, window, way.name);
      if (HasFatalFailure()) return;
      EXPECT_LT(part.statistics.antialiasing_samples, whole.statistics.antialiasing_samples);
    }
  }
}

TEST(Window, OverscanChangesNoPixelAndIsTheSameInEveryWindow) {
  const auto vulkan = device();
  const Window widest{-37, -20, 110, 70};
  for (const bool lens : {false, true}) {
    Scene scene = sceneWithPrimvar();
    scene.camera.lens_radius = lens ? 0.05f : 0;
    scene.camera.focus_distance = 6;
    Settings settings = quickFrame();
    settings.reuse_tile_pixels = lens ? 16 : 32;
    const Frame all = renderWindow(scene, settings, *vulkan, widest);
    for (const Window window : {kImage, Window{-37, 10, -1, 20}, {60, 40, 100, 70}, {20, -20, 21, -19}}) {
      const Frame part = renderWindow(scene, settings, *vulkan, window);
      expectSameWhereTheyMeet(all.images, widest, part.images, window, lens ? "lens" : "pinhole");
      if (HasFatalFailure()) return;
    }
  }
}

TEST(Window, TilesOfOverscanTogetherAreTheWindow) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  Settings settings = quickFrame();
  settings.aovs = {{Aov::Kind::PrimId, "id", "", 0}};
  const Window window{-20, -9, 101, 50};
  const Frame whole = renderWindow(scene, settings, *vulkan, window);
  settings.window = window;
  WholeFrame assembled(121, 59);
  std::vector<int> seen(121 * 59);
  PixelRect before{};
  render(scene, settings, *vulkan, {}, [&](FilmImages&& images) {
    const PixelRect r = images.rect;
    for (int32_t y = r.y0; y < r.y1; ++y)
      for (int32_t x = r.x0; x < r.x1; ++x) ++seen.at(size_t(y) * 121 + size_t(x));
    if (r.x0 > 0) {  // rows of one height
      EXPECT_EQ(r.x0, before.x1);
      EXPECT_EQ(r.y0, before.y0);
      EXPECT_EQ(r.y1, before.y1);
    }
    before = r;
    assembled.add(images);
  });
  for (const int count : seen) ASSERT_EQ(count, 1);
  expectSameWhereTheyMeet(whole.images, window, assembled.take(), window, "tiles");
}

double meanDifference(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
  double sum = 0, total = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    sum += std::abs(double(a[i].y) - double(b[i].y));
    total += double(a[i].y);
  }
  return sum / total;
}

// A larger image whose camera window is larger by as much shows the same.
TEST(Window, OverscanIsWhatALargerFilmWindowShows) {
  const auto vulkan = device();
  Scene scene = everyLayer();
  Settings settings = smallFrame();
  settings.occlusion_samples = 32;
  const Window window{-35, -30, 105, 75};
  const Frame overscan = renderWindow(scene, settings, *vulkan, window);
  settings.width = 140, settings.height = 105;
  scene.camera.half_tangent = {scene.camera.half_tangent.x * 2, scene.camera.half_tangent.y * 105 / 45};
  const Frame larger = render(scene, settings, *vulkan);
  const double difference = meanDifference(overscan.images.composite, larger.images.composite);
  EXPECT_LT(difference, 0.04);
  EXPECT_LT(meanDifference(overscan.images.normal, larger.images.normal), 0.05);
  std::vector<Vec3f> shifted(larger.images.composite.begin() + 4, larger.images.composite.end());
  shifted.resize(larger.images.composite.size());
  EXPECT_GT(meanDifference(overscan.images.composite, shifted), 2 * difference);
}

// Pixels twice as wide as high: the same camera window in half as many columns.
TEST(Window, PixelsNeedNotBeSquare) {
  const auto vulkan = device();
  for (const FootprintReuse footprint : {FootprintReuse::Ignore, FootprintReuse::Metric}) {
    Scene scene = everyLayer();
    scene.camera.lens_radius = 0.02f;
    scene.camera.focus_distance = 6;
    Settings settings = smallFrame();
    settings.occlusion_samples = 32;
    settings.footprint_reuse = footprint;
    settings.filter = FilterKind::Box;
    settings.filter_radius_pixels = 0.5f;
    settings.width = 140;
    settings.height = 90;
    const Frame square = render(scene, settings, *vulkan);
    settings.width = 70;
    const Frame wide = render(scene, settings, *vulkan);
    std::vector<Vec3f> pairs;
    for (size_t i = 0; i < square.images.composite.size(); i += 2)
      pairs.push_back((square.images.composite[i] + square.images.composite[i + 1]) * 0.5f);
    EXPECT_LT(meanDifference(pairs, wide.images.composite), 0.06);
  }
}

TEST(Window, BadOnesAreErrors) {
  const auto bad = [](Window window) {
    Settings settings;
    settings.window = window;
    try {
      settings.validate();
      ADD_FAILURE() << "no Error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::Setting);
      EXPECT_EQ(error.where(), "window");
    }
  };
  bad({5, 0, 5, 7});
  bad({5, 0, 4, 7});
  bad({0, 8, 5, 7});
  bad({-65537, 0, -65000, 7});
  bad({0, 0, 65537, 7});
  bad({0, 66000, 9, 66090});
  bad({-2147483647, 0, 2147483647, 9});
  Settings settings;
  settings.window = {-65536, 3, -65000, 4};
  settings.validate();
}

TEST(Window, BadAovsAreErrors) {
  const auto bad = [](std::vector<Aov> aovs) {
    Settings settings;
    settings.aovs = std::move(aovs);
    try {
      settings.validate();
      ADD_FAILURE() << "no Error";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::Setting);
      EXPECT_EQ(error.where(), "aovs");
    }
  };
  bad({{Aov::Kind::Position, "", "", 0}});
  bad({{Aov::Kind::Position, "P", "", 0}, {Aov::Kind::PrimId, "P", "", 0}});
  bad({{Aov::Kind::Primvar, "c", "", 3}});
  bad({{Aov::Kind::Primvar, "c", "ramp", 0}});
  bad({{Aov::Kind::Primvar, "c", "ramp", 5}});
  bad({{Aov::Kind(77), "c", "", 3}});
  std::vector<Aov> many;
  for (int i = 0; i < 65; ++i) many.push_back({Aov::Kind::PrimId, std::to_string(i), "", 0});
  bad(many);
}

}  // namespace
}  // namespace encore
