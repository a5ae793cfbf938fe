#include "core/reuse/sample_grid_refiner.h"

#include <bit>
#include <utility>

#include "core/reuse/sample_grid_arguments.h"
#include "kernels/reuse/sample_grid_cells.h"
#include "kernels/reuse/sample_grid_copy.h"
#include "kernels/reuse/sample_grid_extents.h"
#include "kernels/reuse/sample_grid_layout.h"
#include "kernels/reuse/sample_grid_refine_gather.h"
#include "kernels/reuse/sample_grid_refine_list.h"
#include "kernels/reuse/sample_grid_refine_mark.h"
#include "kernels/reuse/sample_grid_refine_place.h"
#include "kernels/reuse/sample_grid_refine_places.h"
#include "kernels/reuse/sample_grid_refine_starts.h"
#include "kernels/reuse/sample_grid_shape.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kRunLength = 72;  // of items that one invocation takes, where neighbours are to be joined

struct PlacesArguments {  // of sample_grid_refine_places.comp
  uint64_t grids, children;
  uint32_t grid_count, first_cell, cell_count, max_cell;
};
struct MarkArguments {  // of sample_grid_refine_mark.comp
  uint64_t starts, children, marks, items;
  uint32_t cell_count, max_cell;
};
struct ListArguments {  // of sample_grid_refine_list.comp
  uint64_t cell_starts, marks, items, children, grids, first_items;
  uint32_t cell_count, first_grid;
};
struct GatherArguments {  // of sample_grid_refine_gather.comp
  uint64_t grid_points, grid_ids, grids, first_items, points, ids, heads;
  uint32_t item_count, grid_count;
};
struct PlaceArguments {  // of sample_grid_refine_place.comp
  uint64_t points, ids, order, cells, heads, grids, first_items, grid_points, grid_ids, cell_counts;
  uint32_t item_count, first_cell;
};
struct StartsArguments {  // of sample_grid_refine_starts.comp
  uint64_t item_starts, first_cells, grids, first_items, cell_starts;
  uint32_t cell_count, grid_count;
};
struct CopyArguments {  // of sample_grid_copy.comp
  uint64_t source, target;
  uint32_t count;
};

}  // namespace

SampleGridRefiner::SampleGridRefiner(Device& device, Scan& scan, RadixSort& sort)
    : device_(device),
      scan_(scan),
      sort_(sort),
      places_kernel_(device, "sample_grid_refine_places", kSampleGridRefinePlacesSpirv),
      mark_kernel_(device, "sample_grid_refine_mark", kSampleGridRefineMarkSpirv),
      list_kernel_(device, "sample_grid_refine_list", kSampleGridRefineListSpirv),
      gather_kernel_(device, "sample_grid_refine_gather", kSampleGridRefineGatherSpirv),
      extents_kernel_(device, "sample_grid_extents", kSampleGridExtentsSpirv),
      shape_kernel_(device, "sample_grid_shape", kSampleGridShapeSpirv),
      layout_kernel_(device, "sample_grid_layout", kSampleGridLayoutSpirv),
      cells_kernel_(device, "sample_grid_cells", kSampleGridCellsSpirv),
      place_kernel_(device, "sample_grid_refine_place", kSampleGridRefinePlaceSpirv),
      starts_kernel_(device, "sample_grid_refine_starts", kSampleGridRefineStartsSpirv),
      copy_kernel_(device, "sample_grid_copy", kSampleGridCopySpirv) {}

void SampleGridRefiner::refine(SampleGrid& grid, float samples_per_cell, uint32_t max_cell) {
  grid.max_cell = max_cell;
  grid.subgrid_count = 0;
  grid.subgrids = {};
  grid.children = {};
  if (grid.sample_count <= max_cell) return;
  std::vector<Level> levels(2);
  levels[0].cell_count = grid.cell_count;
  mark(grid.cell_starts.address(), levels[0], grid.primitives.address(), grid.primitive_count, max_cell, levels[1]);
  levels[0].children.toHost(grid.cell_count, 1);
  if (levels[1].grid_count == 0 && levels[0].children.host()[grid.cell_count] != SampleGrid::kOnePlace) {
    grid.max_cell = 0xffffffffu;
    return;
  }
  uint64_t cells = 0;
  uint64_t starts = grid.cell_starts.address();
  while (levels.back().grid_count > 0) {
    Level &last = levels[levels.size() - 2], &level = levels.back();
    level.first_grid = last.first_grid + last.grid_count;
    level.first_cell = last.first_cell + last.cell_count + (levels.size() == 2);
    // As many cells as samples_per_cell asks for, and the spare ones.
    cells += uint64_t(float(level.item_count) / samples_per_cell) + 2 * uint64_t(level.grid_count);
    if (cells > uint64_t(grid.sample_count) * kMaxCellsPerSample) break;
    list(grid, starts, last, level, samples_per_cell);
    fill(grid, level);
    Level next;
    mark(item_starts_.address(), level, level.grids.address(), level.grid_count, max_cell, next);
    starts = level.cell_starts.address();
    levels.push_back(std::move(next));
  }
  levels.pop_back();
  join(grid, levels);
}

void SampleGridRefiner::mark(uint64_t item_starts, Level& level, uint64_t grids, uint32_t grid_count, uint32_t max_cell,
                             Level& next) {
  const uint32_t cells = level.cell_count;
  level.children = {device_, size_t(cells) + 1, "grid children of a level"};
  marks_.reserve(device_, size_t(cells) + 1, "refinement scratch marks");
  items_.reserve(device_, size_t(cells) + 1, "refinement scratch items");
  scan_.reserve(cells + 1);
  Commands commands(device_);
  commands.fill(level.children.raw(), SampleGrid::kNoChild);
  commands.dispatch(places_kernel_, groupsFor(grid_count, kLocalSize),
                    PlacesArguments{grids, level.children.address(), grid_count, level.first_cell, cells, max_cell});
  commands.dispatch(
      mark_kernel_, groupsFor(uint64_t(cells) + 1, kLocalSize),
      MarkArguments{item_starts, level.children.address(), marks_.address(), items_.address(), cells, max_cell});
  scan_.record(commands, marks_.address(), cells + 1);
  scan_.record(commands, items_.address(), cells + 1);
  commands.run();
  marks_.toHost(cells, 1);
  items_.toHost(cells, 1);
  next.grid_count = marks_.host()[cells];
  next.item_count = items_.host()[cells];
}

// Makes the grids of `next` from the marked cells of `level`: their samples, bounds and cells.
void SampleGridRefiner::list(const SampleGrid& grid, uint64_t cell_starts, Level& level, Level& next,
                             float samples_per_cell) {
  const uint32_t grids = next.grid_count, items = next.item_count;
  next.grids = {device_, grids, "grids of a level"};
  points_.reserve(device_, items, "refinement scratch points");
  ids_.reserve(device_, items, "refinement scratch ids");
  heads_.reserve(device_, size_t(items) + 1, "refinement scratch heads");
  ranges_.reserve(device_, size_t(grids) * 4, "refinement scratch ranges");
  first_items_.reserve(device_, grids, "refinement scratch first items");
  first_cells_.reserve(device_, size_t(grids) + 1, "refinement scratch first cells");
  sort_.reserve(items);
  Commands commands(device_);
  commands.dispatch(list_kernel_, groupsFor(level.cell_count, kLocalSize),
                    ListArguments{cell_starts, marks_.address(), items_.address(), level.children.address(),
                                  next.grids.address(), first_items_.address(), level.cell_count, next.first_grid});
  commands.dispatch(
      gather_kernel_, groupsFor(items, kLocalSize),
      GatherArguments{grid.points.address(), grid.ids.address(), next.grids.address(), first_items_.address(),
                      points_.address(), ids_.address(), heads_.address(), items, grids});
  sort_.recordStart(commands, items);
  commands.fill(ranges_.raw(), 0xffffffffu);
  commands.dispatch(
      extents_kernel_, groupsFor(groupsFor(items, kRunLength), kLocalSize),
      ExtentsArguments{points_.address(), sort_.values(), heads_.address(), ranges_.address(), items, kRunLength});
  const uint64_t groups = groupsFor(uint64_t(grids) + 1, kLocalSize);
  commands.dispatch(
      shape_kernel_, groups,
      ShapeArguments{ranges_.address(), next.grids.address(), first_cells_.address(), grids, 1 / samples_per_cell, 1});
  scan_.record(commands, first_cells_.address(), grids + 1);
  commands.dispatch(layout_kernel_, groups,
                    LayoutArguments{first_cells_.address(), next.grids.address(), grids, next.first_cell});
  commands.run();
  first_cells_.toHost(grids, 1);
  next.cell_count = first_cells_.host()[grids];
}

// Sorts a level's items by their cells, and finds where those start.
void SampleGridRefiner::fill(SampleGrid& grid, Level& level) {
  const uint32_t items = level.item_count, cells = level.cell_count;
  level.cell_starts = {device_, cells, "cell starts of a level"};
  item_starts_.reserve(device_, size_t(cells) + 1, "refinement scratch item starts");
  cells_.reserve(device_, items, "refinement scratch cells");
  scan_.reserve(cells + 1);
  Commands commands(device_);
  commands.dispatch(cells_kernel_, groupsFor(items, kLocalSize),
                    CellsArguments{points_.address(), sort_.values(), heads_.address(), level.grids.address(),
                                   cells_.address(), items});
  sort_.recordBy(commands, items, {cells_.address(), 1, 0}, {0, uint32_t(std::bit_width(level.first_cell + cells))});
  commands.fill(item_starts_.raw(), 0);
  commands.dispatch(
      place_kernel_, groupsFor(items, kLocalSize),
      PlaceArguments{points_.address(), ids_.address(), sort_.values(), cells_.address(), heads_.address(),
                     level.grids.address(), first_items_.address(), grid.points.address(), grid.ids.address(),
                     item_starts_.address(), items, level.first_cell});
  scan_.record(commands, item_starts_.address(), cells + 1);
  commands.dispatch(starts_kernel_, groupsFor(cells, kLocalSize),
                    StartsArguments{item_starts_.address(), first_cells_.address(), level.grids.address(),
                                    first_items_.address(), level.cell_starts.address(), cells, level.grid_count});
  commands.run();
}

// Puts the levels' arrays one after the other.
void SampleGridRefiner::join(SampleGrid& grid, const std::vector<Level>& levels) {
  const Level& last = levels.back();
  const size_t cells = levels.size() == 1 ? size_t(grid.cell_count) + 1 : size_t(last.first_cell) + last.cell_count;
  grid.subgrid_count = levels.size() == 1 ? 0 : last.first_grid + last.grid_count;
  Buffer<uint32_t> starts(device_, cells, "grid cell starts");
  grid.children = {device_, cells, "grid children"};
  grid.subgrids = {device_, grid.subgrid_count, "subgrids"};
  Commands commands(device_);
  const auto copy = [&](uint64_t from, uint64_t to, uint64_t words) {
    commands.dispatch(copy_kernel_, groupsFor(words, kLocalSize), CopyArguments{from, to, uint32_t(words)});
  };
  copy(grid.cell_starts.address(), starts.address(), uint64_t(grid.cell_count) + 1);
  copy(levels[0].children.address(), grid.children.address(), uint64_t(grid.cell_count) + 1);
  for (size_t i = 1; i < levels.size(); ++i) {
    const Level& level = levels[i];
    copy(level.cell_starts.address(), starts.address(level.first_cell), level.cell_count);
    copy(level.children.address(), grid.children.address(level.first_cell), level.cell_count);
    copy(level.grids.address(), grid.subgrids.address(level.first_grid),
         uint64_t(level.grid_count) * sizeof(GridPrimitive) / 4);
  }
  commands.run();
  grid.cell_starts = std::move(starts);
}

// Per cell of the grid as built: its new start and child, the child before levels are joined, mark and items. Per
// cell of a subgrid: start and child, before and after, mark, items and start among the items. A subgrid has more
// than max_cell >= 16 samples and so at least 8 cells. Per item: point, id, head and cell.
uint64_t SampleGridRefiner::refinementBytes(uint64_t samples) {
  const uint64_t word = sizeof(uint32_t);
  const uint64_t per_cell = 7 * word + (2 * sizeof(GridPrimitive) + 6 * word) / 8;
  return samples * (5 * word + kMaxCellsPerSample * per_cell + sizeof(Vec2f) + 3 * word) + 64 * word;
}

}  // namespace encore
