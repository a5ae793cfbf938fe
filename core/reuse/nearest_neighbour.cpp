#include "core/reuse/nearest_neighbour.h"

#include "kernels/reuse/nearest_neighbour.h"
#include "kernels/reuse/nearest_neighbour_grouped.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kRounds = 4;  // samples per invocation of nearest_neighbour_grouped.comp

struct Arguments {  // of nearest_neighbour.comp; the grouped kernel's are the same without the last
  uint64_t primitives, slots, nodes, lowest_ids, points, ids, keys, uv, shade;
  uint32_t count, capacity, only_pending;
};

}  // namespace

NearestNeighbour::NearestNeighbour(Device& device, Walk walk)
    : walk_(walk), single_(device, "nearest_neighbour", kNearestNeighbourSpirv) {
  if (walk == Walk::kGrouped) grouped_ = {device, "nearest_neighbour_grouped", kNearestNeighbourGroupedSpirv};
}

void NearestNeighbour::record(Commands& commands, const Trees& trees, AaSamples& aa) {
  const bool grouped = walk_ == Walk::kGrouped;
  const Arguments arguments{trees.primitives.address(),
                            trees.table.address(),
                            trees.nodes.address(),
                            trees.lowest_ids.address(),
                            trees.points.address(),
                            trees.ids.address(),
                            aa.key.address(),
                            aa.uv.address(),
                            aa.shade.address(),
                            aa.count,
                            uint32_t(trees.table.size()),
                            grouped};
  if (grouped) commands.dispatch(grouped_, groupsFor(aa.count, kLocalSize * kRounds), arguments);
  commands.dispatch(single_, groupsFor(aa.count, kLocalSize), arguments);
}

}  // namespace encore
