#include "core/reuse/trees.h"

#include <bit>
#include <string>

#include "core/scene/error.h"
#include "kernels/reuse/trees_extents.h"
#include "kernels/reuse/trees_heads.h"
#include "kernels/reuse/trees_layout.h"
#include "kernels/reuse/trees_leaves.h"
#include "kernels/reuse/trees_merge.h"
#include "kernels/reuse/trees_points.h"
#include "kernels/reuse/trees_primitives.h"
#include "kernels/reuse/trees_reorder.h"
#include "kernels/reuse/trees_shape.h"
#include "kernels/reuse/trees_slabs.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kExtentsRunLength = 72;

struct PointsArguments {  // of trees_points.comp
  uint64_t uv, points;
  uint32_t count;
};
struct HeadsArguments {  // of trees_heads.comp
  uint64_t keys, order, marks;
  uint32_t count;
};
struct PrimitivesArguments {  // of trees_primitives.comp
  uint64_t keys, order, heads, primitives;
  uint32_t count;
};
struct ExtentsArguments {  // of trees_extents.comp
  uint64_t points, order, heads, ranges;
  uint32_t count, run_length;
};
struct ShapeArguments {  // of trees_shape.comp
  uint64_t points, order, ranges, primitives, node_counts, slab_counts, totals;
  uint32_t primitive_count;
};
struct LayoutArguments {  // of trees_layout.comp
  uint64_t node_starts, slab_starts, primitives, totals;
  uint32_t primitive_count;
};
struct SlabsArguments {  // of trees_slabs.comp
  uint64_t order, heads, primitives, slab_starts, slab_of;
  uint32_t count;
};
struct ReorderArguments {  // of trees_reorder.comp
  uint64_t points, order, heads, primitives, tree_points, tree_ids, radii, tree_footprints;
  uint32_t count;
};
struct LeavesArguments {  // of trees_leaves.comp
  uint64_t points, ids, primitives, node_starts, nodes, lowest_ids, leaf_primitive, footprints, footprint_ranges;
  uint32_t primitive_count, leaf_count;
};
struct MergeArguments {  // of trees_merge.comp
  uint64_t primitives, nodes, lowest_ids, leaf_primitive, footprint_ranges;
  uint32_t leaf_count, height;
};

}  // namespace

TreeBuilder::TreeBuilder(Device& device, Scan& scan, RadixSort& sort, KeyTable& table)
    : device_(device),
      scan_(scan),
      sort_(sort),
      table_(table),
      points_kernel_(device, "trees_points", kTreesPointsSpirv),
      heads_kernel_(device, "trees_heads", kTreesHeadsSpirv),
      primitives_kernel_(device, "trees_primitives", kTreesPrimitivesSpirv),
      extents_kernel_(device, "trees_extents", kTreesExtentsSpirv),
      shape_kernel_(device, "trees_shape", kTreesShapeSpirv),
      layout_kernel_(device, "trees_layout", kTreesLayoutSpirv),
      slabs_kernel_(device, "trees_slabs", kTreesSlabsSpirv),
      reorder_kernel_(device, "trees_reorder", kTreesReorderSpirv),
      leaves_kernel_(device, "trees_leaves", kTreesLeavesSpirv),
      merge_kernel_(device, "trees_merge", kTreesMergeSpirv),
      totals_(device, 3, "tree totals") {}

// A primitive of one sample costs most: its record, and up to four slots of the table. A tree with nodes
// has more than 8 samples, more than 4 per leaf, and two nodes per leaf (one unused): fewer than n / 2 nodes.
uint64_t TreeBuilder::treeBytes(uint64_t samples) {
  return samples * (sizeof(Vec2f) + sizeof(uint32_t) + sizeof(TreeFootprint) + sizeof(TreePrimitive)) +
         KeyTable::capacityFor(samples) * sizeof(uint32_t) +
         samples / 2 * (sizeof(TreeNode) + sizeof(uint32_t) + sizeof(TreeFootprintRange));
}

uint64_t TreeBuilder::scratchBytes(uint64_t samples) {
  const uint64_t per_sample = sizeof(Vec2f) + 3 * sizeof(uint32_t);
  const uint64_t per_primitive = 4 * sizeof(uint32_t);
  return samples * (per_sample + per_primitive + sizeof(uint32_t) / 4) + 16 * sizeof(uint32_t);
}

void TreeBuilder::reserve(uint32_t count) {
  points_.reserve(device_, count, "tree scratch points");
  by_v_.reserve(device_, count, "tree scratch order");
  heads_.reserve(device_, size_t(count) + 1, "tree scratch heads");
  slab_of_.reserve(device_, count, "tree scratch slabs");
  sort_.reserve(count);
  scan_.reserve(count + 1);
}

void TreeBuilder::build(const ShadingSamples& samples, Trees& trees, float footprint_weight) {
  trees.sample_count = samples.count;
  trees.footprint_weight = footprint_weight;
  trees.sample_aspects = samples.aspect.empty() ? 0 : samples.aspect.address();
  if (samples.count == 0) return;
  if (samples.count > kMaxSortValues) {
    throw Error(ErrorKind::Memory, std::to_string(samples.count) + " shading samples are too many for one tile");
  }
  reserve(samples.count);
  trees.primitive_count = sortByPrimitive(samples);
  const Totals totals = shape(samples, trees);
  fillTrees(samples, totals, trees);
}

uint32_t TreeBuilder::sortByPrimitive(const ShadingSamples& samples) {
  const uint32_t count = samples.count;
  const uint64_t keys = samples.key.address(), points = points_.address();
  Commands commands(device_);
  commands.dispatch(points_kernel_, groupsFor(count, kLocalSize), PointsArguments{samples.uv.address(), points, count});
  sort_.recordVaryingBits(commands, keys, count, 0);
  sort_.recordVaryingBits(commands, points, count, 1);
  commands.run();
  const auto key_bits = sort_.varyingBits(0), point_bits = sort_.varyingBits(1);

  sort_.recordStart(commands, count);
  sort_.recordBy(commands, count, {points, 2, 1}, bitRangeOf(point_bits[1]));
  sort_.recordCopy(commands, count, by_v_.address());
  sort_.recordBy(commands, count, {points, 2, 0}, bitRangeOf(point_bits[0]));
  sort_.recordBy(commands, count, {keys, 2, 1}, bitRangeOf(key_bits[1]));
  sort_.recordBy(commands, count, {keys, 2, 0}, bitRangeOf(key_bits[0]));
  commands.dispatch(heads_kernel_, groupsFor(uint64_t(count) + 1, kLocalSize),
                    HeadsArguments{keys, sort_.values(), heads_.address(), count});
  scan_.record(commands, heads_.address(), count + 1);
  commands.run();
  heads_.toHost(count, 1);
  return heads_.host()[count];
}

TreeBuilder::Totals TreeBuilder::shape(const ShadingSamples& samples, Trees& trees) {
  const uint32_t count = samples.count, primitives = trees.primitive_count;
  trees.primitives = {device_, primitives, "tree primitives"};
  ranges_.reserve(device_, size_t(primitives) * 2, "tree scratch ranges");
  node_starts_.reserve(device_, size_t(primitives) + 1, "tree scratch node starts");
  slab_starts_.reserve(device_, size_t(primitives) + 1, "tree scratch slab starts");
  const uint64_t order = sort_.values();
  Commands commands(device_);
  commands.dispatch(
      primitives_kernel_, groupsFor(count, kLocalSize),
      PrimitivesArguments{samples.key.address(), order, heads_.address(), trees.primitives.address(), count});
  commands.fill(ranges_.raw(), 0xffffffffu);
  commands.dispatch(
      extents_kernel_, groupsFor(groupsFor(count, kExtentsRunLength), kLocalSize),
      ExtentsArguments{points_.address(), order, heads_.address(), ranges_.address(), count, kExtentsRunLength});
  commands.fill(totals_.raw(), 0);
  const uint64_t groups = groupsFor(uint64_t(primitives) + 1, kLocalSize);
  commands.dispatch(shape_kernel_, groups,
                    ShapeArguments{points_.address(), order, ranges_.address(), trees.primitives.address(),
                                   node_starts_.address(), slab_starts_.address(), totals_.address(), primitives});
  scan_.record(commands, node_starts_.address(), primitives + 1);
  scan_.record(commands, slab_starts_.address(), primitives + 1);
  commands.dispatch(layout_kernel_, groups,
                    LayoutArguments{node_starts_.address(), slab_starts_.address(), trees.primitives.address(),
                                    totals_.address(), primitives});
  commands.run();
  totals_.toHost();
  const auto totals = totals_.host();
  return {totals[0], totals[1], totals[2]};
}

void TreeBuilder::fillTrees(const ShadingSamples& samples, const Totals& totals, Trees& trees) {
  const uint32_t count = trees.sample_count;
  trees.node_count = totals.nodes;
  trees.nodes = {device_, totals.nodes, "tree nodes"};
  trees.lowest_ids = {device_, totals.nodes, "tree lowest ids"};
  trees.points = {device_, count, "tree points"};
  trees.ids = {device_, count, "tree ids"};
  const bool metric = trees.footprint_weight > 0;
  if (metric) {
    trees.footprints = {device_, count, "tree footprints"};
    trees.footprint_ranges = {device_, totals.nodes, "tree footprint ranges"};
  }
  trees.table = table_.create(trees.primitive_count);
  leaf_primitive_.reserve(device_, totals.nodes / 2, "tree scratch leaves");

  Commands commands(device_);
  const uint64_t groups = groupsFor(count, kLocalSize);
  commands.dispatch(slabs_kernel_, groups,
                    SlabsArguments{sort_.values(), heads_.address(), trees.primitives.address(), slab_starts_.address(),
                                   slab_of_.address(), count});
  sort_.recordStart(commands, count, by_v_.address());
  sort_.recordBy(commands, count, {slab_of_.address(), 1, 0}, {0, uint32_t(std::bit_width(totals.slabs - 1))});
  commands.dispatch(reorder_kernel_, groups,
                    ReorderArguments{points_.address(), sort_.values(), heads_.address(), trees.primitives.address(),
                                     trees.points.address(), trees.ids.address(),
                                     metric ? samples.footprint.address() : 0, trees.footprints.address(), count});
  recordNodes(commands, totals, trees);
  table_.recordInsert(commands, trees.table, trees.primitives.address(), trees.primitive_count);
  commands.run();
}

void TreeBuilder::recordNodes(Commands& commands, const Totals& totals, const Trees& trees) {
  const uint32_t leaves = totals.nodes / 2;
  const uint64_t groups = groupsFor(leaves, kLocalSize);
  commands.dispatch(
      leaves_kernel_, groups,
      LeavesArguments{trees.points.address(), trees.ids.address(), trees.primitives.address(), node_starts_.address(),
                      trees.nodes.address(), trees.lowest_ids.address(), leaf_primitive_.address(),
                      trees.footprints.address(), trees.footprint_ranges.address(), trees.primitive_count, leaves});
  for (uint32_t height = 1; height <= totals.depth; ++height) {
    commands.dispatch(merge_kernel_, groups,
                      MergeArguments{trees.primitives.address(), trees.nodes.address(), trees.lowest_ids.address(),
                                     leaf_primitive_.address(), trees.footprint_ranges.address(), leaves, height});
  }
}

}  // namespace encore
