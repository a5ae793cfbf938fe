#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <map>
#include <set>
#include <tuple>

#include "core/trace/trace_scene.h"
#include "moving_shapes.h"

namespace encore {
namespace {

using test::Stage;
using test::Stream;

constexpr int32_t kOpaque = 0, kGlass = 1;
const std::vector<uint8_t> kPasses{0, 1};

using Identity = std::tuple<uint32_t, uint32_t, uint32_t>;
Identity identityOf(const Hit& hit) { return {hit.instance, hit.mesh, hit.triangle}; }

// What a ray met, all waves together.
struct Way {
  bool occluded = false;
  std::vector<Hit> hits;
  uint32_t waves = 1;
};

std::vector<Way> follow(const TraceScene& trace, const std::vector<Ray>& rays,
                        const std::vector<const std::vector<uint8_t>*>& groups = {},
                        Coherence coherence = Coherence::Incoherent) {
  std::vector<ShadowHits> results(rays.size());
  trace.shadows(rays, {groups, false}, results, coherence);
  std::vector<Way> ways(rays.size());
  std::vector<uint32_t> left;
  for (uint32_t i = 0; i < rays.size(); ++i) left.push_back(i);
  while (!left.empty()) {
    std::vector<uint32_t> next;
    std::vector<Ray> next_rays;
    std::vector<const std::vector<uint8_t>*> next_groups;
    std::vector<ShadowHits> next_results;
    for (size_t k = 0; k < left.size(); ++k) {
      Way& way = ways[left[k]];
      way.occluded |= results[k].occluded;
      if (results[k].occluded) continue;
      way.hits.insert(way.hits.end(), results[k].hits.begin(), results[k].hits.begin() + results[k].count);
      if (!results[k].overflow) continue;
      ++way.waves;
      next.push_back(left[k]), next_rays.push_back(rays[left[k]]), next_results.push_back(results[k]);
      if (!groups.empty()) next_groups.push_back(groups[left[k]]);
    }
    left = next, results = next_results;
    trace.shadows(next_rays, {next_groups, true}, results, coherence);
  }
  return ways;
}

// The twin: every triangle at the ray's time, in double precision; hits in order, or one that is opaque.
struct TwinWay {
  bool occluded = false;
  std::vector<std::pair<double, Identity>> hits;
  double margin = 1;  // least distance of any barycentric coordinate, or t from the ray's ends, from its limit
};

TwinWay bruteForce(const Stage& stage, const Ray& ray, const std::vector<uint8_t>* casts) {
  TwinWay way;
  const Stage now = test::frozen(stage, ray.time);
  const Vec3d o = toDouble(ray.origin), d = toDouble(ray.direction);
  for (uint32_t i = 0; i < now.scene.instances.size(); ++i) {
    const Instance& instance = now.scene.instances[i];
    const Prototype& prototype = now.scene.prototypes[instance.prototype];
    for (uint32_t slot = 0; slot < prototype.meshes.size(); ++slot) {
      const DicedMesh& mesh = now.diced[prototype.meshes[slot]];
      const Mesh& source = now.scene.meshes[prototype.meshes[slot]];
      const uint32_t group = instance.link_group >= 0 ? uint32_t(instance.link_group) : source.link_group;
      if (casts && !(*casts)[group]) continue;
      for (uint32_t t = 0; t < mesh.triangleCount(); ++t) {
        const auto corner = [&](uint32_t k) {
          return instance.to_world.point(toDouble(mesh.positions[mesh.triangles[3 * t + k]]));
        };
        const Vec3d p0 = corner(0), e1 = corner(1) - p0, e2 = corner(2) - p0, n = cross(e1, e2);
        const double distance = dot(p0 - o, n) / dot(n, d);
        const Vec3d p = o + d * distance - p0;
        const double b1 = dot(cross(p, e2), n) / dot(n, n), b2 = dot(cross(e1, p), n) / dot(n, n);
        const double inside = std::min({b1, b2, 1 - b1 - b2});
        way.margin = std::min({way.margin, std::abs(inside), std::abs(distance - double(ray.tnear)),
                               std::abs(distance - double(ray.tfar))});
        if (inside < 0 || !(distance > ray.tnear && distance < ray.tfar)) continue;
        int32_t material = source.material;
        if (!source.face_materials.empty()) {
          const int32_t face = source.face_materials[mesh.primitive_face[mesh.triangle_primitive[t]]];
          if (face >= 0) material = face;
        }
        if (instance.material >= 0) material = instance.material;
        if (kPasses[size_t(material)])
          way.hits.push_back({distance, {i, slot, t}});
        else
          way.occluded = true;
      }
    }
  }
  std::sort(way.hits.begin(), way.hits.end());
  return way;
}

// Glass, but for a few faces, one instance and one mesh; three link groups.
Stage glassStage(uint32_t seed, bool moving) {
  Stage stage = moving ? test::movingStage(seed) : test::randomStage(seed);
  Stream stream(seed + 50);
  stage.scene.materials.resize(2);
  for (Mesh& mesh : stage.scene.meshes) mesh.material = kGlass;
  stage.scene.meshes[0].face_materials.resize(30, -1);
  stage.scene.meshes[0].face_materials[7] = kOpaque;
  stage.scene.meshes[1].material = kOpaque;
  stage.scene.meshes[1].face_materials.assign(20, kGlass);
  stage.scene.meshes[1].face_materials[3] = -1;
  stage.scene.meshes[0].link_group = 1;
  stage.scene.instances[2].link_group = 2, stage.scene.instances[5].link_group = 0;
  stage.scene.instances[3].material = kGlass, stage.scene.instances[4].material = kOpaque;
  for (int i = 0; i < 60; ++i) stage.addInstance(1, test::randomTransform(stream, i), kGlass);
  stage.scene.lights.resize(3);
  stage.scene.lights[1].shadow_groups = {1, 0, 1}, stage.scene.lights[2].shadow_groups = {0, 1, 0};
  return stage;
}

TEST(ShadowHits, AgreeWithBruteForce) {
  uint32_t compared = 0, occluded = 0, hit_count = 0, long_ways = 0;
  for (uint32_t seed = 1; seed <= 3; ++seed)
    for (const bool moving : {false, true}) {
      const Stage stage = glassStage(seed, moving);
      const TraceScene trace(stage.scene, stage.diced, false, kPasses);
      EXPECT_TRUE(trace.needsShadowHits());
      std::vector<Ray> rays = moving ? test::randomTimedRays(seed, 300) : test::randomRays(seed, 300);
      std::vector<const std::vector<uint8_t>*> groups;
      for (size_t i = 0; i < rays.size(); ++i) {
        rays[i].tnear = 0.5f, rays[i].tfar = 9;
        groups.push_back(i % 3 == 0 ? nullptr : &stage.scene.lights[i % 3].shadow_groups);
      }
      for (const Coherence coherence : {Coherence::Coherent, Coherence::Incoherent}) {
        const std::vector<Way> ways = follow(trace, rays, groups, coherence);
        for (size_t i = 0; i < rays.size(); ++i) {
          const TwinWay twin = bruteForce(stage, rays[i], groups[i]);
          if (twin.margin < 1e-5) continue;
          ++compared;
          ASSERT_EQ(ways[i].occluded, twin.occluded) << seed << " " << i;
          if (twin.occluded) {
            ++occluded;
            continue;
          }
          ASSERT_EQ(ways[i].hits.size(), twin.hits.size()) << seed << " " << i;
          for (size_t k = 0; k < twin.hits.size(); ++k, ++hit_count) {
            const Hit& hit = ways[i].hits[k];
            EXPECT_NEAR(hit.t, twin.hits[k].first, 1e-5);
            EXPECT_EQ(identityOf(hit), twin.hits[k].second);
            EXPECT_EQ(hit.time, rays[i].time);
          }
          long_ways += ways[i].waves > 1;
        }
      }
    }
  EXPECT_GT(compared, 2000u);
  EXPECT_GT(occluded, 150u);
  EXPECT_GT(hit_count, 2000u);
  EXPECT_GT(long_ways, 0u);
}

DicedMesh sheet(float z, uint32_t n) {
  DicedMesh mesh;
  const auto at = [&](uint32_t i, uint32_t j) {
    return Vec3f{float(i) * 2 / float(n) - 1, float(j) * 2 / float(n) - 1, z};
  };
  for (uint32_t j = 0; j < n; ++j)
    for (uint32_t i = 0; i < n; ++i) test::addQuad(mesh, at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
  return mesh;
}

// Rays that start at z = 5 and go to -z through points of the sheets: inside of triangles, on edges, on vertices.
std::vector<Ray> raysThroughEdges(uint32_t n, bool tilted) {
  Stream stream(17);
  std::vector<Ray> rays;
  for (int i = 0; i < 600; ++i) {
    const float cell = 2 / float(n);
    const float u = 1 + float(stream.index(std::max(1u, n - 2))), v = 1 + float(stream.index(std::max(1u, n - 2))),
                w = stream.next();
    Vec3f target{u * cell - 1, v * cell - 1, 0};               // a vertex
    if (i % 4 == 1) target.x += w * cell * 0.7f;               // an edge
    if (i % 4 == 2) target += Vec3f{w, w, 0} * (cell * 0.7f);  // the diagonal
    if (i % 4 == 3) target += Vec3f{stream.next() * cell * 0.7f, stream.next() * cell * 0.7f, 0};
    const Vec3f origin =
        tilted ? Vec3f{stream.next(-0.5f, 0.5f), stream.next(-0.5f, 0.5f), 5} : target + Vec3f{0, 0, 5};
    rays.push_back({origin, 0, normalize(target - origin), 10});
  }
  return rays;
}

// Twenty sheets, in meshes and instances of their own: every ray crosses each once, whatever it meets there.
TEST(ShadowHits, EverySheetCountsOnce) {
  for (const uint32_t n : {2u, 8u, 32u})
    for (const bool coincident : {false, true})
      for (const bool tilted : {false, true})
        for (const bool moving : {false, true}) {
          Stage stage;
          stage.scene.materials.resize(2);
          for (int i = 0; i < 20; ++i) {
            const float z = coincident ? 0.0f : 0.01f * float(i) - 0.1f;
            const uint32_t mesh = stage.addMesh(sheet(z, n), kGlass);
            // Every third prototype has two of them.
            if (i % 3 == 1)
              stage.scene.prototypes.back().meshes.push_back(mesh);
            else
              stage.addInstance(stage.addPrototype({mesh}));
          }
          if (moving)
            for (Instance& instance : stage.scene.instances)
              instance.motion = {test::translation({0, 0, 0}), test::translation({0, 0, -0.25})};
          const TraceScene trace(stage.scene, stage.diced, false, kPasses);
          std::vector<Ray> rays = raysThroughEdges(n, tilted);
          for (Ray& ray : rays) ray.time = moving ? 0.3f : 0;
          const std::vector<Way> ways = follow(trace, rays);
          for (size_t i = 0; i < rays.size(); ++i) {
            std::map<std::pair<uint32_t, uint32_t>, int> sheets;
            for (const Hit& hit : ways[i].hits) ++sheets[{hit.instance, hit.mesh}];
            ASSERT_EQ(sheets.size(), 20u) << n << coincident << tilted << " ray " << i;
            ASSERT_EQ(ways[i].hits.size(), 20u) << n << coincident << tilted << " ray " << i;
            EXPECT_GE(ways[i].waves, 3u);
            for (size_t k = 1; k < 20; ++k) EXPECT_LE(ways[i].hits[k - 1].t, ways[i].hits[k].t);
          }
        }
}

// Without resuming, from just behind the last hit: as exact, where no more than kRecordedHits are at one distance.
TEST(ShadowHits, RaysCanGoOnBehindTheLastHit) {
  Stage stage;
  stage.scene.materials.resize(2);
  for (int i = 0; i < 21; ++i) stage.add(sheet(-0.1f * float(i / 3), 4), kGlass);  // seven places of three
  const TraceScene trace(stage.scene, stage.diced, false, kPasses);
  for (Ray ray : raysThroughEdges(4, true)) {
    std::map<uint32_t, int> seen;
    ShadowHits result;
    uint32_t calls = 0;
    do {
      trace.shadows(std::span(&ray, 1), {}, std::span(&result, 1), Coherence::Incoherent);
      ASSERT_LE(++calls, 9u);
      for (uint32_t k = 0; k < result.count; ++k) ++seen[result.hits[k].instance];
      if (result.count > 0) ray.tnear = result.hits[result.count - 1].t;
    } while (result.overflow);
    EXPECT_EQ(seen.size(), 21u);
    for (const auto& [instance, times] : seen) EXPECT_EQ(times, 1);
  }
}

// A closed body is entered and left: twice, through its edges and corners as well.
TEST(ShadowHits, ClosedBodiesAreCrossedTwice) {
  Stage stage;
  stage.scene.materials.resize(2);
  stage.add(test::box({-1, -1, -1}, {1, 1, 1}), kGlass);
  DicedMesh round = test::sphere(24);
  for (Vec3f& p : round.positions)  // so that its six parts meet in the same numbers
    p = {std::round(p.x * 0x1p16f) * 0x1p-16f, std::round(p.y * 0x1p16f) * 0x1p-16f,
         std::round(p.z * 0x1p16f) * 0x1p-16f};
  stage.add(round, kGlass, test::translation({5, 0, 0}));
  const TraceScene trace(stage.scene, stage.diced, false, kPasses);
  std::vector<Ray> rays;
  Stream stream(4);
  const DicedMesh& ball = stage.diced[1];
  for (int i = 0; i < 400; ++i) {
    const uint32_t t = stream.index(uint32_t(ball.triangleCount()));
    const Vec3f a = ball.positions[ball.triangles[3 * t]], b = ball.positions[ball.triangles[3 * t + 1]];
    const Vec3f target = Vec3f{5, 0, 0} + (i % 2 ? a : a + (b - a) * stream.next());
    const Vec3f inside = Vec3f{5, 0, 0} + stream.inCube(0.3f), direction = normalize(inside - target);
    rays.push_back({target - direction * 2, 0, direction, 1e30f});
    const Vec3f corner{i % 2 ? 1.0f : -1.0f, i % 4 < 2 ? 1.0f : stream.next(-1, 1), i % 8 < 4 ? 1.0f : -1.0f};
    const Vec3f into = normalize(stream.inCube(0.3f) - corner);
    rays.push_back({corner - into * 2, 0, into, 5.5f});
  }
  const std::vector<Way> ways = follow(trace, rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    std::set<uint32_t> instances;
    for (const Hit& hit : ways[i].hits) instances.insert(hit.instance);
    EXPECT_EQ(ways[i].hits.size(), 2 * instances.size()) << i;
  }
}

// Silhouette: one face is met from outside, its neighbour from inside, at the same edge.
TEST(ShadowHits, ASilhouetteEdgeHasTwoSides) {
  DicedMesh roof;
  test::addTriangle(roof, {0, 0, 0}, {1, 0, -1}, {0, 1, 0});
  test::addTriangle(roof, {0, 0, 0}, {0, 1, 0}, {0.5f, 0, -1});
  Stage stage;
  stage.scene.materials.resize(2);
  stage.add(roof, kGlass);
  const TraceScene trace(stage.scene, stage.diced, false, kPasses);
  const std::vector<Way> ways = follow(trace, {{{0, 0.25f, 5}, 0, {0, 0, -1}, 10}});
  EXPECT_EQ(ways[0].hits.size(), 2u);
}

TEST(ShadowHits, GeometryThatNeedsNoneHasNoFilter) {
  Stage stage = glassStage(1, false);
  stage.scene.lights.clear();
  EXPECT_FALSE(TraceScene(stage.scene, stage.diced).needsShadowHits());
  const TraceScene trace(stage.scene, stage.diced, false, std::vector<uint8_t>{0, 0});
  EXPECT_FALSE(trace.needsShadowHits());
  std::vector<Ray> rays = test::randomRays(2, 300);
  std::vector<ShadowHits> results(rays.size());
  std::vector<uint8_t> occluded(rays.size());
  trace.shadows(rays, {}, results, Coherence::Incoherent);
  trace.occluded(rays, occluded, Coherence::Incoherent);
  for (size_t i = 0; i < rays.size(); ++i) EXPECT_EQ(results[i].occluded, occluded[i] != 0);
  // occluded() does not know materials, filters or not.
  const TraceScene glass(stage.scene, stage.diced, false, kPasses);
  std::vector<uint8_t> again(rays.size());
  glass.occluded(rays, again, Coherence::Incoherent);
  EXPECT_EQ(again, occluded);
}

// Light groups alone ask for filters too.
TEST(ShadowHits, LinkGroupsWithoutGlass) {
  Stage stage;
  stage.add(sheet(0, 2)), stage.add(sheet(1, 2));
  stage.scene.meshes[1].link_group = 1;
  stage.scene.lights.resize(1);
  EXPECT_FALSE(TraceScene(stage.scene, stage.diced).needsShadowHits());
  stage.scene.lights[0].shadow_groups = {1, 0};
  const TraceScene trace(stage.scene, stage.diced);
  EXPECT_TRUE(trace.needsShadowHits());
  const std::vector<uint8_t>& casts = stage.scene.lights[0].shadow_groups;
  const Ray through_both{{0.3f, 0.2f, 5}, 0, {0, 0, -1}, 10}, through_second{{0.3f, 0.2f, 5}, 0, {0, 0, -1}, 4.5f};
  const std::vector<Way> ways =
      follow(trace, {through_both, through_second, through_second}, {&casts, &casts, nullptr});
  EXPECT_TRUE(ways[0].occluded);
  EXPECT_FALSE(ways[1].occluded);
  EXPECT_TRUE(ways[1].hits.empty());
  EXPECT_TRUE(ways[2].occluded);
}

TEST(ShadowHits, ThreadsDoNotMatter) {
  const Stage stage = glassStage(2, true);
  const TraceScene trace(stage.scene, stage.diced, false, kPasses);
  const std::vector<Ray> rays = test::randomTimedRays(3, 400);
  const std::vector<Way> expected = follow(trace, rays);
  tbb::parallel_for(0, 16, [&](int) {
    const std::vector<Way> ways = follow(trace, rays);
    for (size_t i = 0; i < rays.size(); ++i) {
      EXPECT_EQ(ways[i].occluded, expected[i].occluded);
      ASSERT_EQ(ways[i].hits.size(), expected[i].hits.size());
      for (size_t k = 0; k < ways[i].hits.size(); ++k) EXPECT_EQ(ways[i].hits[k].t, expected[i].hits[k].t);
    }
  });
}

}  // namespace
}  // namespace encore
