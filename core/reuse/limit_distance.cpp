#include "core/reuse/limit_distance.h"

#include <algorithm>

#include "core/scene/error.h"
#include "core/scene/text.h"
#include "kernels/reuse/limit_distance.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;
constexpr float kLargestLimit = 1e18f;  // times the largest footprint, 2^60, it is still finite

struct Arguments {  // of limit_distance.comp
  uint64_t sample_uv, uv, radii, shade;
  uint32_t count, sample_count;
  float limit;
};

}  // namespace

LimitDistance::LimitDistance(Device& device) : kernel_(device, "limit_distance", kLimitDistanceSpirv) {}

void LimitDistance::record(Commands& commands, const ShadingSamples& samples, AaSamples& aa, float limit) {
  if (!(limit > 0)) throw Error(ErrorKind::Internal, "A distance limit of " + text(limit) + " footprints");
  if (aa.footprint.size() < aa.count) {
    throw Error(ErrorKind::Internal, "The distance limit needs the footprints of all antialiasing samples");
  }
  commands.dispatch(kernel_, groupsFor(aa.count, kLocalSize),
                    Arguments{samples.uv.address(), aa.uv.address(), aa.footprint.address(), aa.shade.address(),
                              aa.count, samples.count, std::min(limit, kLargestLimit)});
}

}  // namespace encore
