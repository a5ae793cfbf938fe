#include "core/reuse/failures.h"

#include <algorithm>
#include <string>

#include "core/scene/error.h"
#include "kernels/reuse/failures_groups.h"
#include "kernels/reuse/failures_heads.h"
#include "kernels/reuse/failures_keys.h"
#include "kernels/reuse/failures_serve.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;

struct KeysArguments {  // of failures_keys.comp
  uint64_t keys, failed, failed_keys;
  uint32_t count;
};
struct HeadsArguments {  // of failures_heads.comp
  uint64_t failed_keys, failed, order, sorted_marks, slot_marks;
  uint32_t count, samples_per_pixel;
};
struct GroupsArguments {  // of failures_groups.comp
  uint64_t failed, order, groups, ranks, group_ranks, head_slots;
  uint32_t count;
};
struct ServeArguments {  // of failures_serve.comp
  uint64_t failed, order, groups, group_ranks, shade;
  uint32_t count, first_shade;
};

}  // namespace

Failures::Failures(Device& device, Scan& scan, RadixSort& sort, Compaction& compaction)
    : device_(device),
      scan_(scan),
      sort_(sort),
      compaction_(compaction),
      keys_kernel_(device, "failures_keys", kFailuresKeysSpirv),
      heads_kernel_(device, "failures_heads", kFailuresHeadsSpirv),
      groups_kernel_(device, "failures_groups", kFailuresGroupsSpirv),
      serve_kernel_(device, "failures_serve", kFailuresServeSpirv) {}

uint64_t Failures::scratchBytes(uint64_t failures) {
  return failures * (5 * sizeof(uint32_t) + sizeof(SurfaceKey)) + 2 * sizeof(uint32_t);
}

void Failures::reserve(uint32_t failures) {
  failed_.reserve(device_, failures, "failed slots");
  keys_.reserve(device_, failures, "failed keys");
  groups_.reserve(device_, failures + 1, "failure groups");
  ranks_.reserve(device_, failures + 1, "failure ranks");
  group_ranks_.reserve(device_, failures, "failure group ranks");
  head_slots_.reserve(device_, failures, "failure heads");
  sort_.reserve(failures);
  scan_.reserve(failures + 1);
}

std::vector<uint32_t> Failures::serve(AaSamples& aa, uint32_t first_shade, bool share) {
  const uint32_t count = list(aa);
  if (count == 0) return {};
  if (count > kShadeNone - first_shade) {
    throw Error(ErrorKind::Internal, "Shades " + std::to_string(first_shade) + " to " +
                                         std::to_string(uint64_t(first_shade) + count) + " cannot be numbered");
  }
  Commands commands(device_);
  sort_.recordStart(commands, count);
  if (share) recordSort(commands, count);
  // One sample per pixel: every failure is a head.
  recordGroups(commands, count, share ? std::max(aa.samples_per_pixel, 1u) : 1u);
  commands.dispatch(serve_kernel_, groupsFor(count, kLocalSize),
                    ServeArguments{failed_.address(), sort_.values(), groups_.address(), group_ranks_.address(),
                                   aa.shade.address(), count, first_shade});
  commands.run();
  ranks_.toHost(count, 1);
  const uint32_t heads = ranks_.host()[count];
  head_slots_.toHost(0, heads);
  const auto slots = head_slots_.host().first(heads);
  return {slots.begin(), slots.end()};
}

uint32_t Failures::list(const AaSamples& aa) {
  if (aa.count == 0) return 0;
  compaction_.reserve(aa.count);
  Commands commands(device_);
  compaction_.recordCount(commands, aa.shade.address(), aa.count, kShadeNotFound);
  commands.run();
  const uint32_t count = compaction_.matches(aa.count);
  if (count == 0) return 0;
  reserve(count);
  compaction_.recordWrite(commands, aa.shade.address(), aa.count, kShadeNotFound, failed_.address());
  commands.dispatch(keys_kernel_, groupsFor(count, kLocalSize),
                    KeysArguments{aa.key.address(), failed_.address(), keys_.address(), count});
  sort_.recordVaryingBits(commands, keys_.address(), count);
  commands.run();
  return count;
}

// Failed samples are listed in order of slots, so of (pixel, sample): a stable sort by key is all it takes.
void Failures::recordSort(Commands& commands, uint32_t failures) {
  const auto bits = sort_.varyingBits();
  sort_.recordBy(commands, failures, {keys_.address(), 2, 1}, bitRangeOf(bits[1]));
  sort_.recordBy(commands, failures, {keys_.address(), 2, 0}, bitRangeOf(bits[0]));
}

void Failures::recordGroups(Commands& commands, uint32_t failures, uint32_t samples_per_pixel) {
  const uint64_t order = sort_.values();
  commands.dispatch(heads_kernel_, groupsFor(uint64_t(failures) + 1, kLocalSize),
                    HeadsArguments{keys_.address(), failed_.address(), order, groups_.address(), ranks_.address(),
                                   failures, samples_per_pixel});
  scan_.record(commands, groups_.address(), failures + 1);
  scan_.record(commands, ranks_.address(), failures + 1);
  commands.dispatch(groups_kernel_, groupsFor(failures, kLocalSize),
                    GroupsArguments{failed_.address(), order, groups_.address(), ranks_.address(),
                                    group_ranks_.address(), head_slots_.address(), failures});
}

}  // namespace encore
