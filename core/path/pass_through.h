// Surfaces that paths pass as if they were not there: presence, cut-outs, and interfaces inside of other solids.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/path/differentials.h"
#include "core/path/interior.h"
#include "core/shade/shade.h"

namespace encore {

// A ray and what it meets.
struct Passage {
  Ray ray;
  Hit hit;                         // t counts from ray.origin, however much was passed
  uint32_t pixel = 0, sample = 0;  // random number key
  uint32_t stream = 0;             // 0: first hits, which all layers share
  Vec3f dpdx, dpdy;                // change of the ray's origin over a pixel
  Spread spread;                   // and of its direction
  Interior interior;               // solids that the ray is in
  uint32_t index = 0;              // the caller's
};

class PassThrough {
 public:
  // A ray passes this many surfaces at most; the next one counts as there.
  static constexpr uint32_t kMostPassed = 256;

  // solids: interfaces inside of other solids are passed as well as what has presence. Keeps a reference to context.
  PassThrough(const ShadeContext& context, bool solids);

  bool presence() const { return presence_; }  // some material of the scene has it
  bool solids() const { return solids_; }
  // Presence has to be evaluated: blocks must go together.
  bool evaluates() const { return evaluates_; }
  // The hit may be passed; run() has to say. interior: null: of no solid.
  bool mayPass(const Hit& hit, const Interior* interior) const {
    if (!hit.valid() || !(presence_ || (solids_ && interior && !interior->empty()))) return false;
    const Kind kind = kinds_[size_t(context_.trace.material(hit))];
    return kind == Kind::Presence || (kind == Kind::Solid && interior && !interior->empty());
  }
  // Moves every passage on to the first surface that it does not pass, or to nothing. The result depends on nothing
  // but the block.
  void run(std::span<std::vector<Passage>> blocks) const;

  // The solid whose interface was hit. inputs: of the hit, or null: the material's constants.
  Solid solidOf(const Hit& hit, int32_t material, const PathInputs* inputs) const;
  bool isSolid(int32_t material) const { return kinds_[size_t(material)] == Kind::Solid; }

 private:
  enum class Kind : uint8_t { Opaque, Presence, Solid };
  struct Open;

  void addPoint(const Passage& passage, PatternPoints& points) const;
  void evaluate(std::span<const std::vector<Passage>> blocks, std::vector<Open>& open) const;
  void advance(std::vector<Passage>& passages, Open& open, uint32_t round) const;
  bool passes(Passage& passage, const float* opacity, uint32_t round) const;
  Ray beyond(const Passage& passage, float& travelled) const;

  const ShadeContext& context_;
  std::vector<Kind> kinds_;      // by material
  std::vector<uint8_t> varies_;  // by material: opacity
  bool presence_ = false, evaluates_ = false, solids_ = false;
};

}  // namespace encore
