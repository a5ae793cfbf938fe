// Vertex shading against closed forms and against shading every sample.
#include "core/render/vertex_shading.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

#include "vertex_world.h"

namespace encore {
namespace {

using namespace test;

// Every sample shaded: the reference.
std::vector<Vec3f> referenceLayer(World& world, Layer layer, Batch& batch) {
  follow(world, layer, batch);
  std::vector<PathVertex> hits;
  for (const PathVertex& v : batch.vertices)
    if (v.hit.valid()) hits.push_back(v);
  std::vector<Vec3f> shaded(hits.size());
  const std::vector<uint32_t> ends{uint32_t(hits.size())};
  shade(world.context(), hits, ends, shaded);
  std::vector<Vec3f> radiance;
  size_t next = 0;
  for (const PathVertex& v : batch.vertices)
    radiance.push_back(v.hit.valid() ? v.throughput * shaded[next++] : v.throughput);
  return radiance;
}

double rmse(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += double(dot(a[i] - b[i], a[i] - b[i])) / 3;
  return std::sqrt(sum / double(a.size()));
}

double meanError(const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += double(length(a[i] - b[i]));
  return sum / double(a.size());
}

// A floor, a box that casts a shadow on it, and a mirror behind them; the camera looks down on it.
void addMirrorRoom(VertexWorld& world, double distance = 6) {
  DicedMesh floor;
  addQuad(floor, {-3, 0, 3}, {3, 0, 3}, {3, 0, -3}, {-3, 0, -3});
  DicedMesh mirror;
  addQuad(mirror, {-2, 0, -2}, {2, 0, -2}, {2, 2.5f, -2}, {-2, 2.5f, -2});
  const Affine3d place = test::translation({0, -1.5, -distance}) * test::rotation({0, 1, 0}, 0.4);
  world.stage.add(floor, kMatte, place);
  world.stage.add(mirror, kMirror, place);
  world.stage.add(test::box({-0.6f, 0, -0.8f}, {0.3f, 1, 0.1f}), kWhite, place);
  world.stage.scene.camera.half_tangent = {0.5f, 0.5f};
}

// ---- closed forms

TEST(VertexShading, AWhiteFurnaceIsExactlyOne) {
  VertexWorld world;
  world.stage.add(wall(-4, 0.7f), kWhite);
  world.stage.add(test::sphere(6, false), kWhite, test::translation({2, 1, -9}));
  world.stage.add(test::sphere(6, false), kWhite, test::translation({-2, -1, -9}));
  world.stage.scene.lights = {dome({1, 1, 1})};
  world.settings.dome_light_visible = true;
  for (const float rate : {0.05f, 0.9f, 7.0f}) {
    world.settings.shading_rate = rate;
    world.build();
    const Batch batch = film(world, 4);
    const auto shading = world.shading();
    size_t wrong = 0, on_surface = 0;
    for (const Vec3f r : shadeLayer(*shading, Layer::Direct, batch)) wrong += !(r == Vec3f{1, 1, 1});
    // The wall shadows the spheres' sky, so that only what lies before them is exact: the wall and the sky.
    const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Direct, batch);
    wrong = 0;
    for (size_t i = 0; i < radiance.size(); ++i) {
      if (batch.first[i].hit.valid() && batch.first[i].hit.instance != 0) continue;
      on_surface += batch.first[i].hit.valid();
      wrong += !(radiance[i] == Vec3f{1, 1, 1});
    }
    EXPECT_EQ(wrong, 0u) << rate;
    EXPECT_GT(on_surface, 100u);
  }
}

// Emission that is linear in (u, v), on a quad, a triangle and an L.
DicedMesh colored(DicedMesh mesh, Vec3f origin, Vec3f along_u, Vec3f along_v) {
  for (const Vec2f uv : mesh.uv) mesh.display_color.push_back(origin + (along_u * uv.x + along_v * uv.y));
  return mesh;
}

struct RampError {
  double inside = 0, anywhere = 0;  // largest
  size_t samples = 0;
};
// margin: in (u, v), to the borders of the L.
RampError rampError(DicedMesh mesh, float rate, double margin) {
  const Vec3f origin{0.2f, 1, 0.5f}, along_u{0.7f, -0.5f, 0}, along_v{0.1f, 0.3f, -0.4f};
  VertexWorld world;
  world.settings.shading_rate = rate;
  world.stage.add(colored(std::move(mesh), origin, along_u, along_v), kRamp, test::translation({-1, -1, -4}));
  world.build();
  const Batch batch = film(world, 4);
  const auto shading = world.shading();
  const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Direct, batch);
  RampError error;
  for (size_t i = 0; i < radiance.size(); ++i) {
    const Hit& hit = batch.first[i].hit;
    if (!hit.valid()) continue;
    const Vec2f uv = uvAt(world.stage.diced[0], {hit.triangle, hit.b1, hit.b2});
    const double off = double(length(radiance[i] - (origin + (along_u * uv.x + along_v * uv.y))));
    error.anywhere = std::max(error.anywhere, off);
    ++error.samples;
    const auto deep = [&](double x) { return x > margin && x < 1 - margin && std::abs(x - 0.5) > margin; };
    if (deep(double(uv.x)) && deep(double(uv.y))) error.inside = std::max(error.inside, off);
  }
  return error;
}

TEST(VertexShading, LinearRadianceIsReproduced) {
  for (const float rate : {0.01f, 0.3f, 4.0f}) {
    DicedMesh quad, triangle;
    addQuad(quad, {0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0});
    addTriangle(triangle, {0, 0, 0}, {2, 0, 0}, {0, 2, 0});
    for (const DicedMesh& mesh : {quad, triangle}) {
      const RampError error = rampError(mesh, rate, 0);
      EXPECT_LT(error.anywhere, 2e-6) << rate << " triangles " << mesh.triangleCount();
      EXPECT_GT(error.samples, 500u);
    }
  }
  // Vertices outside of a polygon stand at its border, so that only micropolygons there are off.
  const RampError error = rampError(diceMesh(concaveMesh(), 1, 1000), 4, 0.05);
  EXPECT_LT(error.inside, 2e-6);
  EXPECT_LT(error.anywhere, 0.05);
  EXPECT_GT(error.samples, 500u);
}

// ---- against shading every sample

TEST(VertexShading, ConvergesToTheReferenceInAllLayers) {
  VertexWorld world;
  addMirrorRoom(world);
  world.stage.add(test::box({0.2f, -1.2f, -3.5f}, {1.2f, -0.2f, -3.4f}), kGlass);
  world.stage.scene.materials[kGlass] = glass(1.0f);  // no chance where paths leave it, hence no noise
  world.stage.scene.lights = {sun({-0.5f, -1, -0.4f})};
  world.build();
  Batch batch = film(world, 4);
  for (const Layer layer : {Layer::Direct, Layer::Reflection, Layer::Refraction}) {
    const std::vector<Vec3f> truth = referenceLayer(world, layer, batch);
    const double size = meanError(truth, std::vector<Vec3f>(truth.size()));
    ASSERT_GT(size, 0.003);
    std::vector<double> errors;
    for (const float rate : {1.0f, 16.0f, 256.0f}) {
      world.settings.shading_rate = rate;
      const auto shading = world.shading();
      errors.push_back(meanError(shadeLayer(*shading, layer, batch), truth));
    }
    // Edges of shadows are blurred over a micropolygon: the error falls with its side.
    EXPECT_LT(errors[1], 0.7 * errors[0]) << layerName(layer);
    EXPECT_LT(errors[2], 0.7 * errors[1]) << layerName(layer);
    EXPECT_LT(errors[2], 0.05 * size) << layerName(layer);
  }
}

// With area lights every vertex has its own noise, and the mean is right.
TEST(VertexShading, SoftShadowsAreUnbiased) {
  VertexWorld world;
  addMirrorRoom(world);
  world.stage.scene.lights = {dome({0.5f, 0.7f, 1})};
  world.settings.shading_rate = 256;  // darkness where things touch is blurred over a micropolygon
  world.build();
  Batch batch = film(world, 4);
  const std::vector<Vec3f> truth = referenceLayer(world, Layer::Direct, batch);
  const auto shading = world.shading();
  const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Direct, batch);
  Vec3d sum, true_sum;
  for (size_t i = 0; i < truth.size(); ++i) sum += toDouble(radiance[i]), true_sum += toDouble(truth[i]);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(sum[c] / true_sum[c], 1, 0.01);
}

// ---- independence

TEST(VertexShading, RadianceDependsOnTheSampleOnly) {
  VertexWorld world;
  addMirrorRoom(world);
  world.stage.scene.lights = {dome({0.5f, 0.7f, 1}), sun({-0.5f, -1, -0.4f})};
  world.stage.scene.materials[kMirror].roughness = {0.2f};
  world.build();
  const Batch whole = film(world, 4);
  const auto layers = {Layer::Direct, Layer::Reflection};
  std::vector<std::vector<Vec3f>> expected;
  const auto shading = world.shading();
  for (const Layer layer : layers) expected.push_back(shadeLayer(*shading, layer, whole));
  const uint64_t direct = shading->evaluations(Layer::Direct), reflected = shading->evaluations(Layer::Reflection);
  ASSERT_GT(direct, 0u);
  ASSERT_GT(reflected, 0u);

  for (const int threads : {1, 2})
    for (const bool evict : {false, true}) {
      tbb::global_control control(tbb::global_control::max_allowed_parallelism, size_t(threads));
      const auto cut = world.shading();
      // Batches of three blocks from the last to the first, the layers of each in the other order.
      for (size_t end = whole.ends.size(); end > 0;) {
        const size_t first_block = end < 3 ? 0 : end - 3;
        const uint32_t begin = first_block ? whole.ends[first_block - 1] : 0;
        Batch part;
        part.first.assign(whole.first.begin() + begin, whole.first.begin() + whole.ends[end - 1]);
        for (size_t b = first_block; b < end; ++b) part.ends.push_back(whole.ends[b] - begin);
        for (const size_t layer : {1u, 0u}) {
          const std::vector<Vec3f> radiance = shadeLayer(*cut, Layer(layer), part);
          EXPECT_TRUE(std::equal(radiance.begin(), radiance.end(), expected[layer].begin() + begin));
        }
        if (evict) cut->evict();
        end = first_block;
      }
      if (evict) {
        EXPECT_GT(totalEvaluations(*cut), direct + reflected);
      } else {
        EXPECT_EQ(cut->evaluations(Layer::Direct), direct);
        EXPECT_EQ(cut->evaluations(Layer::Reflection), reflected);
      }
    }
}

// ---- places where faces can be

// A floor under the camera and behind it, to the horizon: the furnace stays exact, and the cost bounded.
TEST(VertexShading, VerticesBehindTheCamera) {
  for (const float height : {1.0f, 1e-3f}) {
    VertexWorld world;
    DicedMesh floor;
    addQuad(floor, {-5000, -height, 5000}, {5000, -height, 5000}, {5000, -height, -5000}, {-5000, -height, -5000});
    DicedMesh triangle;
    addTriangle(triangle, {-900, height, -900}, {900, height, -900}, {0, height, 900});
    world.stage.add(floor, kWhite);
    world.stage.add(triangle, kWhite);
    world.stage.scene.camera.half_tangent = {2, 2};
    world.settings.dome_light_visible = true;
    Light light = dome({1, 1, 1});
    world.stage.scene.lights = {light};
    world.build();
    const Batch batch = film(world, 4);
    const auto shading = world.shading();
    const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Direct, batch);
    for (size_t i = 0; i < radiance.size(); ++i) {
      EXPECT_TRUE(isFinite(radiance[i]));
      if (!batch.first[i].hit.valid()) {
        EXPECT_EQ(radiance[i].x, 1);
      }
    }
    EXPECT_LT(totalEvaluations(*shading), 10 * 32 * 32u);
  }
}

TEST(VertexShading, MirroredFloorBehindTheCamera) {
  VertexWorld world;
  DicedMesh floor;
  addQuad(floor, {-50, -1, 50}, {50, -1, 50}, {50, -1, -50}, {-50, -1, -50});
  world.stage.add(floor, kMirror);
  world.stage.scene.camera.half_tangent = {1, 1};
  world.stage.scene.lights = {dome({0.3f, 0.4f, 0.5f})};
  world.build();
  const Batch batch = film(world, 4);
  const auto shading = world.shading();
  const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Reflection, batch);
  size_t lit = 0;
  for (size_t i = 0; i < radiance.size(); ++i) {
    if (!batch.first[i].hit.valid()) continue;
    ++lit;
    EXPECT_NEAR(radiance[i].y, 0.4f, 1e-5f);
  }
  EXPECT_GT(lit, 1000u);
}

// Beyond the silhouette a visible face's vertices look away from the camera, and are lit as its visible side is:
// seen from the other one, they would lie in the dark inside of the body.
TEST(VertexShading, FacesKeepTheirSideAtSilhouettes) {
  for (const bool left_handed : {false, true}) {  // whether outside is the front or the back
    VertexWorld world;
    Mesh mesh = cube();
    mesh.left_handed = left_handed;
    world.stage.add(diceMesh(mesh, 0.02f, 1'000'000), kWhite, test::translation({0, 0, -5}));
    world.stage.scene.lights = {dome({1, 1, 1})};
    world.settings.shading_rate = 0.02f;
    world.build();
    const Batch batch = film(world, 4);
    const auto shading = world.shading();
    const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Direct, batch);
    size_t hits = 0;
    for (size_t i = 0; i < radiance.size(); ++i) {
      if (!batch.first[i].hit.valid()) continue;
      ++hits;
      EXPECT_EQ(batch.first[i].hit.instance, 0u);
      EXPECT_GT(radiance[i].x, 0.9f);  // but for what small facets hide of the sky
    }
    EXPECT_GT(hits, 300u);
  }
}

TEST(VertexShading, ALeafIsLitDifferentlyOnItsSides) {
  VertexWorld world;
  world.stage.add(wall(-4, 3), kWhite);
  DicedMesh turned;  // the same wall with its back to the camera
  addQuad(turned, {3, -3, -4}, {-3, -3, -4}, {-3, 3, -4}, {3, 3, -4});
  VertexWorld back;
  back.stage.add(turned, kWhite);
  for (VertexWorld* w : {&world, &back}) {
    w->stage.scene.lights = {sun({0, 0, -1})};
    w->build();
    const Batch batch = film(*w, 1);
    const auto shading = w->shading();
    for (const Vec3f r : shadeLayer(*shading, Layer::Direct, batch)) EXPECT_NEAR(r.x, 3 / kPi, 1e-5f);
  }
}

// Lights are seen at samples; what they hide keeps its radiance for micropolygons that show beside them.
TEST(VertexShading, VisibleLights) {
  VertexWorld world;
  world.stage.add(wall(-6, 3), kWhite);
  Light lamp;
  lamp.kind = Light::Kind::Sphere;
  lamp.centre = {0, 0, -3}, lamp.radius = 0.3f, lamp.radiance = {7, 7, 7};
  world.stage.scene.lights = {lamp, sun({0, 0, -1})};
  world.settings.lights_visible = true;
  world.settings.shading_rate = 0.05f;
  world.settings.light_samples = 64;
  world.build();
  Batch batch = film(world, 4);
  const std::vector<Vec3f> truth = referenceLayer(world, Layer::Direct, batch);
  const auto shading = world.shading();
  const std::vector<Vec3f> radiance = shadeLayer(*shading, Layer::Direct, batch);
  size_t seen = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    const bool light = truth[i].x == 7;
    seen += light;
    if (light) {
      EXPECT_EQ(radiance[i].x, 7);
    } else {
      EXPECT_NEAR(radiance[i].x, truth[i].x, 0.12f * truth[i].x);
    }
  }
  EXPECT_GT(seen, 50u);
  for (const Vec3f r : shadeLayer(*shading, Layer::Reflection, batch)) EXPECT_EQ(r, (Vec3f{0, 0, 0}));
}

// Scaled parameters and footprints are for reuse; here they change nothing.
TEST(VertexShading, ReuseControlsChangeNothing) {
  VertexWorld world;
  addMirrorRoom(world);
  world.stage.scene.lights = {sun({-0.5f, -1, -0.4f})};
  world.build();
  const Batch batch = film(world, 1);
  const std::vector<Vec3f> expected = shadeLayer(*world.shading(), Layer::Reflection, batch);
  world.settings.footprint_reuse = FootprintReuse::Octaves;
  world.settings.world_space_parameters = true;
  world.build();
  EXPECT_EQ(shadeLayer(*world.shading(), Layer::Reflection, batch), expected);
}

// Diced surfaces: grids of the method over the grids of the dicer.
TEST(VertexShading, SubdivisionSurfaces) {
  for (const SubdivisionScheme scheme : {SubdivisionScheme::CatmullClark, SubdivisionScheme::Loop}) {
    VertexWorld world;
    const Mesh mesh = scheme == SubdivisionScheme::Loop ? octahedron(scheme) : cube();
    world.stage.add(diceMesh(mesh, 0.05f, 1'000'000), kWhite, test::translation({0, 0, -6}));
    world.stage.scene.lights = {sun({-0.3f, -0.4f, -1})};
    world.build();
    Batch batch = film(world, 4);
    const std::vector<Vec3f> truth = referenceLayer(world, Layer::Direct, batch);
    const double size = rmse(truth, std::vector<Vec3f>(truth.size()));
    ASSERT_GT(size, 0.05);
    double last = 1e30;
    for (const float rate : {0.1f, 4.0f}) {
      world.settings.shading_rate = rate;
      const auto shading = world.shading();
      const double error = rmse(shadeLayer(*shading, Layer::Direct, batch), truth);
      EXPECT_LT(error, 0.5 * last);
      last = error;
    }
    EXPECT_LT(last, 0.03 * size);
  }
}

}  // namespace
}  // namespace encore
