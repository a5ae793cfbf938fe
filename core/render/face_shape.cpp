#include "core/render/face_shape.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/dice/spheres.h"

namespace encore {
namespace {

// Fewer triangles than this are not worth a table.
constexpr uint32_t kFewTriangles = 32;
// Of barycentric coordinates: what rounding of (u, v) to single precision may add, for all but needles.
constexpr double kRounding = 1e-5;
constexpr float kTriangleSum = 1 + 1e-6f;

struct Plane {
  double x, y;
};
Plane operator-(Plane a, Plane b) { return {a.x - b.x, a.y - b.y}; }
double turn(Plane a, Plane b) { return a.x * b.y - a.y * b.x; }
double dot(Plane a, Plane b) { return a.x * b.x + a.y * b.y; }
Plane plane(Vec2f p, Vec2f step = {1, 1}) { return {double(p.x) / double(step.x), double(p.y) / double(step.y)}; }

struct Barycentric {
  double b1, b2;
  double least() const { return std::min({b1, b2, 1 - b1 - b2}); }
};

Barycentric barycentric(Plane p0, Plane p1, Plane p2, Plane p) {
  const Plane e1 = p1 - p0, e2 = p2 - p0, d = p - p0;
  const double area = turn(e1, e2);
  return {turn(d, e2) / area, turn(e1, d) / area};
}

FacePoint within(uint32_t triangle, Barycentric b) {
  const double b1 = std::clamp(b.b1, 0.0, 1.0), b2 = std::clamp(b.b2, 0.0, 1.0), sum = std::max(1.0, b1 + b2);
  return {triangle, float(b1 / sum), float(b2 / sum)};
}

// Nearest point of the edge a-b to the origin: share of b.
double nearestShare(Plane a, Plane b) {
  const Plane e = b - a;
  const double squared = dot(e, e);
  return squared > 0 ? std::clamp(-dot(a, e) / squared, 0.0, 1.0) : 0.0;
}

// Separating axes of a triangle and the square [-1, 1]². Touching counts as meeting, and a little more.
bool meetsSquare(const std::array<Plane, 3>& p) {
  const auto apart = [&](Plane axis) {
    const double reach = (std::abs(axis.x) + std::abs(axis.y)) * (1 + kRounding);
    const double d0 = dot(p[0], axis), d1 = dot(p[1], axis), d2 = dot(p[2], axis);
    return std::min({d0, d1, d2}) > reach || std::max({d0, d1, d2}) < -reach;
  };
  if (apart({1, 0}) || apart({0, 1})) return false;
  for (int k = 0; k < 3; ++k) {
    const Plane e = p[(k + 1) % 3] - p[k];
    if (apart({-e.y, e.x})) return false;
  }
  return true;
}

struct Nearest {
  Barycentric at{0, 0};
  double squared = std::numeric_limits<double>::infinity();
};

// Nearest point of a triangle to the origin, which lies outside of it.
Nearest nearestOnEdges(const std::array<Plane, 3>& p) {
  Nearest best;
  const auto offer = [&](double b0, double b1, double b2) {
    const Plane at{p[0].x * b0 + p[1].x * b1 + p[2].x * b2, p[0].y * b0 + p[1].y * b1 + p[2].y * b2};
    if (const double squared = dot(at, at); squared < best.squared) best = {{b1, b2}, squared};
  };
  const double s01 = nearestShare(p[0], p[1]), s12 = nearestShare(p[1], p[2]), s20 = nearestShare(p[2], p[0]);
  offer(1 - s01, s01, 0);
  offer(0, 1 - s12, s12);
  offer(s20, 0, 1 - s20);
  return best;
}

}  // namespace

FaceShape::FaceShape(const DicedMesh& mesh, uint32_t primitive) : mesh_(mesh), sphere_(isSpheres(mesh)) {
  if (sphere_) {
    largest_ = primitive, triangular_ = false;
    return;
  }
  const auto [first, last] =
      std::equal_range(mesh.triangle_primitive.begin(), mesh.triangle_primitive.end(), primitive);
  begin_ = uint32_t(first - mesh.triangle_primitive.begin());
  end_ = uint32_t(last - mesh.triangle_primitive.begin());
  largest_ = begin_;
  double largest_area = -1;
  for (uint32_t i = begin_; i < end_; ++i) {
    const Triangle t = triangle(i);
    for (const Vec2f p : {t.p0, t.p1, t.p2}) triangular_ = triangular_ && p.x + p.y <= kTriangleSum;
    const double area = exists(i) ? std::abs(turn(plane(t.p1) - plane(t.p0), plane(t.p2) - plane(t.p0))) : 0;
    if (area > largest_area) largest_area = area, largest_ = i;
  }
  if (end_ - begin_ > kFewTriangles) fillCells();
}

FaceShape::Triangle FaceShape::triangle(uint32_t index) const {
  const uint32_t* corner = &mesh_.triangles[3 * size_t{index}];
  return {mesh_.uv[corner[0]], mesh_.uv[corner[1]], mesh_.uv[corner[2]]};
}

bool FaceShape::exists(uint32_t index) const {
  const Triangle t = triangle(index);
  if (turn(plane(t.p1) - plane(t.p0), plane(t.p2) - plane(t.p0)) == 0) return false;
  const uint32_t* corner = &mesh_.triangles[3 * size_t{index}];
  const Vec3d p0 = toDouble(mesh_.positions[corner[0]]);
  return cross(toDouble(mesh_.positions[corner[1]]) - p0, toDouble(mesh_.positions[corner[2]]) - p0) != Vec3d{};
}

uint32_t FaceShape::cellOf(float x) const { return uint32_t(std::clamp(x * float(cells_), 0.0f, float(cells_) - 1)); }

// Counting sort of triangles into the cells that their boxes touch: about two to a cell.
void FaceShape::fillCells() {
  cells_ = uint32_t(std::ceil(std::sqrt(0.5f * float(end_ - begin_))));
  const auto forEachCell = [&](uint32_t index, const auto& visit) {
    const Triangle t = triangle(index);
    const uint32_t x1 = cellOf(std::max({t.p0.x, t.p1.x, t.p2.x})), y1 = cellOf(std::max({t.p0.y, t.p1.y, t.p2.y}));
    for (uint32_t y = cellOf(std::min({t.p0.y, t.p1.y, t.p2.y})); y <= y1; ++y)
      for (uint32_t x = cellOf(std::min({t.p0.x, t.p1.x, t.p2.x})); x <= x1; ++x) visit(y * cells_ + x);
  };
  std::vector<uint32_t> next(size_t{cells_} * cells_ + 1, 0);
  for (uint32_t i = begin_; i < end_; ++i)
    if (exists(i)) forEachCell(i, [&](uint32_t cell) { ++next[cell + 1]; });
  for (size_t cell = 1; cell < next.size(); ++cell) next[cell] += next[cell - 1];
  cell_triangles_.resize(next.back());
  for (uint32_t i = begin_; i < end_; ++i)
    if (exists(i)) forEachCell(i, [&](uint32_t cell) { cell_triangles_[next[cell]++] = i; });
  next.pop_back();
  cell_ends_ = std::move(next);
}

template <class Visit>
void FaceShape::visitNear(Vec2f low, Vec2f high, const Visit& visit) const {
  if (cells_ == 0) {
    for (uint32_t i = begin_; i < end_; ++i)
      if (exists(i)) visit(i);
    return;
  }
  for (uint32_t y = cellOf(low.y); y <= cellOf(high.y); ++y)
    for (uint32_t x = cellOf(low.x); x <= cellOf(high.x); ++x) {
      const uint32_t cell = y * cells_ + x;
      for (uint32_t k = cell ? cell_ends_[cell - 1] : 0; k < cell_ends_[cell]; ++k) visit(cell_triangles_[k]);
    }
}

// Parameters of spheres fill the square.
std::optional<FacePoint> FaceShape::find(Vec2f uv) const {
  if (sphere_) {
    if (!(uv.x >= 0 && uv.x <= 1 && uv.y >= 0 && uv.y <= 1)) return {};
    return FacePoint{largest_, uv.x / 2, uv.y / 2};
  }
  Barycentric best{};
  double best_least = -kRounding;
  uint32_t best_triangle = end_;
  visitNear(uv, uv, [&](uint32_t i) {
    const Triangle t = triangle(i);
    const Barycentric b = barycentric(plane(t.p0), plane(t.p1), plane(t.p2), plane(uv));
    // Within a triangle, its border included, none is better than another.
    const double least = std::min(b.least(), 0.0);
    if (least > best_least || (least == best_least && i < best_triangle))
      best = b, best_least = least, best_triangle = i;
  });
  if (best_triangle == end_) return {};
  return within(best_triangle, best);
}

std::optional<FacePoint> FaceShape::nearest(Vec2f uv, Vec2f step) const {
  if (sphere_) return find({std::clamp(uv.x, 0.0f, 1.0f), std::clamp(uv.y, 0.0f, 1.0f)});
  Nearest best;
  uint32_t best_triangle = end_;
  visitNear(uv - step, uv + step, [&](uint32_t i) {
    const Triangle t = triangle(i);
    const std::array<Plane, 3> p{plane(t.p0 - uv, step), plane(t.p1 - uv, step), plane(t.p2 - uv, step)};
    if (!meetsSquare(p)) return;
    const Barycentric inside = barycentric(p[0], p[1], p[2], {0, 0});
    const Nearest n = inside.least() >= 0 ? Nearest{inside, 0} : nearestOnEdges(p);
    if (n.squared < best.squared || (n.squared == best.squared && i < best_triangle)) best = n, best_triangle = i;
  });
  if (best_triangle == end_) return {};
  return within(best_triangle, best.at);
}

FacePoint FaceShape::extrapolate(Vec2f uv) const {
  if (const auto found = sphere_ ? nearest(uv, {}) : find(uv)) return *found;
  const Triangle t = triangle(largest_);
  if (!exists(largest_)) return {largest_, 0, 0};
  const Barycentric b = barycentric(plane(t.p0), plane(t.p1), plane(t.p2), plane(uv));
  return {largest_, float(b.b1), float(b.b2)};
}

}  // namespace encore
