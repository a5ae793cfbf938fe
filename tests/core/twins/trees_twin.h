// What core/reuse/trees.h must build: the layout that its first comment describes, step by step.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <tuple>
#include <vector>

#include "core/reuse/trees.h"
#include "tests/core/twins/key_table_twin.h"

namespace encore::twin {

// Shading samples in host memory; a sample's id is its index.
struct Samples {
  std::vector<SurfaceKey> keys;
  std::vector<Vec2f> uv;
  std::vector<float> footprints;
  std::vector<Vec4f> aspects;  // empty: no part of the distance

  void add(SurfaceKey key, Vec2f at, float footprint = 1) {
    keys.push_back(key);
    uv.push_back(at);
    footprints.push_back(footprint);
  }
};

inline float inUnitInterval(float x) { return std::isnan(x) || std::signbit(x) ? 0.0f : std::min(x, 1.0f); }
inline Vec2f inUnitSquare(Vec2f p) { return {inUnitInterval(p.x), inUnitInterval(p.y)}; }

struct Node {
  TreeNode box;
  uint32_t lowest_id = 0;
};

struct Tree {
  SurfaceKey key;
  uint32_t depth = 0, u_levels = 0;
  std::vector<uint32_t> ids;  // in order of leaves
  std::vector<Node> nodes;    // heap order, [0] unused; none when the tree is a single leaf
};

class TreeMaker {
 public:
  explicit TreeMaker(const Samples& samples) : samples_(samples) {}

  // ids: of all samples of the key.
  Tree make(SurfaceKey key, std::vector<uint32_t> ids) const {
    Tree tree;
    tree.key = key;
    while (((ids.size() - 1) >> tree.depth) >= 8) ++tree.depth;
    tree.u_levels = uLevels(ids, tree.depth);
    std::sort(ids.begin(), ids.end(), [&](uint32_t a, uint32_t b) { return byU(a) < byU(b); });
    for (uint32_t slab = 0; slab < 1u << tree.u_levels; ++slab) {
      std::sort(ids.begin() + rank(ids, slab, tree.u_levels), ids.begin() + rank(ids, slab + 1, tree.u_levels),
                [&](uint32_t a, uint32_t b) { return byV(a) < byV(b); });
    }
    for (uint32_t leaf = 0; leaf < 1u << tree.depth; ++leaf) {
      std::sort(ids.begin() + rank(ids, leaf, tree.depth), ids.begin() + rank(ids, leaf + 1, tree.depth));
    }
    tree.ids = ids;
    if (tree.depth > 0) addNodes(tree);
    return tree;
  }

 private:
  Vec2f at(uint32_t id) const { return inUnitSquare(samples_.uv[id]); }
  std::tuple<float, float, uint32_t> byU(uint32_t id) const { return {at(id).x, at(id).y, id}; }
  std::tuple<float, uint32_t> byV(uint32_t id) const { return {at(id).y, id}; }
  static std::ptrdiff_t rank(const std::vector<uint32_t>& ids, uint64_t node, uint32_t level) {
    return std::ptrdiff_t((ids.size() * node) >> level);
  }

  TreeNode boundsOf(const uint32_t* first, const uint32_t* end) const {
    TreeNode box{{1, 1}, {0, 0}};
    for (; first != end; ++first) {
      const Vec2f p = at(*first);
      box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y)};
      box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y)};
    }
    return box;
  }

  // Halve the longer side of a cell until there are 2^depth.
  uint32_t uLevels(const std::vector<uint32_t>& ids, uint32_t depth) const {
    const TreeNode box = boundsOf(ids.data(), ids.data() + ids.size());
    const float width = box.high.x - box.low.x, height = box.high.y - box.low.y;
    uint32_t levels = 0;
    while (levels < depth && std::ldexp(width, int(depth - levels)) > std::ldexp(height, int(levels))) ++levels;
    return levels;
  }

  void addNodes(Tree& tree) const {
    tree.nodes.resize(2u << tree.depth);
    for (uint32_t level = 0; level <= tree.depth; ++level) {
      for (uint32_t j = 0; j < 1u << level; ++j) {
        const uint32_t* first = tree.ids.data() + rank(tree.ids, j, level);
        const uint32_t* end = tree.ids.data() + rank(tree.ids, j + 1, level);
        tree.nodes[(1u << level) + j] = {boundsOf(first, end), *std::min_element(first, end)};
      }
    }
  }

  const Samples& samples_;
};

// One tree per key, in order of keys.
inline std::vector<Tree> makeTrees(const Samples& samples) {
  std::map<std::pair<uint32_t, uint32_t>, std::vector<uint32_t>> ids;
  for (uint32_t id = 0; id < samples.keys.size(); ++id) ids[pairOf(samples.keys[id])].push_back(id);
  std::vector<Tree> trees;
  for (const auto& [key, members] : ids) {
    trees.push_back(TreeMaker(samples).make({key.first, key.second}, members));
  }
  return trees;
}

}  // namespace encore::twin
