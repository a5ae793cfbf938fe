// What the direct layer makes of a first hit: tables per material, so that a sample costs little.
#pragma once

#include <cstdint>
#include <vector>

#include "core/shade/bsdf.h"
#include "core/shade/shade.h"

namespace encore {

// Lights that the camera sees. Near and far clipping planes do not cut them.
std::vector<Light> cameraLights(const Scene& scene, const Settings& settings);

inline bool carriesSomething(Vec3f throughput) { return isFinite(throughput) && maxComponent(throughput) > 0; }

// Share of a first hit's light that comes from shading it: what tracePaths() gives as throughput.
class DirectWeights {
 public:
  explicit DirectWeights(const ShadeContext& context);

  // The weight of every hit on the material; null where they differ, or carry nothing.
  const Vec3f* constant(int32_t material) const {
    const Entry& entry = materials_[size_t(material)];
    return entry.kind == Kind::Constant && carriesSomething(entry.constant) ? &entry.constant : nullptr;
  }
  // The material's path inputs have to be evaluated first, or its normal map.
  bool varies(int32_t material) const { return materials_[size_t(material)].kind == Kind::Varying; }
  // Whether the surface is a thin sheet matters.
  bool asksForThin(int32_t material) const { return materials_[size_t(material)].lobes[0][0].refracts; }
  // cosine: between the way back and the normal, as in Arrival. Precondition: not varies(material).
  Vec3f weight(int32_t material, bool thin, uint32_t side, float cosine) const {
    const Entry& entry = materials_[size_t(material)];
    if (entry.kind == Kind::Constant) return entry.constant;
    return effectWeights(entry.lobes[thin][side], cosine, false).absorption;
  }

 private:
  enum class Kind { Constant, ByCosine, Varying };
  struct Entry {
    Kind kind = Kind::Constant;
    Vec3f constant{1, 1, 1};
    Lobes lobes[2][2];  // of solids and of thin sheets, by side
  };
  static Entry makeEntry(const ShadeContext& context, int32_t material, bool view_weight_in_shading);

  std::vector<Entry> materials_;
};

}  // namespace encore
