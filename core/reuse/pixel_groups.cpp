#include "core/reuse/pixel_groups.h"

#include <algorithm>
#include <bit>

#include "core/reuse/sample_grid_refiner.h"
#include "kernels/reuse/pixel_groups.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;

struct Arguments {  // of pixel_groups.glsl
  uint64_t primitives, slots, subgrids, children, cell_starts, points, ids, keys, uv, shade;
  uint32_t count, capacity, samples_per_pixel, max_cell;
};

}  // namespace

PixelGroups::PixelGroups(Device& device) : device_(device) {}

// Enough samples per lane for a pixel, or for some pixels when they have few samples.
const Kernel& PixelGroups::groupedKernel(uint32_t samples_per_pixel, uint32_t& rounds) {
  const uint32_t size = std::clamp(device_.info().subgroup_size, 1u, kLocalSize);
  const uint32_t wanted = std::max<uint32_t>(uint32_t(groupsFor(samples_per_pixel, size)), 4);
  const uint32_t bits = std::min<uint32_t>(uint32_t(std::bit_width(wanted - 1)), kMaxRoundBits);
  rounds = 1u << bits;
  Kernel& kernel = grouped_[bits];
  if (kernel.impl() == nullptr) {
    kernel = {device_, "pixel_groups", kPixelGroupsSpirv, std::array<uint32_t, 1>{rounds}};
  }
  return kernel;
}

void PixelGroups::record(Commands& commands, const SampleGrid& grid, AaSamples& aa) {
  if (aa.count == 0) return;
  const Arguments arguments{grid.primitives.address(),
                            grid.table.address(),
                            grid.subgrids.address(),
                            grid.children.address(),
                            grid.cell_starts.address(),
                            grid.points.address(),
                            grid.ids.address(),
                            aa.key.address(),
                            aa.uv.address(),
                            aa.shade.address(),
                            aa.count,
                            uint32_t(grid.table.size()),
                            aa.samples_per_pixel,
                            grid.max_cell};
  uint32_t rounds = 0;
  const Kernel& grouped = groupedKernel(aa.samples_per_pixel, rounds);
  // A subgroup takes up to kLocalSize * rounds samples, and more than one turn where that is not enough.
  const uint64_t size = std::clamp(device_.info().subgroup_size, 1u, kLocalSize);
  const uint64_t most = size * rounds;
  const uint64_t pixels = std::max<uint64_t>(most / aa.samples_per_pixel, 1);
  const uint64_t parts = groupsFor(aa.samples_per_pixel, uint32_t(most));
  const uint64_t units = (aa.count + pixels * aa.samples_per_pixel - 1) / (pixels * aa.samples_per_pixel) * parts;
  commands.dispatch(grouped, (units * size + kLocalSize - 1) / kLocalSize, arguments);
}

uint64_t PixelGroups::bytes(uint64_t samples) {
  return SampleGridBuilder::gridBytes(samples) + SampleGridBuilder::scratchBytes(samples) +
         SampleGridRefiner::refinementBytes(samples);
}

}  // namespace encore
