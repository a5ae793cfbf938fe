#include "core/shade/passing_shadows.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/shade/shade.h"
#include "core/trace/pattern_points.h"

namespace encore {
namespace {

// Bounds scratch memory. A multiple of the packet size, so that packets depend on the block alone.
constexpr size_t kChunkRays = 4096;
// Of the distance: hits of one mesh that are closer are one crossing.
constexpr float kSameCrossing = 0x1p-18f;
// Footprints grow towards grazing hits, up to this factor.
constexpr float kLeastFootprintCosine = 0.1f;

Vec3f mix(Vec3f a, Vec3f b, float t) { return a * (1 - t) + b * t; }

// A number in [0, 1], also where a network says otherwise.
float share(float x) { return x > 0 ? std::min(x, 1.0f) : 0; }
Vec3f share(Vec3f c) { return {share(c.x), share(c.y), share(c.z)}; }

// The pixel's footprint at the start of the ray, carried along it to a surface: shadows finer than that are not seen.
Vec3f carried(Vec3f d, Vec3f direction, Vec3f normal) {
  const float cosine = dot(direction, normal);
  const float safe = std::copysign(std::max(std::abs(cosine), kLeastFootprintCosine), cosine);
  return d - direction * (dot(d, normal) / safe);
}

}  // namespace

bool anyPassingShadows(const LightSet& lights, const TraceScene& trace) {
  return trace.needsShadowHits() || std::any_of(lights.lights().begin(), lights.lights().end(), [](const auto& light) {
           return light.shadow.enable && !light.shadow.simple();
         });
}

Passages::Passages(const ShadeContext& context) : context_(context) {
  const Patterns& patterns = context.patterns;
  for (size_t i = 0; i < context.scene.materials.size(); ++i) {
    const Material& material = context.scene.materials[i];
    const int32_t m = int32_t(i);
    Entry e{&material, material.hasPresence(), transmitsShadows(material, context.settings), false, false, 1, {}, {}};
    e.opacity_varies = e.present && patterns.varies(PatternPart::Opacity, m);
    e.path_varies = e.transmits && patterns.varies(PatternPart::Path, m);
    if (e.present && !e.opacity_varies) e.presence = share(presence(material, patterns.constantOpacity(m)));
    if (e.transmits && !e.path_varies) {
      e.solid = makeLobes(material, patterns.constantPath(m), {false, false, 1}, context.settings);
      e.thin = makeLobes(material, patterns.constantPath(m), {false, true, 1}, context.settings);
    }
    entries_.push_back(e);
  }
}

Vec3f Passages::transmitted(const Entry& entry, const PathInputs* inputs, bool thin, float cosine) const {
  if (!entry.transmits) return {};
  if (!inputs) return share(straightTransmittance(thin ? entry.thin : entry.solid, cosine));
  return share(straightTransmittance(makeLobes(*entry.material, *inputs, {false, thin, 1}, context_.settings), cosine));
}

void PassingShadows::add(const Ray& ray, Vec3f contribution, uint32_t vertex, const ShadowRule& rule) {
  untraced_.push_back({ray, contribution, vertex, &rule});
  if (untraced_.size() == kChunkRays) traceChunk();
}

void PassingShadows::traceWave() {
  if (!untraced_.empty()) traceChunk();
}

// Rays that need distances go one hit at a time; the order within each kind is kept.
void PassingShadows::traceChunk() {
  std::vector<Traced> rays = std::move(untraced_);
  untraced_.clear();
  const auto nearest =
      std::stable_partition(rays.begin(), rays.end(), [](const Traced& ray) { return !(ray.rule->falloff > 0); });
  traceAll({rays.begin(), nearest});
  traceNearest({nearest, rays.end()});
}

void PassingShadows::traceAll(std::span<Traced> traced) {
  if (traced.empty()) return;
  const TraceScene& trace = passages_->context().trace;
  std::vector<Ray> rays;
  std::vector<const std::vector<uint8_t>*> groups;
  for (const Traced& t : traced) rays.push_back(t.ray), groups.push_back(t.rule->groups);
  traced_ += rays.size();
  if (!trace.needsShadowHits()) {
    std::vector<uint8_t> occluded(rays.size());
    trace.occluded(rays, occluded, Coherence::Incoherent);
    for (size_t i = 0; i < traced.size(); ++i) {
      if (occluded[i]) traced[i].light = {};
      deliver(traced[i]);
    }
    return;
  }
  std::vector<ShadowHits> results(rays.size());
  trace.shadows(rays, {groups}, results, Coherence::Incoherent);
  for (size_t i = 0; i < traced.size(); ++i) {
    if (results[i].occluded) {
      traced[i].light = {};
      deliver(traced[i]);
    } else {
      follow(traced[i], std::span(results[i].hits).first(results[i].count), results[i].overflow);
    }
  }
}

void PassingShadows::traceNearest(std::span<Traced> traced) {
  if (traced.empty()) return;
  std::vector<Ray> rays;
  for (const Traced& t : traced) rays.push_back(t.ray);
  traced_ += rays.size();
  std::vector<Hit> hits(rays.size());
  passages_->context().trace.intersect(rays, hits, Coherence::Incoherent);
  for (size_t i = 0; i < traced.size(); ++i) {
    const Hit& hit = hits[i];
    const bool valid = hit.valid();
    // Of one crossing, a ray that starts again may find a rest: an edge's other triangle, or the same, a rounding on.
    const Hit& last = traced[i].last;
    const bool again = valid && last.valid() && hit.instance == last.instance && hit.mesh == last.mesh &&
                       hit.t - last.t <= kSameCrossing * hit.t;
    if (valid) traced[i].last = hit;
    follow(traced[i], std::span(&hit, valid && !again ? 1 : 0), valid);
  }
}

// more: there may be hits behind these.
void PassingShadows::follow(Traced& ray, std::span<const Hit> hits, bool more) {
  const size_t asked = questions_.size();
  const uint32_t index = uint32_t(waiting_.size());
  for (const Hit& hit : hits) {
    if (meet(ray, hit, index)) continue;
    // Nothing is left: what was asked on the way does not matter. (Points stay in their batches, unread.)
    for (size_t q = asked; q < questions_.size(); ++q) questions_[q].strength = 0;
    ray.light = {}, more = false;
    break;
  }
  if (!more && questions_.size() == asked) return deliver(ray);
  if (more) {
    const float last = hits.empty() ? ray.last.t : hits.back().t;
    // The hits of intersect() include the start, those of shadows() do not.
    ray.ray.tnear = ray.rule->falloff > 0 ? std::nextafter(last, INFINITY) : last;
  }
  waiting_.push_back({ray, more});
}

bool PassingShadows::meet(Traced& ray, const Hit& hit, uint32_t waiting_index) {
  const TraceScene& trace = passages_->context().trace;
  const std::vector<uint8_t>* const groups = ray.rule->groups;
  if (groups) {
    const uint32_t group = trace.linkGroup(hit);
    if (group < groups->size() && !(*groups)[group]) return true;
  }
  const float strength = ray.rule->strength(hit.t);
  if (!(strength > 0)) return true;
  const int32_t material = trace.material(hit);
  const Passages::Entry& entry = passages_->entry(material);
  Question question{waiting_index, material, strength, 1, false, entry.opacity_varies, entry.path_varies};
  if (entry.transmits || question.opacity) {
    const SurfacePoint point = trace.surface(hit, ray.ray.direction, false);
    question.cosine = std::min(std::abs(dot(point.ns, ray.ray.direction)), 1.0f), question.thin = point.thin;
    if (question.opacity || question.path) return ask(ray, hit, point, question), true;
  }
  Vec3f passed = passages_->transmitted(entry, nullptr, question.thin, question.cosine);
  if (entry.present) passed = mix({1, 1, 1}, passed, entry.presence);
  ray.light *= mix({1, 1, 1}, passed, strength);
  return ray.light != Vec3f{};
}

void PassingShadows::ask(const Traced& ray, const Hit& hit, const SurfacePoint& point, Question question) {
  const ShadeContext& context = passages_->context();
  const PathVertex& vertex = vertices_[ray.vertex];
  const Vec3f direction = ray.ray.direction;
  const Vec3f dpdx = carried(vertex.dpdx, direction, point.ng), dpdy = carried(vertex.dpdy, direction, point.ng);
  const auto append = [&](PatternPart part, PatternPoints& points) {
    appendPatternPoint(context.trace, context.patterns.layout(part, question.material), hit, point, direction, dpdx,
                       dpdy, points);
  };
  if (question.opacity) append(PatternPart::Opacity, opacity_points_);
  if (question.path) append(PatternPart::Path, path_points_);
  questions_.push_back(question);
}

void PassingShadows::deliver(const Traced& ray) {
  const Vec3f contribution = ray.contribution * (ray.light + (Vec3f{1, 1, 1} - ray.light) * ray.rule->color);
  if (isFinite(contribution)) radiance_[ray.vertex] += contribution;
}

void PassingShadows::answer(std::span<const OpacityInputs> opacity, std::span<const PathInputs> path) {
  size_t next_opacity = 0, next_path = 0;
  for (const Question& q : questions_) {
    const Passages::Entry& entry = passages_->entry(q.material);
    const PathInputs* const inputs = q.path ? &path[next_path++] : nullptr;
    float present = entry.presence;
    if (q.opacity) present = share(presence(*entry.material, opacity[next_opacity++].opacity));
    if (!(q.strength > 0)) continue;
    Vec3f passed = passages_->transmitted(entry, inputs, q.thin, q.cosine);
    if (entry.present) passed = mix({1, 1, 1}, passed, present);
    waiting_[q.ray].traced.light *= mix({1, 1, 1}, passed, q.strength);
  }
  questions_.clear();
  opacity_points_ = {}, path_points_ = {};
  for (const Waiting& waiting : waiting_) {
    if (waiting.more && waiting.traced.light != Vec3f{})
      untraced_.push_back(waiting.traced);
    else
      deliver(waiting.traced);
  }
  waiting_.clear();
}

void finishShadows(const Passages& passages, std::span<PassingShadows> blocks) {
  Patterns& patterns = passages.context().patterns;
  std::vector<OpacityInputs> opacity;
  std::vector<PathInputs> path;
  std::vector<size_t> first_opacity(blocks.size()), first_path(blocks.size());
  while (std::any_of(blocks.begin(), blocks.end(), [](const PassingShadows& block) { return !block.done(); })) {
    PatternPoints opacity_points, path_points;
    for (size_t b = 0; b < blocks.size(); ++b) {
      first_opacity[b] = opacity_points.size(), first_path[b] = path_points.size();
      opacity_points.append(blocks[b].opacity_points_);
      path_points.append(blocks[b].path_points_);
    }
    opacity.resize(opacity_points.size()), path.resize(path_points.size());
    if (!opacity.empty()) patterns.evaluate(opacity_points, std::span(opacity));
    if (!path.empty()) patterns.evaluate(path_points, std::span(path));
    tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t b) {
      const FlushDenormals flush;
      PassingShadows& block = blocks[b];
      block.answer(std::span(opacity).subspan(first_opacity[b], block.opacity_points_.size()),
                   std::span(path).subspan(first_path[b], block.path_points_.size()));
      block.traceWave();
    });
  }
}

}  // namespace encore
