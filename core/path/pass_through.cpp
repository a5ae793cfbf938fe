#include "core/path/pass_through.h"

#include <numeric>

#include "core/path/blocks.h"
#include "core/scene/random.h"
#include "core/shade/bsdf.h"
#include "core/trace/pattern_points.h"

namespace encore {

// The passages of a block that are not settled, and what was evaluated for them.
struct PassThrough::Open {
  std::vector<uint32_t> passages;
  std::vector<float> opacities;  // of those whose presence varies, in order
};

PassThrough::PassThrough(const ShadeContext& context, bool solids) : context_(context) {
  for (size_t i = 0; i < context.scene.materials.size(); ++i) {
    const Material& material = context.scene.materials[i];
    const bool present = material.hasPresence(), solid = solids && !present && feedsRefraction(material);
    kinds_.push_back(present ? Kind::Presence : solid ? Kind::Solid : Kind::Opaque);
    varies_.push_back(present && context.patterns.varies(PatternPart::Opacity, int32_t(i)));
    presence_ = presence_ || present;
    evaluates_ = evaluates_ || varies_.back();
    solids_ = solids_ || solid;
  }
}

Solid PassThrough::solidOf(const Hit& hit, int32_t material, const PathInputs* inputs) const {
  const Material& source = context_.scene.materials[size_t(material)];
  float ior = source.ior.value;
  if (inputs)
    ior = inputs->ior;
  else if (!context_.patterns.varies(PatternPart::Path, material))
    ior = context_.patterns.constantPath(material).ior;
  return {hit.instance, hit.mesh, ior, source.dielectric_priority};
}

void PassThrough::run(std::span<std::vector<Passage>> blocks) const {
  std::vector<Open> open(blocks.size());
  for (size_t b = 0; b < blocks.size(); ++b) {
    open[b].passages.resize(blocks[b].size());
    std::iota(open[b].passages.begin(), open[b].passages.end(), 0u);
  }
  const auto unsettled = [](const Open& o) { return !o.passages.empty(); };
  for (uint32_t round = 0; round < kMostPassed && std::any_of(open.begin(), open.end(), unsettled); ++round) {
    if (evaluates_) evaluate(blocks, open);
    tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
      if (!unsettled(open[b])) return;
      const FlushDenormals flush;
      advance(blocks[b], open[b], round);
    });
  }
}

// One dispatch for all blocks.
void PassThrough::evaluate(std::span<const std::vector<Passage>> blocks, std::vector<Open>& open) const {
  std::vector<PatternPoints> points(blocks.size());
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
    const FlushDenormals flush;
    for (const uint32_t k : open[b].passages) addPoint(blocks[b][k], points[b]);
  });
  PatternPoints all;
  for (const PatternPoints& p : points) all.append(p);
  if (all.empty()) return;
  std::vector<OpacityInputs> values(all.size());
  context_.patterns.evaluate(all, values);
  size_t next = 0;
  for (size_t b = 0; b < blocks.size(); ++b) {
    open[b].opacities.clear();
    for (size_t i = 0; i < points[b].size(); ++i) open[b].opacities.push_back(values[next++].opacity);
  }
}

void PassThrough::addPoint(const Passage& p, PatternPoints& points) const {
  const int32_t material = context_.trace.material(p.hit);
  if (!varies_[size_t(material)]) return;
  const SurfacePoint point = context_.trace.surface(p.hit, p.ray.direction, false);
  const float longest = context_.trace.diagonal();
  const auto arrived = [&](Vec3f dp, Vec3f dd) {
    return limited(transferDifferential(dp, dd, p.hit.t, p.ray.direction, point.ng), longest);
  };
  appendPatternPoint(context_.trace, context_.patterns.layout(PatternPart::Opacity, material), p.hit, point,
                     p.ray.direction, arrived(p.dpdx, p.spread.x), arrived(p.dpdy, p.spread.y), points);
}

void PassThrough::advance(std::vector<Passage>& passages, Open& open, uint32_t round) const {
  std::vector<uint32_t> moving;
  std::vector<Ray> rays;
  std::vector<float> travelled;
  size_t next_opacity = 0;
  for (const uint32_t k : open.passages) {
    Passage& p = passages[k];
    const bool evaluated = varies_[size_t(context_.trace.material(p.hit))];
    if (!passes(p, evaluated ? &open.opacities[next_opacity++] : nullptr, round)) continue;
    moving.push_back(k);
    rays.push_back(beyond(p, travelled.emplace_back()));
  }
  std::vector<Hit> hits(rays.size());
  context_.trace.intersect(rays, hits, Coherence::Coherent);
  context_.rays_traced.fetch_add(rays.size(), std::memory_order_relaxed);
  open.passages.clear();
  for (size_t i = 0; i < moving.size(); ++i) {
    Passage& p = passages[moving[i]];
    p.hit = hits[i];
    p.hit.t += travelled[i];
    if (mayPass(p.hit, &p.interior)) open.passages.push_back(moving[i]);
  }
}

bool PassThrough::passes(Passage& p, const float* opacity, uint32_t round) const {
  const int32_t material = context_.trace.material(p.hit);
  if (kinds_[size_t(material)] == Kind::Solid) {
    const SurfacePoint point = context_.trace.surface(p.hit, p.ray.direction, false);
    const Solid solid = solidOf(p.hit, material, nullptr);
    if (point.thin || p.interior.real(solid, point.side != 0)) return false;
    p.interior.pass(solid, point.side != 0);
    return true;
  }
  const float there = encore::presence(context_.scene.materials[size_t(material)],
                                       opacity ? *opacity : context_.patterns.constantOpacity(material));
  if (!(there < 1)) return false;
  if (!(there > 0)) return true;
  const auto keys = pcg4d(p.pixel, context_.settings.seed, uint32_t(RandomUse::Presence), p.stream << 8 | round);
  return sobol2(p.sample, keys[0]).x >= there;
}

// The rest of a ray, from beyond what it has met.
Ray PassThrough::beyond(const Passage& p, float& travelled) const {
  const Vec3f direction = p.ray.direction;
  Ray ray = p.ray;
  ray.origin = context_.trace.surface(p.hit, direction).offsetOrigin(direction);
  travelled = dot(ray.origin - p.ray.origin, direction);
  ray.tnear = 0;
  ray.tfar = p.ray.tfar - travelled;
  return ray;
}

}  // namespace encore
