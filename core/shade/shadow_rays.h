// The shadow and occlusion rays of one block: collected in order, traced 16 to a packet, added up.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/shade/light_set.h"
#include "core/shade/passing_shadows.h"
#include "core/trace/trace_scene.h"

namespace encore {

class ShadowRays {
 public:
  // radiance: what startVertex() refers to by index. passing: takes the rays that need more than a yes or no; null
  // where there are none.
  ShadowRays(const TraceScene& trace, std::span<Vec3f> radiance, PassingShadows* passing)
      : trace_(trace), radiance_(radiance), passing_(passing), all_pass_(trace.needsShadowHits()) {}

  // The rays that follow leave this point, on the side that it was seen from, and count for radiance[vertex].
  void startVertex(const SurfacePoint& point, uint32_t vertex, float time);
  // radiance[vertex] += contribution, unless something lies between point and point + direction * distance, and the
  // rule says that it counts. What carries nothing or is not finite is dropped without a ray. Directions below the
  // facet, which a shading normal can allow, are tested just above it.
  void add(Vec3f direction, float distance, Vec3f contribution, const ShadowRule& rule);
  // Ends the block: traces what is left. Packets never span blocks.
  void endBlock();
  uint64_t traced() const { return traced_; }

 private:
  void trace();

  const TraceScene& trace_;
  std::span<Vec3f> radiance_;
  PassingShadows* passing_;
  bool all_pass_;
  Vec3f outward_, origin_;
  uint32_t vertex_ = 0;
  float time_ = 0;
  std::vector<Ray> rays_;
  std::vector<Vec3f> contributions_;
  std::vector<uint32_t> vertices_;
  std::vector<uint8_t> occluded_;
  uint64_t traced_ = 0;
};

}  // namespace encore
