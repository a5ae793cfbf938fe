// One balanced 2D kd-tree per primitive, all built at once (§3.2), as arrays without pointers.
//
// Let a primitive have n samples. Its tree is complete: depth D, the smallest for which no leaf has more
// than 8 samples; node j of the 2^l of level l holds the samples of rank n*j >> l to (n*(j+1) >> l) - 1.
// The first d levels split u, the other D - d split v, where d makes cells about square. Ranks within
// the first d levels are those of the order (u, v, id), which cuts the samples into 2^d slabs; ranks within
// a slab are those of the order (v, id); within a leaf, samples are stored in order of id. So two sorts build all
// trees, whatever their sizes, and the place of every node and leaf follows from n, D and d. Nodes hold the bounds of
// their samples, and the lowest sample id, so that ties end early.
//
// Coordinates are taken to the nearest point of [0, 1]²; what is not a number counts as 0. Where the metric of §2.4
// is in force, samples have footprints beside their points, and nodes the ranges of these.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/reuse/key_table.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/reuse.h"
#include "core/reuse/scan.h"
#include "core/reuse/tree_primitive.h"
#include "core/vulkan/device.h"

namespace encore {

struct TreeNode {
  Vec2f low, high;  // smallest and largest u and v of the samples below
};

// Of a sample, clamped; shaders/reuse/footprint.glsl declares the same, and computes it.
struct TreeFootprint {
  float log2_radius, squared_radius;
};
// Of the samples below a node.
struct TreeFootprintRange {
  float low_log2, high_log2, least_squared, unused;
};

struct Trees {
  uint32_t sample_count = 0, primitive_count = 0, node_count = 0;
  float footprint_weight = 0;                   // c of the metric of §2.4; 0: distances in (u, v)
  uint64_t sample_aspects = 0;                  // device address of ShadingSamples::aspect, by id; 0: none
  Buffer<TreePrimitive> primitives;             // in order of their keys: instance, then primitive and side
  Buffer<TreeNode> nodes;                       // only of trees that have more than one leaf
  Buffer<uint32_t> lowest_ids;                  // per node
  Buffer<Vec2f> points;                         // samples in order of primitive, leaf
  Buffer<uint32_t> ids;                         // of the same
  Buffer<TreeFootprint> footprints;             // of the samples in the same order, only with the metric
  Buffer<TreeFootprintRange> footprint_ranges;  // per node, likewise
  KeyTable::Slots table;
};

class TreeBuilder {
 public:
  TreeBuilder(Device& device, Scan& scan, RadixSort& sort, KeyTable& table);
  // footprint_weight: as ReuseKernels::buildIndex() says.
  void build(const ShadingSamples& samples, Trees& trees, float footprint_weight = 0);

  // Device bytes of the trees of n samples, with the metric, and of the scratch memory kept for building them, at
  // most: without the sort's, the scan's and the table's.
  static uint64_t treeBytes(uint64_t samples);
  static uint64_t scratchBytes(uint64_t samples);

 private:
  struct Totals {
    uint32_t nodes, slabs, depth;
  };
  void reserve(uint32_t count);
  // Sorts by (key, u, v, id), leaves the order (v, id) in by_v_, and returns the number of primitives.
  uint32_t sortByPrimitive(const ShadingSamples& samples);
  Totals shape(const ShadingSamples& samples, Trees& trees);
  void fillTrees(const ShadingSamples& samples, const Totals& totals, Trees& trees);
  void recordNodes(Commands& commands, const Totals& totals, const Trees& trees);

  Device& device_;
  Scan& scan_;
  RadixSort& sort_;
  KeyTable& table_;
  Kernel points_kernel_, heads_kernel_, primitives_kernel_, extents_kernel_, shape_kernel_, layout_kernel_,
      slabs_kernel_, reorder_kernel_, leaves_kernel_, merge_kernel_;
  Buffer<Vec2f> points_;                                 // by sample id, in the unit square
  Buffer<uint32_t> by_v_, heads_, slab_of_;              // per sample
  Buffer<uint32_t> ranges_, node_starts_, slab_starts_;  // per primitive
  Buffer<uint32_t> leaf_primitive_, totals_;
};

}  // namespace encore
