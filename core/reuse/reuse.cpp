#include "core/reuse/reuse.h"

#include <algorithm>

#include "core/reuse/cell_lists.h"
#include "core/reuse/compaction.h"
#include "core/reuse/failures.h"
#include "core/reuse/key_table.h"
#include "core/reuse/limit_distance.h"
#include "core/reuse/nearest_neighbour.h"
#include "core/reuse/pixel_groups.h"
#include "core/reuse/radix_sort.h"
#include "core/reuse/sample_grid.h"
#include "core/reuse/sample_grid_refiner.h"
#include "core/reuse/scan.h"
#include "core/reuse/trees.h"
#include "core/scene/error.h"
#include "core/scene/text.h"

namespace encore {
namespace {

constexpr uint64_t kAlignmentSlack = 64 * 1024;  // what rounding up some thirty buffers may take
constexpr float kLargestFootprintWeight = 1e6f;  // as in Settings

// Of the sort of n values, and of the scan where the longest has so many words.
uint64_t sortBytes(uint64_t values, uint64_t scan_words) {
  return RadixSort::scratchBytes(values) + Scan::scratchBytes(std::max(RadixSort::scanWords(values), scan_words)) +
         kAlignmentSlack;
}

uint64_t treeBytes(uint64_t samples) { return TreeBuilder::treeBytes(samples) + TreeBuilder::scratchBytes(samples); }

uint64_t cellBytes(uint64_t samples) {
  return SampleGridBuilder::gridBytes(samples) + SampleGridBuilder::scratchBytes(samples) +
         CellListBuilder::listBytes(samples) + CellListBuilder::scratchBytes(samples);
}

void checkIndex(const ShadingSamples& samples, Search search, float footprint_weight) {
  if (search == Search::Auto) throw Error(ErrorKind::Internal, "An index needs a search to be made for");
  if (!(footprint_weight >= 0 && footprint_weight <= kLargestFootprintWeight)) {
    throw Error(ErrorKind::Internal, "A footprint weight of " + text(footprint_weight));
  }
  if (!samples.aspect.empty() && (search != Search::Tree || samples.aspect.size() < samples.count)) {
    throw Error(ErrorKind::Internal, "Only trees are searched by time and direction, with those of every sample");
  }
  if (footprint_weight == 0) return;
  if (search != Search::Tree) throw Error(ErrorKind::Internal, "Only trees are searched in the footprint metric");
  if (samples.footprint.size() < samples.count) {
    throw Error(ErrorKind::Internal, "The footprint metric needs the footprints of all shading samples");
  }
}

}  // namespace

struct SearchIndex {
  Search search = Search::Tree;
  Trees trees;  // only what the search needs is filled
  SampleGrid grid;
  CellLists lists;
};

struct ReuseKernels::Impl {
  explicit Impl(Device& owner)
      : device(owner),
        scan(owner),
        sort(owner, scan),
        compaction(owner, scan),
        table(owner),
        tree_builder(owner, scan, sort, table),
        grid_builder(owner, scan, sort, table),
        grid_refiner(owner, scan, sort),
        list_builder(owner, scan, table, grid_builder, tree_builder),
        nearest(owner),
        groups(owner),
        cells(owner),
        limit(owner),
        failures(owner, scan, compaction) {}

  Device& device;
  Scan scan;
  RadixSort sort;
  Compaction compaction;
  KeyTable table;
  TreeBuilder tree_builder;
  SampleGridBuilder grid_builder;
  SampleGridRefiner grid_refiner;
  CellListBuilder list_builder;
  NearestNeighbour nearest;
  PixelGroups groups;
  CellListSearch cells;
  LimitDistance limit;
  Failures failures;
};

ReuseKernels::ReuseKernels(Device& device) : impl_(std::make_unique<Impl>(device)) {}
ReuseKernels::~ReuseKernels() = default;

SearchIndexPointer ReuseKernels::buildIndex(const ShadingSamples& samples, Search search, float footprint_weight) {
  checkIndex(samples, search, footprint_weight);
  SearchIndexPointer index(new SearchIndex, [](SearchIndex* made) { delete made; });
  index->search = search;
  switch (search) {
    case Search::Groups:
      impl_->grid_builder.build(samples, index->grid, PixelGroups::kSamplesPerCell);
      impl_->grid_refiner.refine(index->grid, PixelGroups::kSamplesPerCell, PixelGroups::kMaxCell);
      break;
    case Search::Cells:
      impl_->list_builder.build(samples, index->lists);
      break;
    default:
      impl_->tree_builder.build(samples, index->trees, footprint_weight);
  }
  return index;
}

void ReuseKernels::findNearest(const SearchIndex& index, AaSamples& aa) {
  Commands commands(impl_->device);
  switch (index.search) {
    case Search::Groups:
      impl_->groups.record(commands, index.grid, aa);
      break;
    case Search::Cells:
      impl_->cells.record(commands, index.lists, aa);
      break;
    default:
      impl_->nearest.record(commands, index.trees, aa);
  }
  commands.run();
}

void ReuseKernels::limitDistance(const ShadingSamples& samples, AaSamples& aa, float limit) {
  Commands commands(impl_->device);
  impl_->limit.record(commands, samples, aa, limit);
  commands.run();
}

std::vector<uint32_t> ReuseKernels::serveFailures(AaSamples& aa, uint32_t first_shade, Share share) {
  return impl_->failures.serve(aa, first_shade, share);
}

uint64_t ReuseKernels::indexBytes(uint64_t samples, Search search) {
  switch (search) {
    case Search::Tree:
      return treeBytes(samples) + sortBytes(samples, samples + 1);
    case Search::Groups:
      return PixelGroups::bytes(samples) +
             sortBytes(samples, SampleGridRefiner::kMaxCellsPerSample * samples + samples + 1);
    case Search::Cells:  // trees too: some lists may be too long
      return cellBytes(samples) + treeBytes(samples) + sortBytes(samples, CellListBuilder::scanWords(samples));
    case Search::Auto:
      break;
  }
  return std::max(
      {indexBytes(samples, Search::Tree), indexBytes(samples, Search::Groups), indexBytes(samples, Search::Cells)});
}

uint64_t ReuseKernels::failureBytes(uint64_t slots) {
  const uint64_t scanned = std::max(Failures::scanWords(slots), Compaction::scanWords(slots));
  return Failures::scratchBytes(slots) + Compaction::scratchBytes(slots) + Scan::scratchBytes(scanned) +
         kAlignmentSlack;
}

}  // namespace encore
