// What shadow rays find on their way, gathered while Embree traces them.
#pragma once

#include "core/trace/trace_impl.h"

namespace encore {

// What the filter knows of the packet that is traced. Rays are found by their lane, which is their id.
struct ShadowRecorder {
  const TraceScene::Impl& scene;
  const Ray* rays;
  const std::vector<uint8_t>* const* groups;  // null: everything casts shadows for all rays
  ShadowHits* results;
  const ShadowHits* before;  // null: the rays are not resumed

  std::array<float, kPacketWidth> dropped;  // t of the nearest hit that there was no room for

  // A hit that Embree found; true: it ends the ray.
  bool ends(uint32_t lane, const Hit& hit);
  void recordSphere(uint32_t lane, const Hit& found, const TracedInstance& instance, const DicedMesh& mesh);
  // After the packet was traced.
  void finish(uint32_t lane, bool occluded);
};

// Set on the geometries whose hits have to be looked at.
void filterShadowHits(const RTCFilterFunctionNArguments* arguments);

}  // namespace encore
