// Gives every crowded cell of a SampleGrid a grid of its own, and so on, so that search takes about as long
// whatever the density of samples: a ground plane up to the horizon, a million samples at one place.
#pragma once

#include <cstdint>
#include <vector>

#include "core/reuse/radix_sort.h"
#include "core/reuse/sample_grid.h"
#include "core/reuse/scan.h"
#include "core/vulkan/device.h"

namespace encore {

class SampleGridRefiner {
 public:
  // Cells of all subgrids together, per sample, at most: crowded cells beyond that stay as they are.
  static constexpr uint32_t kMaxCellsPerSample = 2;

  SampleGridRefiner(Device& device, Scan& scan, RadixSort& sort);
  // The grid must be as built. max_cell: at least 16, and at least twice samples_per_cell, which is at least 1.
  void refine(SampleGrid& grid, float samples_per_cell, uint32_t max_cell);

  // Device bytes that refinement adds to the grid of n samples, and of the scratch memory kept for it, at most:
  // without the sort's and the scan's. Samples of crowded cells only: a grid of many primitives has few of them.
  static uint64_t refinementBytes(uint64_t samples);

 private:
  // The grids made from the crowded cells of the level before, and their cells.
  struct Level {
    uint32_t grid_count = 0, cell_count = 0, item_count = 0;
    uint32_t first_grid = 0, first_cell = 0;  // numbers of the first of them
    Buffer<GridPrimitive> grids;
    Buffer<uint32_t> cell_starts, children;
  };
  // What of a level's cells is to be refined: how many grids and items the next has.
  void mark(uint64_t item_starts, Level& level, uint64_t grids, uint32_t grid_count, uint32_t max_cell, Level& next);
  void list(const SampleGrid& grid, uint64_t cell_starts, Level& level, Level& next, float samples_per_cell);
  void fill(SampleGrid& grid, Level& level);
  void join(SampleGrid& grid, const std::vector<Level>& levels);

  Device& device_;
  Scan& scan_;
  RadixSort& sort_;
  Kernel places_kernel_, mark_kernel_, list_kernel_, gather_kernel_, extents_kernel_, shape_kernel_, layout_kernel_,
      cells_kernel_, place_kernel_, starts_kernel_, copy_kernel_;
  Buffer<Vec2f> points_;                                 // per item
  Buffer<uint32_t> ids_, heads_, cells_;                 // per item
  Buffer<uint32_t> ranges_, first_items_, first_cells_;  // per grid of a level
  Buffer<uint32_t> marks_, items_, item_starts_;         // per cell of a level
};

}  // namespace encore
