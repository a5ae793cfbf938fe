// Where solids overlap: which of them a path is in (after Schmidt & Budge, "Simple Nested Dielectrics in Ray Traced
// Images", JGT 2002).
//
// The rule. Of the solids that a path is inside of, the one with the highest Material::dielectric_priority is there;
// of equals the one that was entered last. An interface is real if what is there changes at it; then its outside is
// the medium that would be there without the solid. All others are passed straight, weigh nothing and use up no
// bounce. Paths start outside of everything. A path that leaves a solid which it never entered (the camera is in it)
// takes it for the first one entered. Thin sheets, and what has presence or cut-outs, are no solids.
#pragma once

#include <array>
#include <cstdint>

#include "core/trace/ray.h"

namespace encore {

// One mesh of one instance, of a material that refracts.
struct Solid {
  uint32_t instance = kNoInstance, mesh = 0;
  float ior = 1;  // where it was entered
  int32_t priority = 0;

  bool sameAs(const Solid& other) const { return instance == other.instance && mesh == other.mesh; }
};

class Interior {
 public:
  static constexpr uint32_t kMostSolids = 4;  // a fifth one is forgotten

  bool empty() const { return count_ == 0; }
  // Ior of what is there: 1 outside of all solids.
  float ior() const { return iorOf(top(kNone)); }
  // Ior of the medium on the outside of an interface of the solid, met from the outside or (back) from inside.
  float outside(const Solid& solid, bool back) const { return iorOf(top(back ? find(solid) : kNone)); }
  bool real(const Solid& solid, bool back) const {
    const uint32_t there = top(kNone);
    if (there == kNone) return true;
    if (!back) return solid.priority >= solids_[there].priority;
    const uint32_t own = find(solid);
    return own == kNone ? solid.priority > solids_[there].priority : own == there;
  }
  // The path goes on beyond the interface, whether it is real or not.
  void pass(const Solid& solid, bool back) {
    if (!back) {
      if (count_ < kMostSolids) solids_[count_++] = solid;
      return;
    }
    const uint32_t own = find(solid);
    if (own == kNone) return;
    for (uint32_t i = own + 1; i < count_; ++i) solids_[i - 1] = solids_[i];
    --count_;
  }

 private:
  static constexpr uint32_t kNone = 0xffffffffu;

  uint32_t top(uint32_t without) const {
    uint32_t best = kNone;
    for (uint32_t i = 0; i < count_; ++i)
      if (i != without && (best == kNone || solids_[i].priority >= solids_[best].priority)) best = i;
    return best;
  }
  uint32_t find(const Solid& solid) const {  // entered last
    for (uint32_t i = count_; i-- > 0;)
      if (solids_[i].sameAs(solid)) return i;
    return kNone;
  }
  float iorOf(uint32_t index) const { return index == kNone ? 1 : solids_[index].ior; }

  std::array<Solid, kMostSolids> solids_;  // in the order in which they were entered
  uint32_t count_ = 0;
};

}  // namespace encore
