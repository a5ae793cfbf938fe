// Scales that make distances in (u, v) proportional to lengths in the world, per primitive and instance.
#pragma once

#include <cstdint>
#include <vector>

#include "core/dice/dice.h"
#include "core/scene/scene.h"

namespace encore {

// What a primitive's (u, v) are multiplied by: its mean |dp/du| and |dp/dv| in the world, weighted by parametric
// area, over the larger of them. (1, 1) where a primitive has no parametric area or no extent.
class ParameterScales {
 public:
  ParameterScales(const Scene& scene, const DicedMeshes& diced);

  // primitive: within the instance's prototype.
  Vec2f scale(uint32_t instance, uint32_t primitive) const {
    const std::vector<Vec2f>& table = tables_[table_of_[instance]];
    return table.empty() ? Vec2f{1, 1} : table[primitive];
  }
  uint64_t bytes() const;

 private:
  std::vector<uint32_t> table_of_;          // per instance; those of a prototype that stretch alike share one
  std::vector<std::vector<Vec2f>> tables_;  // empty: nothing but points, which are not scaled
};

// A thin primitive is not scaled below this, so that samples of it can still be told apart.
inline constexpr double kLeastParameterScale = 0x1p-16;

}  // namespace encore
