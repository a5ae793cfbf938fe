// Shading samples in a grid per primitive, all built at once: sorted by (primitive, cell, id).
//
// Each primitive has a grid of cells over the bounds of its samples, cells about square, with about
// `samples_per_cell` samples to a cell (its count of samples over it, rounded up, bounds the number of cells).
// A primitive whose samples are at one point, or on a line along an axis, has one cell, or one row or column of them.
// A sample's id is its index in the ShadingSamples that the grid was built from.
// Coordinates are taken to the nearest point of [0, 1]²; what is not a number, or below the smallest normal one,
// counts as 0.
#pragma once

#include <cstdint>

#include "core/reuse/key_table.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/reuse.h"
#include "core/reuse/scan.h"
#include "core/vulkan/device.h"

namespace encore {

// shaders/reuse/sample_grid.glsl declares the same.
struct GridPrimitive {
  SurfaceKey key;
  uint32_t first, count;  // its samples are first .. first + count in points and ids; count is at least 1
  uint32_t first_cell;    // its cell (i, j) is first_cell + j * columns + i
  uint32_t columns, rows;
  Vec2f low;             // corner of the grid
  Vec2f cells_per_unit;  // 1 / size of a cell; 0 along an axis that has one cell
};
static_assert(sizeof(GridPrimitive) == 44);

struct SampleGrid {
  uint32_t sample_count = 0, primitive_count = 0, cell_count = 0;
  Buffer<GridPrimitive> primitives;  // in order of their keys
  Buffer<uint32_t> cell_starts;      // cell_count + 1: first sample of each cell
  Buffer<Vec2f> points;              // in order of (primitive, cell, id)
  Buffer<uint32_t> ids;              // of the same
  KeyTable::Slots table;

  // After SampleGridRefiner::refine(): cells of more than max_cell samples have a child, which is the number of a
  // subgrid, kNoChild, or kOnePlace: all samples are equally far from everything, so that only the first, whose id
  // is the lowest, can be found. Subgrids are grids over the bounds of the samples of one cell, which stand in order
  // of its cells then; they have no key. Their cells follow the primitives' in cell_starts, from cell_count + 1 on,
  // with one more after the cells of each, so that every cell ends where the next number starts.
  static constexpr uint32_t kNoChild = 0xffffffffu, kOnePlace = 0xfffffffeu;
  uint32_t max_cell = 0xffffffffu;  // as here: no cell has a child
  uint32_t subgrid_count = 0;
  Buffer<GridPrimitive> subgrids;
  Buffer<uint32_t> children;  // per entry of cell_starts; empty when no cell has one
};

class SampleGridBuilder {
 public:
  SampleGridBuilder(Device& device, Scan& scan, RadixSort& sort, KeyTable& table);
  // samples.count may be 0. samples_per_cell: above 0; a primitive has at least one cell, and at most as many
  // as samples.
  void build(const ShadingSamples& samples, SampleGrid& grid, float samples_per_cell);

  // Device bytes of the grid of n samples, and of the scratch memory kept for building it, at most:
  // without the sort's and the scan's.
  static uint64_t gridBytes(uint64_t samples);
  static uint64_t scratchBytes(uint64_t samples);

 private:
  void reserve(uint32_t count);
  // Sorts by (key, id) and returns the number of primitives.
  uint32_t sortByPrimitive(const ShadingSamples& samples);
  void shape(const ShadingSamples& samples, SampleGrid& grid, float samples_per_cell);
  void fillCells(SampleGrid& grid);

  Device& device_;
  Scan& scan_;
  RadixSort& sort_;
  KeyTable& table_;
  Kernel points_kernel_, heads_kernel_, primitives_kernel_, extents_kernel_, shape_kernel_, layout_kernel_,
      cells_kernel_, place_kernel_;
  Buffer<Vec2f> points_;                   // by sample id, in the unit square
  Buffer<uint32_t> heads_, cells_;         // per sample
  Buffer<uint32_t> ranges_, cell_counts_;  // per primitive
};

}  // namespace encore
