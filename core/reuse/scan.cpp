#include "core/reuse/scan.h"

#include <array>

#include "core/scene/error.h"
#include "kernels/reuse/scan_apply.h"
#include "kernels/reuse/scan_reduce.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
// Words per invocation. Not a power of two: neighbouring lanes would compete for the same cache sets.
constexpr uint32_t kRunLength = 504;

struct Arguments {  // of scan_reduce.comp and scan_apply.comp
  uint64_t words, sums;
  uint32_t count, run_length;
};

uint32_t runsOf(uint32_t count) { return uint32_t(groupsFor(count, kRunLength)); }

}  // namespace

Scan::Scan(Device& device)
    : device_(device),
      reduce_(device, "scan_reduce", kScanReduceSpirv),
      apply_(device, "scan_apply", kScanApplySpirv) {}

uint64_t Scan::scratchBytes(uint64_t count) {
  uint64_t words = 0;
  while (count > kRunLength) words += count = groupsFor(count, kRunLength);
  return words * sizeof(uint32_t);
}

void Scan::reserve(uint32_t count) { sums_.reserve(device_, scratchBytes(count) / sizeof(uint32_t), "scan sums"); }

// The sums of a level's runs are the words of the next level, until one run holds all.
void Scan::record(Commands& commands, uint64_t words, uint32_t count) {
  if (count > kMaxScanWords || scratchBytes(count) > sums_.size() * sizeof(uint32_t)) {
    throw Error(ErrorKind::Internal, "A scan of " + std::to_string(count) + " words was not reserved");
  }
  std::array<Arguments, 8> levels;
  size_t depth = 0;
  uint64_t used = 0;
  for (;; ++depth) {
    levels[depth] = {words, sums_.address(used), count, kRunLength};
    if (count <= kRunLength) break;
    commands.dispatch(reduce_, groupsFor(runsOf(count), kLocalSize), levels[depth]);
    words = levels[depth].sums;
    count = runsOf(count);
    used += count;
  }
  for (size_t level = depth + 1; level-- > 0;) {
    commands.dispatch(apply_, groupsFor(runsOf(levels[level].count), kLocalSize), levels[level]);
  }
}

}  // namespace encore
