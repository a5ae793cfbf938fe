// A light that is made of an instance's triangles.
#pragma once

#include <cstdint>
#include <vector>

#include "core/scene/math.h"
#include "core/trace/trace_scene.h"

namespace encore {

// Triangles are chosen from a tree, by what their groups could contribute to a point at most: their area, distance and
// the directions that they face (after Conty Estevez & Kulla, "Importance Sampling of Many Lights with Adaptive Tree
// Splitting", HPG 2018). Within a triangle points are uniform in area.
class MeshLight {
 public:
  // flipped: the instance is mirrored, so that triangles wind the other way round.
  // Areas for the choice are those of the middle of the shutter.
  MeshLight(const TraceScene& trace, uint32_t instance, bool flipped,
            bool moves);  // moves: something does, over the shutter

  struct Sample {
    Vec3f position, normal;  // unit, outside
    float density = 0;       // per area; 0: nothing
  };
  // From a point p, at a time of the shutter. u in [0, 1)².
  Sample sample(const TraceScene& trace, Vec3f p, Vec2f u, float time) const;
  // The density per area with which sample() chooses points of triangle `index` at that time; 0 where there are none.
  float density(const TraceScene& trace, Vec3f p, uint32_t index, float time) const;

  uint32_t size() const { return uint32_t(triangles_.size()); }
  std::array<Vec3f, 3> triangle(const TraceScene& trace, uint32_t index, float time) const;  // outside as it winds
  float area() const { return nodes_.empty() ? 0 : nodes_[0].area; }
  Vec3f centre() const { return nodes_.empty() ? Vec3f{} : nodes_[0].centre; }
  float radius() const { return nodes_.empty() ? 0 : nodes_[0].radius; }  // of a ball that holds it at all times
  uint64_t bytes() const { return triangles_.size() * sizeof(Triangle) + nodes_.size() * sizeof(Node); }

 private:
  struct Triangle {
    uint32_t mesh, triangle;
  };
  // A group of triangles: the children of an inner node are the next one and `second`.
  struct Node {
    Vec3f centre;
    float radius = 0;
    Vec3f axis;        // of a cone that holds all normals
    float cosine = 1;  // of its half angle; -1: all directions
    float area = 0;
    uint32_t second = 0;            // 0: a leaf
    uint32_t first = 0, count = 0;  // triangles, in order
  };
  struct Built;  // what a triangle is while the tree is built

  uint32_t build(std::vector<Built>& built, uint32_t begin, uint32_t end);
  static float importance(const Node& node, Vec3f p);

  uint32_t instance_;
  bool flipped_;
  std::vector<Triangle> triangles_;  // in the order of the leaves
  std::vector<Node> nodes_;
};

}  // namespace encore
