#include "core/reuse/cell_lists.h"

#include <algorithm>
#include <array>
#include <string>

#include "core/scene/error.h"
#include "kernels/reuse/cell_lists_advance.h"
#include "kernels/reuse/cell_lists_children.h"
#include "kernels/reuse/cell_lists_count.h"
#include "kernels/reuse/cell_lists_far.h"
#include "kernels/reuse/cell_lists_find.h"
#include "kernels/reuse/cell_lists_near.h"
#include "kernels/reuse/cell_lists_primitives.h"
#include "kernels/reuse/cell_lists_roots.h"
#include "kernels/reuse/cell_lists_single.h"
#include "kernels/reuse/cell_lists_split.h"
#include "kernels/reuse/cell_lists_write.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kRunLength = 72;  // of samples or cells that one invocation takes in order

// What they cost and gain: tests/core/cell_lists_bench.cpp.
constexpr float kSamplesPerCell = 4;        // of the grid, and so of a root cell
constexpr float kChildrenPerSample = 0.7f;  // rounded down to a power of two
constexpr uint32_t kSmallPrimitive = 8;     // samples that make a single list
constexpr uint32_t kDense = 24;             // samples in a leaf that have it split again
constexpr uint32_t kMaxLevels = 12;         // of splits
constexpr uint32_t kListLimit = 64;         // entries of a list
constexpr uint32_t kChunk = 1 << 15;        // leaves whose lists are found in one dispatch

// A primitive has at most samples / kSamplesPerCell grid cells, and a root cell more on each side: for the least
// primitive that has a grid, 12 cells for 9 samples. Its leaves then are at most kChildrenPerSample per sample, and
// the rest is for second splits.
constexpr double kRootsPerSample = 1.5, kLeavesPerSample = 2;
constexpr uint32_t kEntriesPerSample = 8;

struct PrimitivesArguments {  // of cell_lists_primitives.comp
  uint64_t grid_primitives, grid_points, primitives, cell_counts;
  uint32_t primitive_count, small_primitive;
};
struct RootsArguments {  // of cell_lists_roots.comp
  uint64_t grid_primitives, cell_starts, first_nodes, primitives, places, counts;
  uint32_t primitive_count, node_count, run_length;
};
struct SplitArguments {  // of cell_lists_split.comp
  uint64_t primitives, places, nodes, counts, child_counts, totals;
  uint32_t first, end, least, dense;
  float children_per_sample;
};
struct ChildrenArguments {  // of cell_lists_children.comp
  uint64_t places, nodes, counts, child_starts;
  uint32_t first, end;
};
struct CountArguments {  // of cell_lists_count.comp
  uint64_t grid_primitives, grid_points, primitives, nodes, counts;
  uint32_t primitive_count, sample_count, first_leaf, run_length;
};
struct NearArguments {  // of cell_lists_near.comp
  uint64_t grid_primitives, cell_starts, grid_points, grid_ids, primitives, places, nodes, lists, counts;
  uint32_t first, end, small_primitive;
};
struct FarArguments {  // of cell_lists_far.comp
  uint64_t tree_primitives, slots, corners, lowest_ids, tree_points, tree_ids, primitives, places, nodes, lists, counts;
  uint32_t first, end, capacity;
};
struct WriteArguments {  // of cell_lists_write.comp
  uint64_t points, ids, nodes, lists, starts, entry_points, entry_ids, totals;
  uint32_t first, end, list_limit, capacity;
};
struct AdvanceArguments {  // of cell_lists_advance.comp
  uint64_t starts, totals;
  uint32_t leaves;
};
struct FindArguments {  // of cell_lists_find.comp
  uint64_t primitives, slots, nodes, entry_points, entry_ids, keys, uv, shade;
  uint32_t count, capacity;
};
struct SingleArguments {  // of cell_lists_single.comp
  uint64_t primitives, slots, corners, lowest_ids, tree_points, tree_ids, keys, uv, shade;
  uint32_t count, capacity;
};

constexpr std::array<uint32_t, 1> kListConstants{kListLimit};

}  // namespace

CellListBuilder::CellListBuilder(Device& device, Scan& scan, KeyTable& table, SampleGridBuilder& grids,
                                 TreeBuilder& trees)
    : device_(device),
      scan_(scan),
      table_(table),
      grids_(grids),
      trees_(trees),
      primitives_kernel_(device, "cell_lists_primitives", kCellListsPrimitivesSpirv),
      roots_kernel_(device, "cell_lists_roots", kCellListsRootsSpirv),
      split_kernel_(device, "cell_lists_split", kCellListsSplitSpirv),
      children_kernel_(device, "cell_lists_children", kCellListsChildrenSpirv),
      count_kernel_(device, "cell_lists_count", kCellListsCountSpirv),
      near_kernel_(device, "cell_lists_near", kCellListsNearSpirv, kListConstants),
      far_kernel_(device, "cell_lists_far", kCellListsFarSpirv, kListConstants),
      write_kernel_(device, "cell_lists_write", kCellListsWriteSpirv),
      advance_kernel_(device, "cell_lists_advance", kCellListsAdvanceSpirv),
      totals_(device, 3, "cell list totals") {}

void CellListBuilder::build(const ShadingSamples& samples, CellLists& lists) {
  lists = {};
  lists.sample_count = samples.count;
  if (samples.count == 0) return;
  grids_.build(samples, grid_, kSamplesPerCell);
  makeRoots(lists);
  split(lists);
  fillLists(lists);
  if (lists.leaves_by_tree > 0) {
    trees_.build(samples, lists.trees);
    findLists(lists, true);
    if (lists.leaves_by_tree == 0) lists.trees = {};
  }
  lists.table = std::move(grid_.table);
  grid_ = {};
}

void CellListBuilder::makeRoots(CellLists& lists) {
  const uint32_t primitives = lists.primitive_count = grid_.primitive_count;
  lists.primitives = {device_, primitives, "cell primitives"};
  first_nodes_.reserve(device_, size_t(primitives) + 1, "cell scratch first nodes");
  scan_.reserve(uint32_t(scanWords(lists.sample_count)));
  Commands commands(device_);
  commands.dispatch(primitives_kernel_, groupsFor(uint64_t(primitives) + 1, kLocalSize),
                    PrimitivesArguments{grid_.primitives.address(), grid_.points.address(), lists.primitives.address(),
                                        first_nodes_.address(), primitives, kSmallPrimitive});
  scan_.record(commands, first_nodes_.address(), primitives + 1);
  commands.run();
  first_nodes_.toHost(primitives, 1);
  const uint32_t roots = lists.node_count = first_nodes_.host()[primitives];

  const size_t most = roots + size_t(kLeavesPerSample * lists.sample_count);
  lists.nodes = {device_, most, "cell nodes"};
  places_.reserve(device_, most, "cell scratch places");
  counts_.reserve(device_, most + 1, "cell scratch counts");
  starts_.reserve(device_, most + 1, "cell scratch starts");
  commands.dispatch(
      roots_kernel_, groupsFor(groupsFor(roots, kRunLength), kLocalSize),
      RootsArguments{grid_.primitives.address(), grid_.cell_starts.address(), first_nodes_.address(),
                     lists.primitives.address(), places_.address(), counts_.address(), primitives, roots, kRunLength});
  commands.run();
}

void CellListBuilder::split(CellLists& lists) {
  uint32_t first = 0;
  for (uint32_t level = 0; level < kMaxLevels && first < lists.node_count; ++level) {
    first = splitLevel(lists, first, level);
  }
}

// Returns the first node of the next level; the number of nodes when there is none.
uint32_t CellListBuilder::splitLevel(CellLists& lists, uint32_t first, uint32_t level) {
  const uint32_t end = lists.node_count;
  Commands commands(device_);
  commands.fill(totals_.raw(), 0);
  if (level > 0) {
    commands.dispatch(count_kernel_, groupsFor(groupsFor(lists.sample_count, kRunLength), kLocalSize),
                      CountArguments{grid_.primitives.address(), grid_.points.address(), lists.primitives.address(),
                                     lists.nodes.address(), counts_.address(), lists.primitive_count,
                                     lists.sample_count, first, kRunLength});
  }
  commands.dispatch(split_kernel_, groupsFor(uint64_t(end) - first + 1, kLocalSize),
                    SplitArguments{lists.primitives.address(), places_.address(), lists.nodes.address(),
                                   counts_.address(), starts_.address(), totals_.address(), first, end,
                                   level == 0 ? 2 : kDense, kDense, kChildrenPerSample});
  scan_.record(commands, starts_.address(), end - first + 1);
  commands.run();
  starts_.toHost(end - first, 1);
  totals_.toHost();
  const uint32_t children = starts_.host()[end - first];
  if (children == 0) return end;
  // No room: the leaves stay as they are.
  const bool fits = uint64_t(end) + children <= lists.nodes.size();
  if (!fits) {
    commands.dispatch(
        split_kernel_, groupsFor(uint64_t(end) - first + 1, kLocalSize),
        SplitArguments{lists.primitives.address(), places_.address(), lists.nodes.address(), counts_.address(),
                       starts_.address(), totals_.address(), first, end, 0xffffffffu, kDense, kChildrenPerSample});
    commands.run();
    return end;
  }
  commands.dispatch(
      children_kernel_, groupsFor(end - first, kLocalSize),
      ChildrenArguments{places_.address(), lists.nodes.address(), counts_.address(), starts_.address(), first, end});
  commands.run();
  lists.node_count = end + children;
  return totals_.host()[0] == 0 ? lists.node_count : end;
}

void CellListBuilder::fillLists(CellLists& lists) {
  const size_t capacity = size_t(kEntriesPerSample) * lists.sample_count;
  lists.points = {device_, capacity, "cell list points"};
  lists.ids = {device_, capacity, "cell list ids"};
  lists_.reserve(device_, size_t(kChunk) * kListLimit, "cell scratch lists");
  Commands commands(device_);
  commands.fill(totals_.raw(), 0);
  commands.run();
  findLists(lists, false);
}

void CellListBuilder::findLists(CellLists& lists, bool in_trees) {
  const Trees& trees = lists.trees;
  totals_.toHost();
  totals_.host()[2] = 0;
  totals_.toDevice();
  Commands commands(device_);
  for (uint32_t first = 0; first < lists.node_count; first += kChunk) {
    const uint32_t end = std::min(lists.node_count, first + kChunk);
    const uint64_t groups = groupsFor(uint64_t(end) - first + 1, kLocalSize);
    if (in_trees) {
      commands.dispatch(far_kernel_, groups,
                        FarArguments{trees.primitives.address(), trees.table.address(), trees.nodes.address(),
                                     trees.lowest_ids.address(), trees.points.address(), trees.ids.address(),
                                     lists.primitives.address(), places_.address(), lists.nodes.address(),
                                     lists_.address(), starts_.address(), first, end, uint32_t(trees.table.size())});
    } else {
      commands.dispatch(
          near_kernel_, groups,
          NearArguments{grid_.primitives.address(), grid_.cell_starts.address(), grid_.points.address(),
                        grid_.ids.address(), lists.primitives.address(), places_.address(), lists.nodes.address(),
                        lists_.address(), starts_.address(), first, end, kSmallPrimitive});
    }
    scan_.record(commands, starts_.address(), end - first + 1);
    commands.dispatch(write_kernel_, groups,
                      WriteArguments{in_trees ? trees.points.address() : grid_.points.address(),
                                     in_trees ? trees.ids.address() : grid_.ids.address(), lists.nodes.address(),
                                     lists_.address(), starts_.address(), lists.points.address(), lists.ids.address(),
                                     totals_.address(), first, end, kListLimit, uint32_t(lists.points.size())});
    commands.dispatch(advance_kernel_, 1, AdvanceArguments{starts_.address(), totals_.address(), end - first});
  }
  commands.run();
  totals_.toHost();
  lists.entry_count = totals_.host()[1];
  lists.leaves_by_tree = totals_.host()[2];
}

uint64_t CellListBuilder::listBytes(uint64_t samples) {
  const uint64_t nodes = uint64_t((kRootsPerSample + kLeavesPerSample) * double(samples)) + 1;
  return samples * (sizeof(CellPrimitive) + kEntriesPerSample * (sizeof(Vec2f) + sizeof(uint32_t))) +
         nodes * sizeof(CellNode) + KeyTable::capacityFor(samples) * sizeof(uint32_t);
}

uint64_t CellListBuilder::scratchBytes(uint64_t samples) {
  const uint64_t nodes = uint64_t((kRootsPerSample + kLeavesPerSample) * double(samples)) + 1;
  return (samples + 1) * sizeof(uint32_t) + nodes * (sizeof(Place) + 2 * sizeof(uint32_t)) +
         uint64_t(kChunk) * kListLimit * sizeof(uint32_t) + 5 * sizeof(uint32_t);
}

uint64_t CellListBuilder::scanWords(uint64_t samples) {
  return std::max(uint64_t((kRootsPerSample + kLeavesPerSample) * double(samples)), uint64_t(kChunk)) + 1;
}

CellListSearch::CellListSearch(Device& device)
    : find_(device, "cell_lists_find", kCellListsFindSpirv),
      single_(device, "cell_lists_single", kCellListsSingleSpirv) {}

void CellListSearch::record(Commands& commands, const CellLists& lists, AaSamples& aa) {
  commands.dispatch(find_, groupsFor(aa.count, kLocalSize),
                    FindArguments{lists.primitives.address(), lists.table.address(), lists.nodes.address(),
                                  lists.points.address(), lists.ids.address(), aa.key.address(), aa.uv.address(),
                                  aa.shade.address(), aa.count, uint32_t(lists.table.size())});
  if (lists.leaves_by_tree == 0) return;
  const Trees& trees = lists.trees;
  commands.dispatch(
      single_, groupsFor(aa.count, kLocalSize),
      SingleArguments{trees.primitives.address(), trees.table.address(), trees.nodes.address(),
                      trees.lowest_ids.address(), trees.points.address(), trees.ids.address(), aa.key.address(),
                      aa.uv.address(), aa.shade.address(), aa.count, uint32_t(trees.table.size())});
}

}  // namespace encore
