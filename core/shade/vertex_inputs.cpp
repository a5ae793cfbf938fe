#include "core/shade/vertex_inputs.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/trace/pattern_points.h"

namespace encore {
namespace {

constexpr uint32_t kConstant = 0xffffffffu;
constexpr size_t kGrain = 256;

template <class F>
void parallelRanges(size_t count, F f) {
  tbb::parallel_for(size_t{0}, (count + kGrain - 1) / kGrain, [&](size_t chunk) {
    const FlushDenormals flush;
    f(chunk, chunk * kGrain, std::min(count, (chunk + 1) * kGrain));
  });
}

}  // namespace

VertexInputs::VertexInputs(const ShadeContext& context, std::span<const PathVertex> vertices) : context_(context) {
  gather(vertices, PatternPart::Shading, shading_);
  gather(vertices, PatternPart::Path, path_);
}

const ShadingInputs& VertexInputs::shading(size_t i, int32_t material) const {
  const bool constant = shading_.slots.empty() || shading_.slots[i] == kConstant;
  return constant ? context_.patterns.constantShading(material) : shading_.values[shading_.slots[i]];
}

const PathInputs& VertexInputs::path(size_t i, int32_t material) const {
  const bool constant = path_.slots.empty() || path_.slots[i] == kConstant;
  return constant ? context_.patterns.constantPath(material) : path_.values[path_.slots[i]];
}

template <class Value>
void VertexInputs::gather(std::span<const PathVertex> vertices, PatternPart which, Varying<Value>& part) const {
  const Patterns& patterns = context_.patterns;
  bool any = false;
  for (size_t m = 0; m < context_.scene.materials.size(); ++m) any = any || patterns.varies(which, int32_t(m));
  if (!any) return;

  part.slots.resize(vertices.size());
  parallelRanges(vertices.size(), [&](size_t, size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i)
      part.slots[i] = patterns.varies(which, context_.trace.material(vertices[i].hit)) ? 0 : kConstant;
  });
  uint32_t count = 0;
  for (uint32_t& slot : part.slots)
    if (slot != kConstant) slot = count++;
  if (count == 0) return;
  part.values.resize(count);
  context_.patterns.evaluate(points(vertices, which, part.slots), std::span<Value>(part.values));
}

// Points in the order of their vertices, whatever thread makes them.
PatternPoints VertexInputs::points(std::span<const PathVertex> vertices, PatternPart which,
                                   std::span<const uint32_t> slots) const {
  std::vector<PatternPoints> chunks((vertices.size() + kGrain - 1) / kGrain);
  parallelRanges(vertices.size(), [&](size_t chunk, size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      if (slots[i] == kConstant) continue;
      const PathVertex& v = vertices[i];
      const SurfacePoint point = context_.trace.surface(v.hit, v.direction, false);
      appendPatternPoint(context_.trace, context_.patterns.layout(which, point.material), v.hit, point, v.direction,
                         v.dpdx, v.dpdy, chunks[chunk]);
    }
  });
  PatternPoints all;
  for (const PatternPoints& chunk : chunks) all.append(chunk);
  return all;
}

}  // namespace encore
