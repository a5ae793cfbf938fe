// Exact nearest neighbours by lists of candidates: for antialiasing samples in any order (reflections, refractions,
// lens and motion blur), of which those of a pixel have little in common.
//
// Each primitive is covered by root cells: those of its SampleGrid and one more on each side, those at the border
// reaching to the border of [0, 1]². A root cell is split into 2^a × 2^b leaves, about one for every two samples;
// leaves that hold many samples are split again, so that very uneven densities end in lists as short as even ones. Each
// leaf lists all samples that can be the nearest to any point of it (shaders/reuse/cell_lists_leaf.glsl says how they
// are found and why rounding cannot break that), in order of id, with a copy of their coordinates: a query is one look
// into the key table, one or two steps to the leaf, and a loop over some six candidates. Leaves whose list would
// be too long have none; queries there walk trees, which are built only if there are such leaves.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/reuse/key_table.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/reuse.h"
#include "core/reuse/sample_grid.h"
#include "core/reuse/scan.h"
#include "core/reuse/trees.h"
#include "core/vulkan/device.h"

namespace encore {

// shaders/reuse/cell_lists.glsl declares the same.
struct CellPrimitive {
  SurfaceKey key;
  Vec2f origin;          // lower corner of the root cells
  Vec2f cells_per_unit;  // 0 where there is one cell
  uint32_t columns, rows;
  uint32_t first_node;  // root cell (i, j) is node first_node + j * columns + i
  uint32_t unused;
};
static_assert(sizeof(CellPrimitive) == 40 && offsetof(CellPrimitive, first_node) == 32);

// A leaf's first entry and number of entries; or a node's first child and how it is split (cell_lists.glsl).
struct CellNode {
  uint32_t first, count;
};

struct CellLists {
  uint32_t sample_count = 0, primitive_count = 0, node_count = 0;
  uint32_t entry_count = 0;          // in all lists
  uint32_t leaves_by_tree = 0;       // leaves without a list
  Buffer<CellPrimitive> primitives;  // in order of their keys
  Buffer<CellNode> nodes;
  Buffer<Vec2f> points;  // entries of the lists
  Buffer<uint32_t> ids;  // of the same
  KeyTable::Slots table;
  Trees trees;  // of all samples, only where leaves_by_tree is not 0
};

class CellListBuilder {
 public:
  CellListBuilder(Device& device, Scan& scan, KeyTable& table, SampleGridBuilder& grids, TreeBuilder& trees);
  // samples.count may be 0.
  void build(const ShadingSamples& samples, CellLists& lists);

  // Device bytes of the lists of n samples, and of the scratch memory kept for building them, at most: without the
  // grid's, the trees' and the scan's.
  static uint64_t listBytes(uint64_t samples);
  static uint64_t scratchBytes(uint64_t samples);
  // Words of the longest scan.
  static uint64_t scanWords(uint64_t samples);

 private:
  void makeRoots(CellLists& lists);
  // Splits root cells, and then leaves that hold many samples, level by level.
  void split(CellLists& lists);
  uint32_t splitLevel(CellLists& lists, uint32_t first, uint32_t level);
  void fillLists(CellLists& lists);
  void findLists(CellLists& lists, bool in_trees);

  Device& device_;
  Scan& scan_;
  KeyTable& table_;
  SampleGridBuilder& grids_;
  TreeBuilder& trees_;
  Kernel primitives_kernel_, roots_kernel_, split_kernel_, children_kernel_, count_kernel_, near_kernel_, far_kernel_,
      write_kernel_, advance_kernel_;
  SampleGrid grid_;
  Buffer<uint32_t> first_nodes_;  // per primitive
  struct Place {
    Vec2f corner;
    uint32_t primitive, bits;
  };
  Buffer<Place> places_;              // per node
  Buffer<uint32_t> counts_, starts_;  // per node
  Buffer<uint32_t> lists_, totals_;
};

class CellListSearch {
 public:
  explicit CellListSearch(Device& device);
  // Records: writes aa.shade, as ReuseKernels::findNearest() says (without footprints).
  void record(Commands& commands, const CellLists& lists, AaSamples& aa);

 private:
  Kernel find_, single_;
};

}  // namespace encore
