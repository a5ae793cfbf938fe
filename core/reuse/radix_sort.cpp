#include "core/reuse/radix_sort.h"

#include <algorithm>
#include <bit>
#include <string>

#include "core/scene/error.h"
#include "kernels/reuse/radix_sort_bits.h"
#include "kernels/reuse/radix_sort_count.h"
#include "kernels/reuse/radix_sort_gather.h"
#include "kernels/reuse/radix_sort_scatter.h"
#include "kernels/reuse/radix_sort_start.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kMaxDigitBits = 9;
// Values per invocation: few enough to keep all cores busy, enough to be worth 2^kMaxDigitBits counters.
// Not multiples of 16: neighbouring lanes would compete for the same cache sets.
constexpr uint32_t kMinRunLength = 2056;
constexpr uint32_t kMaxRuns = 4096;
constexpr uint32_t kBitsRunLength = 1032;

struct StartArguments {  // of radix_sort_start.comp
  uint64_t source, target;
  uint32_t count, numbered;
};
struct GatherArguments {  // of radix_sort_gather.comp
  uint64_t words, values, keys;
  uint32_t count, stride, offset;
};
struct BitsArguments {  // of radix_sort_bits.comp
  uint64_t keys, varying_bits;
  uint32_t count, run_length;
};
struct CountArguments {  // of radix_sort_count.comp
  uint64_t keys, counters;
  uint32_t count, run_length, runs, first_bit, digits;
};
struct ScatterArguments {  // of radix_sort_scatter.comp
  uint64_t keys, values, sorted_keys, sorted_values, counters;
  uint32_t count, run_length, runs, first_bit, digits;
};

struct Runs {
  uint32_t length, count;
};

// The number of runs is an odd multiple of 16, so that a digit's counters are whole cache lines and those
// of different digits do not all fall into the same cache sets; the last runs may be empty.
Runs runsOf(uint64_t values) {
  const uint64_t length = std::max<uint64_t>(kMinRunLength, values / kMaxRuns / 16 * 16 + 24);
  return {uint32_t(length), (uint32_t(groupsFor(groupsFor(values, uint32_t(length)), 16)) | 1) * 16};
}

}  // namespace

BitRange bitRangeOf(uint32_t mask) {
  if (mask == 0) return {};
  const uint32_t first = uint32_t(std::countr_zero(mask));
  return {first, 32 - uint32_t(std::countl_zero(mask)) - first};
}

RadixSort::RadixSort(Device& device, Scan& scan)
    : device_(device),
      scan_(scan),
      start_(device, "radix_sort_start", kRadixSortStartSpirv),
      gather_(device, "radix_sort_gather", kRadixSortGatherSpirv),
      bits_(device, "radix_sort_bits", kRadixSortBitsSpirv),
      count_(device, "radix_sort_count", kRadixSortCountSpirv),
      scatter_(device, "radix_sort_scatter", kRadixSortScatterSpirv),
      varying_bits_(device, 4, "radix sort varying bits") {}

uint64_t RadixSort::scanWords(uint64_t count) {
  const uint64_t runs = std::min<uint64_t>(groupsFor(count, kMinRunLength), kMaxRuns) + 32;
  return runs << kMaxDigitBits;
}

uint64_t RadixSort::scratchBytes(uint64_t count) { return (4 * count + scanWords(count) + 4) * sizeof(uint32_t); }

void RadixSort::reserve(uint32_t count) {
  if (count > kMaxSortValues) {
    throw Error(ErrorKind::Internal, "A sort of " + std::to_string(count) + " values is too large");
  }
  for (int i = 0; i < 2; ++i) {
    keys_[i].reserve(device_, count, "radix sort keys");
    values_[i].reserve(device_, count, "radix sort values");
  }
  counters_.reserve(device_, scanWords(count), "radix sort counters");
  scan_.reserve(uint32_t(scanWords(count)));
}

void RadixSort::recordStart(Commands& commands, uint32_t count, uint64_t order) {
  commands.dispatch(start_, groupsFor(count, kLocalSize), StartArguments{order, values(), count, order == 0});
}

void RadixSort::recordCopy(Commands& commands, uint32_t count, uint64_t target) {
  commands.dispatch(start_, groupsFor(count, kLocalSize), StartArguments{values(), target, count, 0});
}

void RadixSort::recordVaryingBits(Commands& commands, uint64_t keys, uint32_t count, uint32_t result) {
  if (result == 0) commands.fill(varying_bits_.raw(), 0);
  commands.dispatch(bits_, groupsFor(groupsFor(count, kBitsRunLength), kLocalSize),
                    BitsArguments{keys, varying_bits_.address(2 * result), count, kBitsRunLength});
}

std::array<uint32_t, 2> RadixSort::varyingBits(uint32_t result) {
  varying_bits_.toHost();
  return {varying_bits_.host()[2 * result], varying_bits_.host()[2 * result + 1]};
}

// Equal shares of the bits for as few passes as the largest digit allows.
void RadixSort::recordBy(Commands& commands, uint32_t count, SortWord word, BitRange bits) {
  if (count == 0 || bits.count == 0) return;
  commands.dispatch(
      gather_, groupsFor(count, kLocalSize),
      GatherArguments{word.address, values(), keys_[current_].address(), count, word.stride, word.offset});
  const Runs runs = runsOf(count);
  const uint64_t groups = groupsFor(runs.count, kLocalSize);
  const uint64_t counters = counters_.address();
  const uint32_t end = bits.first + bits.count;
  const uint32_t passes = uint32_t(groupsFor(bits.count, kMaxDigitBits));
  for (uint32_t pass = 0, first = bits.first; pass < passes; ++pass) {
    const uint32_t digit_bits = uint32_t(groupsFor(end - first, passes - pass));
    const uint32_t digits = 1u << digit_bits;
    const uint64_t keys = keys_[current_].address(), old_values = values();
    current_ = 1 - current_;
    commands.dispatch(count_, groups, CountArguments{keys, counters, count, runs.length, runs.count, first, digits});
    scan_.record(commands, counters, runs.count * digits);
    commands.dispatch(scatter_, groups,
                      ScatterArguments{keys, old_values, keys_[current_].address(), values(), counters, count,
                                       runs.length, runs.count, first, digits});
    first += digit_bits;
  }
}

}  // namespace encore
