#include "core/shade/vertex_inputs.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace encore {
namespace {

constexpr uint32_t kConstant = 0xffffffffu;
constexpr size_t kGrain = 256;

template <class F>
void parallelVertices(size_t count, F f) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, count, kGrain), [&](const tbb::blocked_range<size_t>& range) {
    const FlushDenormals flush;
    for (size_t i = range.begin(); i != range.end(); ++i) f(i);
  });
}

}  // namespace

VertexInputs::VertexInputs(const ShadeContext& context, std::span<const PathVertex> vertices) : context_(context) {
  Patterns& patterns = context.patterns;
  gather(
      vertices, shading_, [&](int32_t material) { return patterns.shadingVaries(material); },
      [&](std::span<const PatternPoint> points, std::span<ShadingInputs> values) {
        patterns.evaluateShading(points, values);
      });
  gather(
      vertices, path_, [&](int32_t material) { return patterns.pathVaries(material); },
      [&](std::span<const PatternPoint> points, std::span<PathInputs> values) {
        patterns.evaluatePath(points, values);
      });
}

const ShadingInputs& VertexInputs::shading(size_t i, int32_t material) const {
  const bool constant = shading_.slots.empty() || shading_.slots[i] == kConstant;
  return constant ? context_.patterns.constantShading(material) : shading_.values[shading_.slots[i]];
}

const PathInputs& VertexInputs::path(size_t i, int32_t material) const {
  const bool constant = path_.slots.empty() || path_.slots[i] == kConstant;
  return constant ? context_.patterns.constantPath(material) : path_.values[path_.slots[i]];
}

template <class Value, class Varies, class Evaluate>
void VertexInputs::gather(std::span<const PathVertex> vertices, Varying<Value>& part, Varies varies,
                          Evaluate evaluate) const {
  bool any = false;
  for (size_t m = 0; m < context_.scene.materials.size(); ++m) any = any || varies(int32_t(m));
  if (!any) return;

  // Points in the order of their vertices, whatever thread makes them.
  part.slots.resize(vertices.size());
  parallelVertices(vertices.size(),
                   [&](size_t i) { part.slots[i] = varies(context_.trace.material(vertices[i].hit)) ? 0 : kConstant; });
  uint32_t count = 0;
  for (uint32_t& slot : part.slots)
    if (slot != kConstant) slot = count++;
  if (count == 0) return;
  std::vector<PatternPoint> points(count);
  parallelVertices(vertices.size(), [&](size_t i) {
    if (part.slots[i] != kConstant) points[part.slots[i]] = patternPoint(vertices[i]);
  });
  part.values.resize(count);
  evaluate(std::span<const PatternPoint>(points), std::span<Value>(part.values));
}

PatternPoint VertexInputs::patternPoint(const PathVertex& vertex) const {
  const SurfacePoint point = context_.trace.surface(vertex.hit, vertex.direction, false);
  const std::string& name = context_.patterns.texcoordName(point.material);
  const int32_t slot = name.empty() ? -1 : context_.trace.texcoordSlot(vertex.hit, name);
  const TexcoordPoint st = context_.trace.texcoord(vertex.hit, point, slot, vertex.dpdx, vertex.dpdy);
  return {uint32_t(point.material), st.st, st.dstdx, st.dstdy, context_.trace.displayColor(vertex.hit)};
}

}  // namespace encore
