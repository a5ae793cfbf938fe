#include "core/reuse/nearest_neighbour.h"

#include "kernels/reuse/nearest_neighbour.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;

struct Arguments {  // of nearest_neighbour.comp
  uint64_t primitives, slots, nodes, lowest_ids, points, ids, keys, uv, shade;
  uint32_t count, capacity;
};

}  // namespace

NearestNeighbour::NearestNeighbour(Device& device) : kernel_(device, "nearest_neighbour", kNearestNeighbourSpirv) {}

void NearestNeighbour::record(Commands& commands, const Trees& trees, AaSamples& aa) {
  commands.dispatch(kernel_, groupsFor(aa.count, kLocalSize),
                    Arguments{trees.primitives.address(), trees.table.address(), trees.nodes.address(),
                              trees.lowest_ids.address(), trees.points.address(), trees.ids.address(),
                              aa.key.address(), aa.uv.address(), aa.shade.address(), aa.count,
                              uint32_t(trees.table.size())});
}

}  // namespace encore
