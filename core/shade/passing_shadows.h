// Shadow rays for which yes or no is not the answer: surfaces let a part of the light pass, or the light's shadows are
// coloured, fade with distance, or are cast by some prims only.
//
// Light passes surfaces straight on. What is left of it is the product over all hits, of what each lets pass: all of
// 1 - presence, and of the rest what the material transmits (straightTransmittance() in bsdf.h). Rays go in waves, one
// for every kRecordedHits hits; between waves, what varies over surfaces is evaluated for all blocks in one dispatch.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/pattern/patterns.h"
#include "core/shade/bsdf.h"
#include "core/shade/light_set.h"
#include "core/trace/trace_scene.h"

namespace encore {

struct PathVertex;
struct ShadeContext;

// Some ray of the scene may be such a one.
bool anyPassingShadows(const LightSet& lights, const TraceScene& trace);

// What is the same for all rays of a call.
class Passages {
 public:
  explicit Passages(const ShadeContext& context);

  struct Entry {
    const Material* material;
    bool present;    // 1 - presence passes
    bool transmits;  // glass
    bool opacity_varies, path_varies;
    float presence;     // where it does not vary
    Lobes solid, thin;  // where they do not vary
  };
  const Entry& entry(int32_t material) const { return entries_[size_t(material)]; }
  const ShadeContext& context() const { return context_; }
  // inputs: where path inputs vary. cosine: to the normal.
  Vec3f transmitted(const Entry& entry, const PathInputs* inputs, bool thin, float cosine) const;

 private:
  const ShadeContext& context_;
  std::vector<Entry> entries_;
};

// Those of one block. Results depend on the rays of the block alone, in the order of add().
class PassingShadows {
 public:
  // vertices, radiance: what add() refers to by index.
  PassingShadows(const Passages& passages, std::span<const PathVertex> vertices, std::span<Vec3f> radiance)
      : passages_(&passages), vertices_(vertices), radiance_(radiance) {}

  // radiance[vertex] += what is left of the contribution. rule must outlive this.
  void add(const Ray& ray, Vec3f contribution, uint32_t vertex, const ShadowRule& rule);
  // Follows what was added, or has to go on, by one wave. Not done(): results of evaluation are needed.
  void traceWave();
  bool done() const { return waiting_.empty() && untraced_.empty(); }
  uint64_t traced() const { return traced_; }

 private:
  friend void finishShadows(const Passages& passages, std::span<PassingShadows> blocks);

  struct Traced {
    Ray ray;
    Vec3f contribution;
    uint32_t vertex;
    const ShadowRule* rule;
    Vec3f light{1, 1, 1};  // what is left of it
    Hit last{};            // of rays that go one hit at a time: the one before
  };
  // A hit that lets pass what evaluation has to tell.
  struct Question {
    uint32_t ray;  // in waiting_
    int32_t material;
    float strength, cosine;
    bool thin;
    bool opacity, path;  // which parts are asked for
  };
  void traceChunk();
  void traceAll(std::span<Traced> rays);
  void traceNearest(std::span<Traced> rays);
  // Returns false where nothing is left.
  bool meet(Traced& ray, const Hit& hit, uint32_t waiting_index);
  void follow(Traced& ray, std::span<const Hit> hits, bool more);
  void ask(const Traced& ray, const Hit& hit, const SurfacePoint& point, Question question);
  void deliver(const Traced& ray);
  // Takes what was evaluated, in the order of the questions.
  void answer(std::span<const OpacityInputs> opacity, std::span<const PathInputs> path);

  const Passages* passages_;
  std::span<const PathVertex> vertices_;
  std::span<Vec3f> radiance_;
  std::vector<Traced> untraced_;
  struct Waiting {
    Traced traced;
    bool more;  // there may be hits behind those that were recorded
  };
  std::vector<Waiting> waiting_;
  std::vector<Question> questions_;
  PatternPoints opacity_points_, path_points_;
  uint64_t traced_ = 0;
};

// Evaluates and traces until all blocks are done.
void finishShadows(const Passages& passages, std::span<PassingShadows> blocks);

}  // namespace encore
