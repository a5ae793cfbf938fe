#include "core/shade/mesh_light.h"

#include <algorithm>
#include <cmath>

namespace encore {
namespace {

// Of what a group is given whatever its distance: no place is left without density.
constexpr float kLeastImportance = 1e-3f;

struct Ball {
  Vec3f low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};
  void add(Vec3f p) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  Vec3f centre() const { return (low + high) * 0.5f; }
  float radius() const { return length(high - low) * 0.5f; }
};

float areaOf(const std::array<Vec3f, 3>& t) { return 0.5f * length(cross(t[1] - t[0], t[2] - t[0])); }

// cos(max(0, a - b)) of angles that are given by their cosines.
float cosineOfDifference(float a, float b) {
  if (a >= b) return 1;
  return a * b + std::sqrt(std::max(0.0f, (1 - a * a) * (1 - b * b)));
}

}  // namespace

struct MeshLight::Built {
  Triangle triangle;
  Ball bounds;
  Vec3f centre, normal;
  float area;
};

MeshLight::MeshLight(const TraceScene& trace, uint32_t instance, bool flipped, bool moves)
    : instance_(instance), flipped_(flipped) {
  std::vector<Built> built;
  for (uint32_t mesh = 0; mesh < trace.meshCount(instance); ++mesh)
    for (uint32_t i = 0; i < trace.triangleCount(instance, mesh); ++i) {
      Built b{{mesh, i}, {}, {}, {}, 0};
      triangles_.assign(1, b.triangle);
      const uint32_t poses = moves ? uint32_t(kMaxMotionKeys) : 1;
      for (uint32_t k = 0; k < poses; ++k)
        for (const Vec3f p : triangle(trace, 0, float(k) / float(std::max(1u, poses - 1)))) b.bounds.add(p);
      const std::array<Vec3f, 3> t = triangle(trace, 0, 0.5f);
      for (const Vec3f p : t) b.bounds.add(p);
      b.area = areaOf(t), b.centre = b.bounds.centre(), b.normal = normalize(cross(t[1] - t[0], t[2] - t[0]));
      if (b.area > 0 && isFinite(b.centre) && std::isfinite(b.area)) built.push_back(b);
    }
  triangles_.clear();
  if (built.empty()) return;
  triangles_.reserve(built.size()), nodes_.reserve(built.size());
  build(built, 0, uint32_t(built.size()));
}

uint32_t MeshLight::build(std::vector<Built>& built, uint32_t begin, uint32_t end) {
  const uint32_t index = uint32_t(nodes_.size());
  Node node;
  Ball bounds, centres;
  Vec3f normals;
  for (uint32_t i = begin; i < end; ++i) {
    bounds.add(built[i].bounds.low), bounds.add(built[i].bounds.high), centres.add(built[i].centre);
    normals += built[i].normal * built[i].area;
    node.area += built[i].area;
  }
  node.centre = bounds.centre(), node.radius = bounds.radius() * 1.0001f;
  node.axis = normalize(normals);
  node.cosine = node.axis == Vec3f{} ? -1.0f : 1.0f;
  for (uint32_t i = begin; i < end; ++i) node.cosine = std::min(node.cosine, dot(node.axis, built[i].normal));
  node.first = uint32_t(triangles_.size()), node.count = end - begin;
  nodes_.push_back(node);
  if (end - begin == 1) {
    triangles_.push_back(built[begin].triangle);
    return index;
  }
  const Vec3f extent = centres.high - centres.low;
  const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
  const uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(
      built.begin() + begin, built.begin() + middle, built.begin() + end, [axis](const Built& a, const Built& b) {
        if (a.centre[axis] != b.centre[axis]) return a.centre[axis] < b.centre[axis];
        return std::pair(a.triangle.mesh, a.triangle.triangle) < std::pair(b.triangle.mesh, b.triangle.triangle);
      });
  build(built, begin, middle);
  const uint32_t second = build(built, middle, end);
  nodes_[index].second = second;
  return index;
}

float MeshLight::importance(const Node& node, Vec3f p) {
  const Vec3f to = p - node.centre;
  const float d2 = dot(to, to), r2 = node.radius * node.radius;
  float facing = 1;
  if (d2 > r2 && node.cosine > -1) {
    const float d = std::sqrt(d2), sine = node.radius / d;
    // The least angle between a normal and a direction towards p.
    const float c = cosineOfDifference(std::clamp(dot(node.axis, to) / d, -1.0f, 1.0f), node.cosine);
    facing = cosineOfDifference(c, std::sqrt(1 - sine * sine));
  }
  return node.area * std::max(facing, kLeastImportance) / std::max(d2, r2);
}

std::array<Vec3f, 3> MeshLight::triangle(const TraceScene& trace, uint32_t index, float time) const {
  std::array<Vec3f, 3> t = trace.triangle(instance_, triangles_[index].mesh, triangles_[index].triangle, time);
  if (flipped_) std::swap(t[1], t[2]);
  return t;
}

MeshLight::Sample MeshLight::sample(const TraceScene& trace, Vec3f p, Vec2f u, float time) const {
  if (nodes_.empty()) return {};
  uint32_t n = 0;
  float chance = 1;
  while (nodes_[n].second != 0) {
    const float a = importance(nodes_[n + 1], p), b = importance(nodes_[nodes_[n].second], p);
    const float share = a / (a + b);
    if (!(share >= 0)) return {};
    // What is left of u goes on.
    if (u.x < share) {
      n = n + 1, u.x = std::min(u.x / share, 0x1.fffffep-1f), chance *= share;
    } else {
      n = nodes_[n].second, u.x = std::clamp((u.x - share) / (1 - share), 0.0f, 0x1.fffffep-1f), chance *= 1 - share;
    }
  }
  const std::array<Vec3f, 3> t = triangle(trace, nodes_[n].first, time);
  const Vec3f axis = cross(t[1] - t[0], t[2] - t[0]);
  const float area = 0.5f * length(axis);
  if (!(area > 0)) return {};
  const float s = std::sqrt(u.x);
  return {t[0] * (1 - s) + t[1] * (s * (1 - u.y)) + t[2] * (s * u.y), normalize(axis), chance / area};
}

float MeshLight::density(const TraceScene& trace, Vec3f p, uint32_t index, float time) const {
  uint32_t n = 0;
  float chance = 1;
  while (nodes_[n].second != 0) {
    const uint32_t second = nodes_[n].second;
    const float a = importance(nodes_[n + 1], p), b = importance(nodes_[second], p);
    const bool left = index < nodes_[second].first;
    chance *= left ? a / (a + b) : 1 - a / (a + b);
    n = left ? n + 1 : second;
  }
  const float area = areaOf(triangle(trace, index, time));
  return area > 0 ? chance / area : 0;
}

}  // namespace encore
