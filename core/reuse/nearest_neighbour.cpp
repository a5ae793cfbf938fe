#include "core/reuse/nearest_neighbour.h"

#include "core/scene/error.h"
#include "kernels/reuse/nearest_neighbour.h"
#include "kernels/reuse/nearest_neighbour_grouped.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kRounds = 4;  // samples per invocation of nearest_neighbour_grouped.comp

struct Arguments {  // of nearest_neighbour.comp and nearest_neighbour_grouped.comp
  uint64_t primitives, slots, nodes, lowest_ids, points, ids, keys, uv, shade, radii, footprints, footprint_ranges;
  uint32_t count, capacity, only_pending;
  float weight;
  uint64_t aspects, sample_aspects;  // only of the first
};

}  // namespace

NearestNeighbour::NearestNeighbour(Device& device, Walk walk) : device_(device), walk_(walk) {}

NearestNeighbour::Kernels& NearestNeighbour::kernels(bool metric, bool aspects) {
  Kernels& made = kernels_[metric][aspects];
  if (made.single.impl() != nullptr) return made;
  const std::array<uint32_t, 2> constants{metric, aspects};  // kMetric, kAspects
  made.single = {device_, metric ? "nearest_in_metric" : "nearest_neighbour", kNearestNeighbourSpirv, constants};
  if (walk_ == Walk::kGrouped && !aspects) {
    made.grouped = {device_, metric ? "nearest_in_metric_grouped" : "nearest_neighbour_grouped",
                    kNearestNeighbourGroupedSpirv, std::array<uint32_t, 1>{metric}};
  }
  return made;
}

void NearestNeighbour::record(Commands& commands, const Trees& trees, AaSamples& aa) {
  const bool metric = trees.footprint_weight > 0, aspects = trees.sample_aspects != 0;
  const bool grouped = walk_ == Walk::kGrouped && !aspects;
  if (aspects && aa.aspect.size() < aa.count) {
    throw Error(ErrorKind::Internal, "A distance in time and direction needs those of all antialiasing samples");
  }
  if (metric && aa.footprint.size() < aa.count) {
    throw Error(ErrorKind::Internal, "The footprint metric needs the footprints of all antialiasing samples");
  }
  const Arguments arguments{trees.primitives.address(),
                            trees.table.address(),
                            trees.nodes.address(),
                            trees.lowest_ids.address(),
                            trees.points.address(),
                            trees.ids.address(),
                            aa.key.address(),
                            aa.uv.address(),
                            aa.shade.address(),
                            aa.footprint.address(),
                            trees.footprints.address(),
                            trees.footprint_ranges.address(),
                            aa.count,
                            uint32_t(trees.table.size()),
                            grouped,
                            trees.footprint_weight,
                            aspects ? aa.aspect.address() : 0,
                            trees.sample_aspects};
  const Kernels& by = kernels(metric, aspects);
  if (grouped) commands.dispatch(by.grouped, groupsFor(aa.count, kLocalSize * kRounds), arguments);
  commands.dispatch(by.single, groupsFor(aa.count, kLocalSize), arguments);
}

}  // namespace encore
