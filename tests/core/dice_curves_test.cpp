// Tubes and ribbons, against curves that are evaluated slowly.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>
#include <set>
#include <string>

#include "core/dice/curves.h"
#include "core/dice/dice.h"
#include "core/dice/edge_length.h"
#include "core/scene/curve_counts.h"
#include "core/scene/error.h"
#include "tests/core/twins/curves_twin.h"

namespace encore {
namespace {

using Basis = CurveBasis;
using Wrap = CurveWrap;
constexpr uint64_t kNoCap = 1u << 30;

constexpr Basis kBases[] = {Basis::Linear, Basis::Bezier, Basis::BSpline, Basis::CatmullRom};
constexpr Wrap kWraps[] = {Wrap::Nonperiodic, Wrap::Periodic, Wrap::Pinned};

Mesh curves(Basis basis, Wrap wrap, std::vector<int32_t> counts, float width = 0.2f) {
  Mesh mesh;
  mesh.path = "/curves";
  mesh.shape = Shape::Curves;
  mesh.basis = basis, mesh.wrap = wrap;
  std::mt19937 random(7);
  std::uniform_real_distribution<float> off(-0.3f, 0.3f);
  float z = 0;
  for (const int32_t count : counts) {
    for (int32_t i = 0; i < count; ++i) {
      const float angle = 6.2831853f * float(i) / float(count) * (wrap == Wrap::Periodic ? 1.0f : 0.7f);
      mesh.points.push_back({4 * std::cos(angle) + off(random), 4 * std::sin(angle) + off(random), z + off(random)});
    }
    z += 3;
  }
  mesh.face_vertex_counts = std::move(counts);
  mesh.widths.values = {width};
  return mesh;
}

int32_t usualCount(Basis basis, Wrap wrap) {
  if (basis == Basis::Bezier) return wrap == Wrap::Periodic ? 9 : 10;
  return 8;
}

twin::CurveTwin twinOf(const Mesh& mesh, size_t curve, size_t pose = 0) {
  const std::vector<Vec3f>& from = pose == 0 ? mesh.points.get() : mesh.motion_points[pose - 1];
  size_t first = 0;
  for (size_t i = 0; i < curve; ++i) first += size_t(mesh.face_vertex_counts.get()[i]);
  std::vector<Vec3d> points;
  for (int32_t i = 0; i < mesh.face_vertex_counts.get()[curve]; ++i)
    points.push_back(toDouble(from[first + size_t(i)]));
  return {std::move(points), mesh.basis, mesh.wrap};
}

// Calls check(vertex, curve) for every vertex that a triangle has.
void forEachVertex(const DicedMesh& diced, const std::function<void(size_t, size_t)>& check) {
  std::set<std::pair<uint32_t, uint32_t>> seen;
  for (size_t i = 0; i < diced.triangles.size(); ++i)
    seen.insert({diced.triangles[i], diced.triangle_primitive[i / 3]});
  for (const auto& [vertex, curve] : seen) check(vertex, curve);
}

// Largest ratio of a regular polygon's radius to that of the circle of its mean width.
double mostRing() { return kPi / (3 * std::sin(double(kPi) / 3)); }

std::string messageOf(const Mesh& mesh) {
  try {
    validateMesh(mesh, 1);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(CurveCounts, AreThoseOfUsdGeomBasisCurves) {
  struct Row {
    Basis basis;
    Wrap wrap;
    std::vector<std::pair<int32_t, int32_t>> segments;  // of counts
    std::vector<int32_t> wrong;
  };
  const Row rows[] = {
      {Basis::Linear, Wrap::Nonperiodic, {{2, 1}, {3, 2}, {5, 4}}, {-1, 0, 1}},
      {Basis::Linear, Wrap::Periodic, {{3, 3}, {7, 7}}, {0, 1, 2}},
      {Basis::Linear, Wrap::Pinned, {{2, 1}, {6, 5}}, {0, 1}},
      {Basis::Bezier, Wrap::Nonperiodic, {{4, 1}, {7, 2}, {10, 3}}, {0, 1, 2, 3, 5, 6, 8}},
      {Basis::Bezier, Wrap::Periodic, {{3, 1}, {6, 2}, {9, 3}}, {0, 1, 2, 4, 7}},
      {Basis::Bezier, Wrap::Pinned, {{4, 1}, {7, 2}}, {2, 3, 5}},
      {Basis::BSpline, Wrap::Nonperiodic, {{4, 1}, {5, 2}, {6, 3}, {7, 4}}, {0, 1, 2, 3}},
      {Basis::BSpline, Wrap::Periodic, {{1, 1}, {3, 3}, {8, 8}}, {-3, 0}},
      {Basis::BSpline, Wrap::Pinned, {{2, 1}, {3, 2}, {9, 8}}, {0, 1}},
      {Basis::CatmullRom, Wrap::Nonperiodic, {{4, 1}, {5, 2}, {9, 6}}, {0, 2, 3}},
      {Basis::CatmullRom, Wrap::Periodic, {{3, 3}, {4, 4}}, {0}},
      {Basis::CatmullRom, Wrap::Pinned, {{2, 1}, {4, 3}}, {0, 1}},
  };
  for (const Row& row : rows) {
    Mesh mesh;
    mesh.shape = Shape::Curves, mesh.basis = row.basis, mesh.wrap = row.wrap;
    for (const auto& [count, segments] : row.segments) {
      ASSERT_TRUE(isCurveCount(mesh, count)) << int(row.basis) << int(row.wrap) << ' ' << count;
      EXPECT_EQ(segmentCount(mesh, count), segments) << int(row.basis) << int(row.wrap) << ' ' << count;
      EXPECT_EQ(varyingCount(mesh, count), segments + (row.wrap == Wrap::Periodic ? 0 : 1));
    }
    for (const int32_t count : row.wrong) EXPECT_FALSE(isCurveCount(mesh, count)) << int(row.basis) << ' ' << count;
  }
}

TEST(Curves, OfEveryBasisAndWrapAreTubesAroundTheirCurve) {
  for (const Basis basis : kBases)
    for (const Wrap wrap : kWraps) {
      const int32_t count = usualCount(basis, wrap);
      const Mesh mesh = curves(basis, wrap, {count, count});
      validateMesh(mesh, 1);
      const float edge = 0.15f;
      const DicedMesh diced = diceMesh(mesh, edge, kNoCap);
      ASSERT_EQ(diced.primitiveCount(), 2u);
      const twin::CurveTwin twins[] = {twinOf(mesh, 0), twinOf(mesh, 1)};
      ASSERT_EQ(int32_t(twins[0].segments()), segmentCount(mesh, count));
      const bool smooth = basis == Basis::BSpline || basis == Basis::CatmullRom;
      forEachVertex(diced, [&](size_t vertex, size_t curve) {
        const double u = diced.uv[vertex].x;
        const Vec3d offset = toDouble(diced.positions[vertex]) - twins[curve].at(u);
        const double ring = length(offset) / 0.1;
        EXPECT_GT(ring, 1.0 - 1e-4);
        EXPECT_LT(ring, smooth ? mostRing() : 2 * mostRing());  // corners are mitred
        if (!smooth) return;
        EXPECT_NEAR(dot(normalize(offset), twins[curve].direction(u)), 0, 1e-3);
        EXPECT_NEAR(dot(normalize(offset), toDouble(diced.normals[vertex])), 1, 1e-4);
      });
    }
}

// Between vertices: the polyline of ring centres stays near the curve.
TEST(Curves, LeaveTheirCurveByAnEighthOfTheEdgeLength) {
  for (const Basis basis : kBases) {
    const Mesh mesh = curves(basis, Wrap::Nonperiodic, {usualCount(basis, Wrap::Nonperiodic)}, 0.001f);
    const twin::CurveTwin twin = twinOf(mesh, 0);
    for (const float edge : {0.4f, 0.05f}) {
      const DicedMesh diced = diceMesh(mesh, edge, kNoCap);
      std::set<double> rows;
      for (const Vec2f uv : diced.uv) rows.insert(uv.x);
      double before = 0, most = 0;
      for (const double u : rows) {
        const double middle = (before + u) / 2;
        most = std::max(most, length(twin.at(middle) - (twin.at(before) + twin.at(u)) / 2.0));
        before = u;
      }
      EXPECT_LT(most, edge / 8 * 1.0001) << int(basis);
      // Hair is cheap: three sides, and rows only where it bends.
      EXPECT_EQ(diced.uv[1].y, 1.0f / 3);
    }
  }
}

TEST(Curves, OfHairAreCheapAndOfCloseUpTubesRound) {
  Mesh mesh = curves(Basis::CatmullRom, Wrap::Pinned, {8}, 0.001f);
  const uint64_t hair = diceMesh(mesh, 0.5f, kNoCap).micropolygons;
  EXPECT_LE(hair, 7u * 3 * 3);
  EXPECT_GE(hair, 7u * 3);
  mesh.widths.values = {2};
  const DicedMesh tube = diceMesh(mesh, 0.1f, kNoCap);
  EXPECT_EQ(tube.uv[1].y, 1.0f / CurveDicer::kMostAround);
  EXPECT_EQ(diceMesh(mesh, std::numeric_limits<float>::infinity(), kNoCap).micropolygons, 7u * 3);
}

TEST(Curves, AreAsWideAsTheirWidthsOnAverage) {
  // Crofton: the mean width of a convex polygon is its circumference over pi.
  for (const float edge : {10.0f, 0.2f, 0.1f}) {
    Mesh mesh = curves(Basis::Linear, Wrap::Nonperiodic, {2}, 0.2f);
    mesh.points = {{0, 0, 0}, {0, 0, 1}};
    const DicedMesh diced = diceMesh(mesh, edge, kNoCap);
    double around = 0;
    for (size_t i = 1; i < diced.positions.size() && diced.uv[i].x == 0; ++i)
      around += length(toDouble(diced.positions[i]) - toDouble(diced.positions[i - 1]));
    EXPECT_NEAR(around / double(kPi), 0.2, 1e-6) << edge;
  }
}

TEST(Curves, FaceOutwards) {
  for (const Basis basis : kBases)
    for (const Wrap wrap : kWraps) {
      const Mesh mesh = curves(basis, wrap, {usualCount(basis, wrap)});
      const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
      for (size_t i = 0; i < diced.triangleCount(); ++i) {
        const uint32_t* v = &diced.triangles[3 * i];
        const Vec3d p = toDouble(diced.positions[v[0]]);
        const Vec3d n = cross(toDouble(diced.positions[v[1]]) - p, toDouble(diced.positions[v[2]]) - p);
        const Vec3d mean =
            toDouble(diced.normals[v[0]]) + toDouble(diced.normals[v[1]]) + toDouble(diced.normals[v[2]]);
        EXPECT_GT(dot(normalize(n), normalize(mean)), 0.5) << int(basis) << int(wrap) << ' ' << i;
      }
    }
}

// Every edge inside of a closed tube has two triangles, wherever its seams are.
TEST(Curves, ThatCloseHaveNoHoleAndNoTwist) {
  for (const Basis basis : kBases) {
    const Mesh mesh = curves(basis, Wrap::Periodic, {usualCount(basis, Wrap::Periodic)});
    const DicedMesh diced = diceMesh(mesh, 0.2f, kNoCap);
    using Place = std::array<float, 3>;
    std::map<std::pair<Place, Place>, int> uses;
    const auto place = [&](uint32_t vertex) {
      const Vec3f p = diced.positions[vertex];
      return Place{p.x, p.y, p.z};
    };
    for (size_t i = 0; i < diced.triangles.size(); ++i) {
      const size_t next = i % 3 == 2 ? i - 2 : i + 1;
      ++uses[std::minmax(place(diced.triangles[i]), place(diced.triangles[next]))];
    }
    for (const auto& [edge, count] : uses) EXPECT_EQ(count, 2) << int(basis);
    // The last ring is the first one.
    const size_t around = diced.micropolygons == 0 ? 0 : size_t(std::lround(1 / diced.uv[1].y)) + 1;
    for (size_t k = 0; k < around; ++k)
      EXPECT_EQ(diced.positions[k], diced.positions[diced.positions.size() - around + k]) << int(basis);
  }
}

// A helix turns about its axis, and still its rings must hardly turn about the curve from one to the next.
TEST(Curves, TurnAsLittleAsTheyCan) {
  Mesh mesh = curves(Basis::CatmullRom, Wrap::Pinned, {40});
  std::vector<Vec3f> helix;
  for (int i = 0; i < 40; ++i) helix.push_back({std::cos(0.4f * float(i)), std::sin(0.4f * float(i)), 0.1f * float(i)});
  mesh.points = helix;
  const DicedMesh diced = diceMesh(mesh, 0.05f, kNoCap);
  const twin::CurveTwin twin = twinOf(mesh, 0);
  const size_t around = size_t(std::lround(1 / diced.uv[1].y)) + 1;
  double most = 0;
  for (size_t row = 1; row * around < diced.positions.size(); ++row) {
    const Vec3d a = toDouble(diced.normals[(row - 1) * around]), b = toDouble(diced.normals[row * around]);
    const double u0 = diced.uv[(row - 1) * around].x, u1 = diced.uv[row * around].x;
    const Vec3d t = normalize(twin.direction(u0) + twin.direction(u1));
    most = std::max(most, std::abs(dot(cross(a, b), t)));
  }
  EXPECT_LT(most, 1e-4);
}

TEST(Curves, KeepTheirWidthAroundCornersAndTheirNormalsOnBothSides) {
  Mesh mesh = curves(Basis::Linear, Wrap::Nonperiodic, {3});
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}};
  const DicedMesh diced = diceMesh(mesh, 0.05f, kNoCap);
  const double ring = diced.micropolygons ? length(toDouble(diced.positions[0])) : 0;
  forEachVertex(diced, [&](size_t vertex, size_t) {
    const Vec3d p = toDouble(diced.positions[vertex]), n = toDouble(diced.normals[vertex]);
    const bool first = std::abs(n.x) < 1e-6;  // of the segment along x
    const bool second = std::abs(n.y) < 1e-6;
    EXPECT_TRUE(first || second);
    if (first && diced.uv[vertex].x <= 0.5f) {
      EXPECT_NEAR(std::hypot(p.y, p.z), ring, 1e-6);
    }
    if (second && diced.uv[vertex].x >= 0.5f) {
      EXPECT_NEAR(std::hypot(p.x - 1, p.z), ring, 1e-6);
    }
  });
}

TEST(Curves, TaperToAPointWithNormalsOfACone) {
  Mesh mesh = curves(Basis::Linear, Wrap::Nonperiodic, {2});
  mesh.points = {{0, 0, 0}, {0, 0, 2}};
  mesh.widths.interpolation = Interpolation::Varying;
  mesh.widths.values = {2, 0};
  const DicedMesh diced = diceMesh(mesh, 0.1f, kNoCap);
  const double slant = std::sqrt(5.0);
  forEachVertex(diced, [&](size_t vertex, size_t) {
    EXPECT_NEAR(diced.normals[vertex].z, 1 / slant, 1e-6);
    EXPECT_NEAR(length(toDouble(diced.normals[vertex])), 1, 1e-6);
    if (diced.uv[vertex].x == 1) {
      EXPECT_EQ(diced.positions[vertex], (Vec3f{0, 0, 2}));
    }
  });
  for (size_t i = 0; i < diced.triangleCount(); ++i) {
    const uint32_t* v = &diced.triangles[3 * i];
    const Vec3d p = toDouble(diced.positions[v[0]]);
    EXPECT_GT(length(cross(toDouble(diced.positions[v[1]]) - p, toDouble(diced.positions[v[2]]) - p)), 0);
  }
}

TEST(Curves, HaveWidthsOfEveryInterpolation) {
  const auto radiusAt = [](const DicedMesh& diced, const Mesh& mesh, size_t curve, double u) {
    double radius = -1;
    const twin::CurveTwin twin = twinOf(mesh, curve);
    forEachVertex(diced, [&](size_t vertex, size_t of) {
      if (of == curve && std::abs(diced.uv[vertex].x - u) < 1e-6)
        radius = length(toDouble(diced.positions[vertex]) - twin.at(u));
    });
    return radius;
  };
  Mesh mesh = curves(Basis::BSpline, Wrap::Nonperiodic, {5, 6});  // 2 and 3 segments
  const double ring = kPi / (CurveDicer::kMostAround * std::sin(double(kPi) / CurveDicer::kMostAround));
  const auto expect = [&](size_t curve, double u, double width) {
    validateMesh(mesh, 1);
    EXPECT_NEAR(radiusAt(diceMesh(mesh, 0.02f, kNoCap), mesh, curve, u), ring * width / 2, 1e-5) << u;
  };
  mesh.widths = {};
  expect(0, 0, 1);
  mesh.widths.interpolation = Interpolation::Uniform, mesh.widths.values = {0.5f, 0.25f};
  expect(0, 1, 0.5), expect(1, 0, 0.25);
  mesh.widths.interpolation = Interpolation::Varying, mesh.widths.values = {1, 2, 1, 0.5f, 1, 2, 3};
  expect(0, 0, 1), expect(0, 0.5, 2), expect(1, 1, 3);
  mesh.widths.interpolation = Interpolation::Vertex, mesh.widths.values = {0, 6, 0, 0, 0, 1, 1, 1, 1, 1, 1};
  expect(0, 0, 4), expect(0, 0.5, 1), expect(1, 0.5, 1);
}

TEST(Curves, HavePrimvarsOfEveryInterpolation) {
  Mesh mesh = curves(Basis::BSpline, Wrap::Nonperiodic, {5, 6});
  mesh.texcoords.resize(2), mesh.primvars.resize(1);
  mesh.texcoords[0] = {"varying", Interpolation::Varying, {{0, 0}, {1, 2}, {4, 4}, {5, 5}, {6, 6}, {7, 7}, {8, 8}}, {}};
  mesh.texcoords[1] = {"indexed", Interpolation::Uniform, {{1, 2}, {3, 4}}, {1, 0}};
  mesh.display_color = {"displayColor", Interpolation::Vertex, std::vector<Vec3f>(11), {}};
  for (size_t i = 0; i < 11; ++i) mesh.display_color.values[i] = mesh.points[i];
  mesh.primvars[0] = {"constant", Interpolation::Constant, {{1, 2, 3, 4}}, {}};
  validateMesh(mesh, 1);
  const DicedMesh diced = diceMesh(mesh, 0.1f, kNoCap);
  const twin::CurveTwin twins[] = {twinOf(mesh, 0), twinOf(mesh, 1)};
  forEachVertex(diced, [&](size_t vertex, size_t curve) {
    const double u = diced.uv[vertex].x;
    const double value = curve == 1 ? 5 + 3 * u : u < 0.5 ? 2 * u : 1 + 3 * (2 * u - 1);
    EXPECT_NEAR(diced.texcoords[0][vertex].x, value, 1e-5);
    EXPECT_EQ(diced.texcoords[1][vertex], (curve == 0 ? Vec2f{3, 4} : Vec2f{1, 2}));
    EXPECT_LT(length(toDouble(diced.display_color[vertex]) - twins[curve].at(u)), 1e-5);
    EXPECT_EQ(diced.primvars[0][vertex], (Vec4f{1, 2, 3, 4}));
  });
}

TEST(Curves, WithNormalsAreRibbons) {
  for (const Basis basis : kBases) {
    Mesh mesh = curves(basis, Wrap::Nonperiodic, {usualCount(basis, Wrap::Nonperiodic)});
    mesh.normals.values = {{0, 0, 2}};
    validateMesh(mesh, 1);
    const DicedMesh diced = diceMesh(mesh, 0.1f, kNoCap);
    const twin::CurveTwin twin = twinOf(mesh, 0);
    const bool smooth = basis == Basis::BSpline || basis == Basis::CatmullRom;
    forEachVertex(diced, [&](size_t vertex, size_t) {
      const double u = diced.uv[vertex].x;
      const Vec3d offset = toDouble(diced.positions[vertex]) - twin.at(u), t = twin.direction(u);
      EXPECT_NEAR(offset.z, 0, 1e-5);
      EXPECT_TRUE(diced.uv[vertex].y == 0 || diced.uv[vertex].y == 1);
      if (!smooth) return;
      EXPECT_NEAR(length(offset), 0.1, 1e-5);
      const Vec3d expected = normalize(Vec3d{0, 0, 1} - t * t.z);
      EXPECT_GT(dot(toDouble(diced.normals[vertex]), expected), 1 - 1e-5);
      // Seen from the side of the normal, v runs to the left of the curve.
      EXPECT_GT(dot(offset, cross(expected, t)) * (diced.uv[vertex].y == 0 ? -1 : 1), 0.09);
    });
    for (size_t i = 0; i < diced.triangleCount(); ++i) {
      const uint32_t* v = &diced.triangles[3 * i];
      const Vec3f p = diced.positions[v[0]];
      EXPECT_GT(cross(diced.positions[v[1]] - p, diced.positions[v[2]] - p).z, 0) << int(basis);
    }
  }
}

Mesh bent(Mesh mesh, size_t keys) {
  for (size_t key = 0; key < keys; ++key) {
    std::vector<Vec3f> points = mesh.points.get();
    for (Vec3f& p : points) {
      const float angle = 0.5f * float(key);
      p = {p.x * std::cos(angle) - p.y * std::sin(angle), p.x * std::sin(angle) + p.y * std::cos(angle),
           p.z + 0.03f * float(key) * p.x * p.x};
    }
    mesh.motion_points.push_back(points);
  }
  return mesh;
}

TEST(Curves, ThatMoveAreTubesAtEveryKeyAndDoNotSpin) {
  for (const Basis basis : {Basis::BSpline, Basis::CatmullRom})
    for (const Wrap wrap : kWraps) {
      const Mesh mesh = bent(curves(basis, wrap, {usualCount(basis, wrap)}), 3);
      validateMesh(mesh, 1);
      const DicedMesh diced = diceMesh(mesh, 0.1f, kNoCap);
      ASSERT_EQ(diced.motion_positions.size(), 3u);
      ASSERT_EQ(diced.motion_normals.size(), 3u);
      for (size_t key = 0; key < 3; ++key) {
        const twin::CurveTwin twin = twinOf(mesh, 0, key + 1);
        forEachVertex(diced, [&](size_t vertex, size_t) {
          const double u = diced.uv[vertex].x;
          const Vec3d offset = toDouble(diced.motion_positions[key][vertex]) - twin.at(u);
          EXPECT_GT(length(offset), 0.1 - 1e-4);
          EXPECT_LT(length(offset), 0.1 * mostRing());
          EXPECT_GT(dot(normalize(offset), toDouble(diced.motion_normals[key][vertex])), 1 - 1e-4);
          if (key == 0) return;
          // Keys are half a radian apart: rings that keep still turn by no more than that with the curve.
          const double turn = dot(diced.motion_normals[key][vertex], diced.motion_normals[key - 1][vertex]);
          EXPECT_GT(turn, 0.5);
        });
      }
    }
}

TEST(Curves, HaveRatesThatHoldAtEveryKey) {
  Mesh mesh = curves(Basis::CatmullRom, Wrap::Pinned, {5}, 0.01f);
  mesh.points = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}, {4, 0, 0}};
  const uint64_t still = diceMesh(mesh, 0.05f, kNoCap).micropolygons;
  mesh.motion_points = {mesh.points.get(), {{0, 0, 0}, {1, 3, 0}, {2, 0, 0}, {3, 3, 0}, {4, 0, 0}}};
  EXPECT_GT(diceMesh(mesh, 0.05f, kNoCap).micropolygons, 2 * still);
}

TEST(Curves, ThatAreDegenerateAreNumbers) {
  std::vector<Mesh> meshes;
  for (const Basis basis : kBases)
    for (const Wrap wrap : kWraps)
      for (const bool ribbon : {false, true}) {
        Mesh mesh = curves(basis, wrap, {usualCount(basis, wrap)});
        if (ribbon) mesh.normals.values = {{0, 0, 0}};
        meshes.push_back(mesh);
        for (size_t i = 0; i < 4; ++i) mesh.points[i] = mesh.points[0];  // some coincide
        meshes.push_back(mesh);
        for (Vec3f& p : mesh.points.edit()) p = {1, 2, 3};  // all do
        meshes.push_back(mesh);
        mesh.widths.values = {0};
        meshes.push_back(mesh);
        for (size_t i = 0; i < mesh.points.size(); ++i) mesh.points[i] = {i % 2 ? 1.0f : 0.0f, 0, 0};  // there and back
        if (ribbon) mesh.normals.values = {{1, 0, 0}};  // along the curve
        mesh.widths.values = {0.1f};
        meshes.push_back(mesh);
      }
  for (const Mesh& mesh : meshes) {
    validateMesh(mesh, 1);
    const DicedMesh diced = diceMesh(mesh, 0.1f, kNoCap);
    for (const Vec3f p : diced.positions) EXPECT_TRUE(isFinite(p)) << int(mesh.basis) << int(mesh.wrap);
    for (const Vec3f n : diced.normals) EXPECT_NEAR(length(n), 1, 1e-5) << int(mesh.basis) << int(mesh.wrap);
    if (mesh.widths.values[0] == 0) {
      EXPECT_EQ(diced.triangleCount(), 0u);
    }
  }
}

TEST(Curves, HaveNoSecondDerivativeWhereTheyAreLinear) {
  const Mesh mesh = curves(Basis::Linear, Wrap::Nonperiodic, {3});
  const CurveSpan span{0, 0, 3, 0, 0, 2};
  const CurveStencil stencil = pointStencil(mesh, span, 1, 0.5, 2);
  EXPECT_EQ(stencil.count, 0u);
  EXPECT_EQ(length(curveSum(stencil, mesh.points)), 0);
  EXPECT_EQ(length(curveSum(stencil, {})), 0);
}

// The weights of bspline cancel only up to rounding, which must not become a direction.
TEST(Curves, WhosePointsAllCoincideCoverNothing) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> place(-3, 3);
  for (const Basis basis : kBases)
    for (const Wrap wrap : kWraps)
      for (int i = 0; i < 20; ++i) {
        Mesh mesh = curves(basis, wrap, {usualCount(basis, wrap)});
        const Vec3f there{place(random), place(random), place(random)};
        for (Vec3f& p : mesh.points.edit()) p = there;
        EXPECT_EQ(diceMesh(mesh, 0.1f, kNoCap).triangleCount(), 0u) << int(basis) << int(wrap);
      }
}

TEST(Curves, ThatRepeatTheirEndsDoNotLeaveTheirTube) {
  std::mt19937 random(12);
  std::uniform_real_distribution<float> place(-1, 1);
  for (int trial = 0; trial < 20; ++trial) {
    Mesh mesh = curves(Basis::BSpline, Wrap::Nonperiodic, {8}, 0.2f);
    const Vec3f axis = normalize(Vec3f{place(random), place(random), place(random)});
    // A straight curve, both ends of which are there four times.
    for (int i = 0; i < 8; ++i) mesh.points[size_t(i)] = axis * (i < 4 ? 0.1f : 1.1f);
    const DicedMesh diced = diceMesh(mesh, 0.05f, kNoCap);
    EXPECT_GT(diced.triangleCount(), 0u);
    forEachVertex(diced, [&](size_t vertex, size_t) {
      const Vec3f p = diced.positions[vertex];
      const float along = dot(p, axis);
      EXPECT_NEAR(length(p - axis * along), 0.1f, 0.011f);
      EXPECT_GT(along, 0.1f - 1e-4f);
      EXPECT_LT(along, 1.1f + 1e-4f);
    });
  }
}

TEST(Curves, ThatAreTooManyEndInAnErrorBeforeTheyAreMade) {
  Mesh mesh = curves(Basis::BSpline, Wrap::Pinned, {8});
  const uint64_t micropolygons = diceMesh(mesh, 0.1f, kNoCap).micropolygons;
  EXPECT_NO_THROW(diceMesh(mesh, 0.1f, micropolygons));
  try {
    diceMesh(mesh, 0.1f, micropolygons - 1);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::Memory);
    EXPECT_NE(std::string(error.what()).find("/curves"), std::string::npos);
  }
  EXPECT_THROW(diceMesh(mesh, 1e-30f, kNoCap), Error);
}

TEST(Curves, ThatAreWrongAreNamed) {
  const Mesh good = curves(Basis::Bezier, Wrap::Nonperiodic, {4, 7});
  EXPECT_EQ(messageOf(good), "");
  const auto broken = [&](const auto& change) {
    Mesh mesh = good;
    change(mesh);
    return messageOf(mesh);
  };
  const auto has = [](const std::string& message, const std::string& part) {
    EXPECT_NE(message.find(part), std::string::npos) << message;
  };
  has(broken([](Mesh& m) { m.face_vertex_counts = {4, 6}; }), "/curves.curveVertexCounts");
  has(broken([](Mesh& m) { m.face_vertex_counts = {4, 4}; }), "/curves.points");
  has(broken([](Mesh& m) { m.points[3].x = NAN; }), "/curves.points");
  has(broken([](Mesh& m) { m.widths.values = {1, 2}; }), "/curves.widths");
  has(broken([](Mesh& m) { m.widths.values = {-1}; }), "below 0");
  has(broken([](Mesh& m) { m.widths.values = {NAN}; }), "/curves.widths");
  has(broken([](Mesh& m) {
        m.widths.values = {1, 2, 3, 4};
        m.widths.interpolation = Interpolation::Varying;
      }),
      "ask for 5");
  has(broken([](Mesh& m) { m.motion_points = {m.points.get()}; }), "motion keys");
}

TEST(Curves, HaveAnEdgeLengthThatFitsTheirWidth) {
  Scene scene;
  scene.meshes = {curves(Basis::CatmullRom, Wrap::Pinned, {8}, 0.004f)};
  scene.prototypes = {{"/p", {0}}};
  scene.instances = {{"/i", 0, {}, {}}};
  const float hair = resolvedEdgeLengths(scene, {})[0];
  EXPECT_LE(hair, 16 * 0.004f * 1.001f);
  EXPECT_GT(hair, 0);
  scene.meshes[0].widths.values = {1};
  const float tube = resolvedEdgeLengths(scene, {})[0];
  EXPECT_GT(tube, hair);
  EXPECT_LT(tube, 0.2f);
  scene.meshes[0].widths.values = {0};
  EXPECT_GT(resolvedEdgeLengths(scene, {})[0], 0);
}

}  // namespace
}  // namespace encore
