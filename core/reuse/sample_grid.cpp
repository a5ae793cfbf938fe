#include "core/reuse/sample_grid.h"

#include <bit>
#include <string>

#include "core/reuse/sample_grid_arguments.h"
#include "core/scene/error.h"
#include "kernels/reuse/sample_grid_cells.h"
#include "kernels/reuse/sample_grid_extents.h"
#include "kernels/reuse/sample_grid_heads.h"
#include "kernels/reuse/sample_grid_layout.h"
#include "kernels/reuse/sample_grid_place.h"
#include "kernels/reuse/sample_grid_points.h"
#include "kernels/reuse/sample_grid_primitives.h"
#include "kernels/reuse/sample_grid_shape.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kRunLength = 72;  // of samples that one invocation takes, where neighbours are to be joined

struct PointsArguments {  // of sample_grid_points.comp
  uint64_t uv, points;
  uint32_t count;
};
struct HeadsArguments {  // of sample_grid_heads.comp
  uint64_t keys, order, marks;
  uint32_t count;
};
struct PrimitivesArguments {  // of sample_grid_primitives.comp
  uint64_t keys, order, heads, primitives;
  uint32_t count;
};
struct PlaceArguments {  // of sample_grid_place.comp
  uint64_t points, order, cells, grid_points, grid_ids, cell_counts;
  uint32_t count, run_length;
};

}  // namespace

SampleGridBuilder::SampleGridBuilder(Device& device, Scan& scan, RadixSort& sort, KeyTable& table)
    : device_(device),
      scan_(scan),
      sort_(sort),
      table_(table),
      points_kernel_(device, "sample_grid_points", kSampleGridPointsSpirv),
      heads_kernel_(device, "sample_grid_heads", kSampleGridHeadsSpirv),
      primitives_kernel_(device, "sample_grid_primitives", kSampleGridPrimitivesSpirv),
      extents_kernel_(device, "sample_grid_extents", kSampleGridExtentsSpirv),
      shape_kernel_(device, "sample_grid_shape", kSampleGridShapeSpirv),
      layout_kernel_(device, "sample_grid_layout", kSampleGridLayoutSpirv),
      cells_kernel_(device, "sample_grid_cells", kSampleGridCellsSpirv),
      place_kernel_(device, "sample_grid_place", kSampleGridPlaceSpirv) {}

void SampleGridBuilder::reserve(uint32_t count) {
  points_.reserve(device_, count, "grid scratch points");
  heads_.reserve(device_, size_t(count) + 1, "grid scratch heads");
  cells_.reserve(device_, count, "grid scratch cells");
  sort_.reserve(count);
  scan_.reserve(count + 1);
}

void SampleGridBuilder::build(const ShadingSamples& samples, SampleGrid& grid, float samples_per_cell) {
  grid.sample_count = samples.count;
  grid.primitive_count = grid.cell_count = grid.subgrid_count = 0;
  grid.max_cell = 0xffffffffu;
  if (samples.count == 0) return;
  if (samples.count > kMaxSortValues) {
    throw Error(ErrorKind::Memory, std::to_string(samples.count) + " shading samples are too many for one tile");
  }
  reserve(samples.count);
  grid.primitive_count = sortByPrimitive(samples);
  shape(samples, grid, samples_per_cell);
  fillCells(grid);
}

uint32_t SampleGridBuilder::sortByPrimitive(const ShadingSamples& samples) {
  const uint32_t count = samples.count;
  const uint64_t keys = samples.key.address();
  Commands commands(device_);
  sort_.recordVaryingBits(commands, keys, count);
  commands.dispatch(points_kernel_, groupsFor(count, kLocalSize),
                    PointsArguments{samples.uv.address(), points_.address(), count});
  commands.run();
  const auto key_bits = sort_.varyingBits();

  sort_.recordStart(commands, count);
  sort_.recordBy(commands, count, {keys, 2, 1}, bitRangeOf(key_bits[1]));
  sort_.recordBy(commands, count, {keys, 2, 0}, bitRangeOf(key_bits[0]));
  commands.dispatch(heads_kernel_, groupsFor(uint64_t(count) + 1, kLocalSize),
                    HeadsArguments{keys, sort_.values(), heads_.address(), count});
  scan_.record(commands, heads_.address(), count + 1);
  commands.run();
  heads_.toHost(count, 1);
  return heads_.host()[count];
}

void SampleGridBuilder::shape(const ShadingSamples& samples, SampleGrid& grid, float samples_per_cell) {
  const uint32_t count = samples.count, primitives = grid.primitive_count;
  grid.primitives = {device_, primitives, "grid primitives"};
  ranges_.reserve(device_, size_t(primitives) * 4, "grid scratch ranges");
  cell_counts_.reserve(device_, size_t(primitives) + 1, "grid scratch cell counts");
  Commands commands(device_);
  commands.dispatch(
      primitives_kernel_, groupsFor(count, kLocalSize),
      PrimitivesArguments{samples.key.address(), sort_.values(), heads_.address(), grid.primitives.address(), count});
  commands.fill(ranges_.raw(), 0xffffffffu);
  commands.dispatch(
      extents_kernel_, groupsFor(groupsFor(count, kRunLength), kLocalSize),
      ExtentsArguments{points_.address(), sort_.values(), heads_.address(), ranges_.address(), count, kRunLength});
  const uint64_t groups = groupsFor(uint64_t(primitives) + 1, kLocalSize);
  commands.dispatch(shape_kernel_, groups,
                    ShapeArguments{ranges_.address(), grid.primitives.address(), cell_counts_.address(), primitives,
                                   1 / samples_per_cell, 0});
  scan_.record(commands, cell_counts_.address(), primitives + 1);
  commands.dispatch(layout_kernel_, groups,
                    LayoutArguments{cell_counts_.address(), grid.primitives.address(), primitives, 0});
  commands.run();
  cell_counts_.toHost(primitives, 1);
  grid.cell_count = cell_counts_.host()[primitives];
}

void SampleGridBuilder::fillCells(SampleGrid& grid) {
  const uint32_t count = grid.sample_count;
  grid.cell_starts = {device_, size_t(grid.cell_count) + 1, "grid cell starts"};
  grid.points = {device_, count, "grid points"};
  grid.ids = {device_, count, "grid ids"};
  grid.table = table_.create(grid.primitive_count);

  Commands commands(device_);
  commands.dispatch(cells_kernel_, groupsFor(count, kLocalSize),
                    CellsArguments{points_.address(), sort_.values(), heads_.address(), grid.primitives.address(),
                                   cells_.address(), count});
  sort_.recordBy(commands, count, {cells_.address(), 1, 0}, {0, uint32_t(std::bit_width(grid.cell_count - 1))});
  commands.fill(grid.cell_starts.raw(), 0);
  commands.dispatch(place_kernel_, groupsFor(groupsFor(count, kRunLength), kLocalSize),
                    PlaceArguments{points_.address(), sort_.values(), cells_.address(), grid.points.address(),
                                   grid.ids.address(), grid.cell_starts.address(), count, kRunLength});
  scan_.record(commands, grid.cell_starts.address(), grid.cell_count + 1);
  table_.recordInsert(commands, grid.table, grid.primitives.address(), grid.primitive_count, sizeof(GridPrimitive));
  commands.run();
}

// A primitive of one sample costs most: its record, up to four slots of the table, and a cell.
uint64_t SampleGridBuilder::gridBytes(uint64_t samples) {
  return samples * (sizeof(Vec2f) + sizeof(uint32_t) + sizeof(GridPrimitive) + sizeof(uint32_t)) + sizeof(uint32_t) +
         KeyTable::capacityFor(samples) * sizeof(uint32_t);
}

uint64_t SampleGridBuilder::scratchBytes(uint64_t samples) {
  const uint64_t per_sample = sizeof(Vec2f) + 2 * sizeof(uint32_t);
  const uint64_t per_primitive = 5 * sizeof(uint32_t);
  return samples * (per_sample + per_primitive) + 2 * sizeof(uint32_t);
}

}  // namespace encore
