#include "core/shade/shadow_rays.h"

namespace encore {
namespace {

// Bounds scratch memory. A multiple of the packet size, so that packets depend on the block alone.
constexpr size_t kChunkRays = 4096;
// Of the angle between a ray and the normal of the facet that it leaves.
constexpr float kLeastCosine = 1e-3f;
// Rays end short of the light, by a share of their length: what touches a light does not shadow it.
constexpr float kShortOfLight = 1 - 1e-4f;

}  // namespace

void ShadowRays::startVertex(const SurfacePoint& point, uint32_t vertex, float time) {
  outward_ = point.side == 0 ? point.ng : -point.ng;
  origin_ = point.offsetOrigin(outward_);
  vertex_ = vertex;
  time_ = time;
}

void ShadowRays::add(Vec3f direction, float distance, Vec3f contribution, const ShadowRule& rule) {
  if (contribution == Vec3f{} || !isFinite(contribution)) return;
  if (!rule.enable) {
    radiance_[vertex_] += contribution;
    return;
  }
  // Light between the horizons of the shading and the geometric normal arrives along the nearest direction
  // that leaves the surface: dropping it would darken smooth meshes towards their outlines.
  const float up = dot(outward_, direction);
  if (up < kLeastCosine) direction = normalize(direction + outward_ * (kLeastCosine - up));
  const Ray ray{origin_, 0, direction, std::min(distance * kShortOfLight, rule.distance), time_};
  if (passing_ && (all_pass_ || !rule.simple())) return passing_->add(ray, contribution, vertex_, rule);
  rays_.push_back(ray);
  contributions_.push_back(contribution);
  vertices_.push_back(vertex_);
  if (rays_.size() == kChunkRays) trace();
}

void ShadowRays::endBlock() {
  if (!rays_.empty()) trace();
  if (passing_) passing_->traceWave();
}

void ShadowRays::trace() {
  occluded_.resize(rays_.size());
  trace_.occluded(rays_, occluded_, Coherence::Incoherent);
  for (size_t i = 0; i < rays_.size(); ++i)
    if (!occluded_[i]) radiance_[vertices_[i]] += contributions_[i];
  traced_ += rays_.size();
  rays_.clear();
  contributions_.clear();
  vertices_.clear();
}

}  // namespace encore
