#include "core/reuse/failures.h"

#include <algorithm>
#include <bit>
#include <string>

#include "core/scene/error.h"
#include "kernels/reuse/failures_count.h"
#include "kernels/reuse/failures_groups.h"
#include "kernels/reuse/failures_heads.h"
#include "kernels/reuse/failures_insert.h"
#include "kernels/reuse/failures_number.h"
#include "kernels/reuse/failures_runs.h"
#include "kernels/reuse/failures_serve.h"

namespace encore {

struct Failures::Grouping {  // of failures.glsl
  uint64_t keys, cells;
  uint32_t slots_per_unit;
};

namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kEmptySlot = 0xffffffffu;
constexpr uint32_t kStretch = 248;           // slots per invocation, of failures.glsl
constexpr uint32_t kMaxSlots = 0x40000000u;  // the table is up to four times as large

struct HeadsArguments {  // of failures_heads.comp
  uint64_t table, places, marks;
  uint32_t run_count;
};
struct GroupsArguments {  // of failures_groups.comp
  uint64_t run_slots, table, ranks, places, head_slots;
  uint32_t run_count, first_shade;
};
struct NumberArguments {  // of failures_number.comp
  uint64_t failed, shade;
  uint32_t count, first_shade;
};

void checkShades(uint32_t first_shade, uint32_t count) {
  if (count <= kShadeNone - first_shade) return;
  throw Error(ErrorKind::Internal, "Shades " + std::to_string(first_shade) + " to " +
                                       std::to_string(uint64_t(first_shade) + count) + " cannot be numbered");
}

uint64_t tableCapacity(uint64_t runs) { return std::bit_ceil(2 * runs); }

std::vector<uint32_t> firstOf(Buffer<uint32_t>& words, uint32_t count) {
  words.toHost(0, count);
  const auto host = words.host().first(count);
  return {host.begin(), host.end()};
}

}  // namespace

Failures::Failures(Device& device, Scan& scan, Compaction& compaction)
    : device_(device),
      scan_(scan),
      compaction_(compaction),
      count_kernel_(device, "failures_count", kFailuresCountSpirv),
      runs_kernel_(device, "failures_runs", kFailuresRunsSpirv),
      insert_kernel_(device, "failures_insert", kFailuresInsertSpirv),
      heads_kernel_(device, "failures_heads", kFailuresHeadsSpirv),
      groups_kernel_(device, "failures_groups", kFailuresGroupsSpirv),
      serve_kernel_(device, "failures_serve", kFailuresServeSpirv),
      number_kernel_(device, "failures_number", kFailuresNumberSpirv) {}

uint64_t Failures::scratchBytes(uint64_t slots) {
  const uint64_t per_run = 4 * slots + 1 + (slots == 0 ? 0 : tableCapacity(slots));
  return (per_run + groupsFor(slots, kStretch) + 1) * sizeof(uint32_t);
}

std::vector<uint32_t> Failures::serve(AaSamples& aa, uint32_t first_shade, ReuseKernels::Share share) {
  using Share = ReuseKernels::Share;
  if (aa.count > kMaxSlots) {
    throw Error(ErrorKind::Internal, std::to_string(aa.count) + " slots are too many for one batch");
  }
  if (aa.count == 0) return {};
  if (share == Share::Nothing) return serveEach(aa, first_shade);
  if (share == Share::InCell && aa.cell.size() < aa.count) {
    throw Error(ErrorKind::Internal, "Sharing in cells needs the cells of all antialiasing samples");
  }
  const uint64_t pixels = share == Share::InPixel ? 1 : kBlockArea;
  const uint64_t slots_per_unit = pixels * std::max(aa.samples_per_pixel, 1u);
  // A unit beyond kMaxSlots holds them all.
  return serveGroups(aa, first_shade,
                     {aa.key.address(), share == Share::InCell ? aa.cell.address() : 0,
                      uint32_t(std::min<uint64_t>(slots_per_unit, kMaxSlots))});
}

std::vector<uint32_t> Failures::serveEach(AaSamples& aa, uint32_t first_shade) {
  compaction_.reserve(aa.count);
  Commands commands(device_);
  compaction_.recordCount(commands, aa.shade.address(), aa.count, kShadeNotFound);
  commands.run();
  const uint32_t count = compaction_.matches(aa.count);
  if (count == 0) return {};
  checkShades(first_shade, count);
  head_slots_.reserve(device_, count, "failure heads");
  compaction_.recordWrite(commands, aa.shade.address(), aa.count, kShadeNotFound, head_slots_.address());
  commands.dispatch(number_kernel_, groupsFor(count, kLocalSize),
                    NumberArguments{head_slots_.address(), aa.shade.address(), count, first_shade});
  commands.run();
  return firstOf(head_slots_, count);
}

std::vector<uint32_t> Failures::serveGroups(AaSamples& aa, uint32_t first_shade, const Grouping& by) {
  struct ServeArguments {  // of failures_serve.comp
    Grouping by;
    uint64_t shade, starts, run_shades;
    uint32_t count;
  };
  const uint32_t runs = cutIntoRuns(aa, by);
  if (runs == 0) return {};
  checkShades(first_shade, runs);
  Commands commands(device_);
  recordGroups(commands, by, runs, first_shade);
  commands.dispatch(serve_kernel_, groupsFor(groupsFor(aa.count, kStretch), kLocalSize),
                    ServeArguments{by, aa.shade.address(), starts_.address(), places_.address(), aa.count});
  commands.run();
  ranks_.toHost(runs, 1);
  return firstOf(head_slots_, ranks_.host()[runs]);
}

uint32_t Failures::cutIntoRuns(const AaSamples& aa, const Grouping& by) {
  struct CountArguments {  // of failures_count.comp
    Grouping by;
    uint64_t shade, counts;
    uint32_t count;
  };
  struct RunsArguments {  // of failures_runs.comp
    Grouping by;
    uint64_t shade, starts, run_slots;
    uint32_t count;
  };
  const uint32_t stretches = uint32_t(groupsFor(aa.count, kStretch));
  starts_.reserve(device_, size_t(stretches) + 1, "failure starts");
  scan_.reserve(stretches + 1);
  Commands commands(device_);
  commands.dispatch(count_kernel_, groupsFor(uint64_t(stretches) + 1, kLocalSize),
                    CountArguments{by, aa.shade.address(), starts_.address(), aa.count});
  scan_.record(commands, starts_.address(), stretches + 1);
  commands.run();
  starts_.toHost(stretches, 1);
  const uint32_t runs = starts_.host()[stretches];
  if (runs == 0) return 0;
  run_slots_.reserve(device_, runs, "failure run slots");
  commands.dispatch(runs_kernel_, groupsFor(stretches, kLocalSize),
                    RunsArguments{by, aa.shade.address(), starts_.address(), run_slots_.address(), aa.count});
  commands.run();
  return runs;
}

void Failures::recordGroups(Commands& commands, const Grouping& by, uint32_t runs, uint32_t first_shade) {
  struct InsertArguments {  // of failures_insert.comp
    Grouping by;
    uint64_t run_slots, table, places;
    uint32_t run_count, capacity;
  };
  places_.reserve(device_, runs, "failure places");
  ranks_.reserve(device_, size_t(runs) + 1, "failure ranks");
  head_slots_.reserve(device_, runs, "failure heads");
  table_.reserve(device_, tableCapacity(runs), "failure table");
  scan_.reserve(runs + 1);
  const uint64_t groups = groupsFor(runs, kLocalSize);
  commands.fill(table_.raw(), kEmptySlot);
  commands.dispatch(insert_kernel_, groups,
                    InsertArguments{by, run_slots_.address(), table_.address(), places_.address(), runs,
                                    uint32_t(tableCapacity(runs))});
  commands.dispatch(heads_kernel_, groupsFor(uint64_t(runs) + 1, kLocalSize),
                    HeadsArguments{table_.address(), places_.address(), ranks_.address(), runs});
  scan_.record(commands, ranks_.address(), runs + 1);
  commands.dispatch(groups_kernel_, groups,
                    GroupsArguments{run_slots_.address(), table_.address(), ranks_.address(), places_.address(),
                                    head_slots_.address(), runs, first_shade});
}

}  // namespace encore
