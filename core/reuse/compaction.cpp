#include "core/reuse/compaction.h"

#include "kernels/reuse/compaction_count.h"
#include "kernels/reuse/compaction_write.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr uint32_t kRunLength = 248;  // words per invocation; not a power of two, as in scan.cpp

struct CountArguments {  // of compaction_count.comp
  uint64_t words, counts;
  uint32_t count, run_length, wanted;
};
struct WriteArguments {  // of compaction_write.comp
  uint64_t words, starts, places;
  uint32_t count, run_length, wanted;
};

}  // namespace

Compaction::Compaction(Device& device, Scan& scan)
    : device_(device),
      scan_(scan),
      count_(device, "compaction_count", kCompactionCountSpirv),
      write_(device, "compaction_write", kCompactionWriteSpirv) {}

uint64_t Compaction::scanWords(uint64_t count) { return groupsFor(count, kRunLength) + 1; }
uint64_t Compaction::scratchBytes(uint64_t count) { return scanWords(count) * sizeof(uint32_t); }

void Compaction::reserve(uint32_t count) {
  starts_.reserve(device_, scanWords(count), "compaction starts");
  scan_.reserve(uint32_t(scanWords(count)));
}

void Compaction::recordCount(Commands& commands, uint64_t words, uint32_t count, uint32_t wanted) {
  const uint32_t scanned = uint32_t(scanWords(count));
  commands.dispatch(count_, groupsFor(scanned, kLocalSize),
                    CountArguments{words, starts_.address(), count, kRunLength, wanted});
  scan_.record(commands, starts_.address(), scanned);
}

uint32_t Compaction::matches(uint32_t count) {
  const size_t last = scanWords(count) - 1;
  starts_.toHost(last, 1);
  return starts_.host()[last];
}

void Compaction::recordWrite(Commands& commands, uint64_t words, uint32_t count, uint32_t wanted, uint64_t places) {
  commands.dispatch(write_, groupsFor(groupsFor(count, kRunLength), kLocalSize),
                    WriteArguments{words, starts_.address(), places, count, kRunLength, wanted});
}

}  // namespace encore
