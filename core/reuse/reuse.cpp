#include "core/reuse/reuse.h"

#include <algorithm>

#include "core/reuse/compaction.h"
#include "core/reuse/failures.h"
#include "core/reuse/key_table.h"
#include "core/reuse/nearest_neighbour.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/scan.h"
#include "core/reuse/trees.h"

namespace encore {
namespace {

constexpr uint64_t kAlignmentSlack = 64 * 1024;  // what rounding up some thirty buffers may take

uint64_t sortBytes(uint64_t values) {
  return RadixSort::scratchBytes(values) + Scan::scratchBytes(std::max(RadixSort::scanWords(values), values + 1)) +
         kAlignmentSlack;
}

}  // namespace

struct ReuseKernels::Impl {
  explicit Impl(Device& owner)
      : device(owner),
        scan(owner),
        sort(owner, scan),
        compaction(owner, scan),
        table(owner),
        builder(owner, scan, sort, table),
        nearest(owner),
        failures(owner, scan, sort, compaction) {}

  Device& device;
  Scan scan;
  RadixSort sort;
  Compaction compaction;
  KeyTable table;
  TreeBuilder builder;
  NearestNeighbour nearest;
  Failures failures;
};

ReuseKernels::ReuseKernels(Device& device) : impl_(std::make_unique<Impl>(device)) {}
ReuseKernels::~ReuseKernels() = default;

std::unique_ptr<Trees, void (*)(Trees*)> ReuseKernels::buildTrees(const ShadingSamples& samples) {
  std::unique_ptr<Trees, void (*)(Trees*)> trees(new Trees, [](Trees* made) { delete made; });
  impl_->builder.build(samples, *trees);
  return trees;
}

void ReuseKernels::findNearest(const Trees& trees, AaSamples& aa) {
  Commands commands(impl_->device);
  impl_->nearest.record(commands, trees, aa);
  commands.run();
}

std::vector<uint32_t> ReuseKernels::serveFailures(AaSamples& aa, uint32_t first_shade, bool share) {
  return impl_->failures.serve(aa, first_shade, share);
}

uint64_t ReuseKernels::treeBytes(uint64_t samples) {
  return TreeBuilder::treeBytes(samples) + TreeBuilder::scratchBytes(samples) + sortBytes(samples);
}

uint64_t ReuseKernels::failureBytes(uint64_t slots) {
  return Failures::scratchBytes(slots) + Compaction::scratchBytes(slots) + sortBytes(slots);
}

}  // namespace encore
