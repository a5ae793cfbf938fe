// What all hits on a material share, prepared once per layer.
#pragma once

#include <vector>

#include "core/path/path.h"
#include "core/path/scatter.h"

namespace encore {

struct PathMaterial {
  bool feeds_layer = false;
  bool varies = false;  // the lobes are those of each hit's inputs
  bool mapped = false;  // the shading normal is the normal map's
  bool view_weight_in_shading = false;
  Lobes lobes[2][2];  // in air: of solids and of thin sheets, by side
  bool absorbs_all[2][2] = {{false, false}, {false, false}};
};

class PathMaterials {
 public:
  // Keeps a reference to context.
  PathMaterials(const ShadeContext& context, Layer layer);

  const PathMaterial& operator[](int32_t material) const { return materials_[size_t(material)]; }
  bool anyVaries() const { return any_varies_; }
  // The lobes of a hit. inputs: null where the material does not vary. other_ior: of the medium on the outside.
  Lobes lobesOf(const SurfacePoint& point, const PathInputs* inputs, float other_ior) const;
  // Replaces point.ns where the material has a normal map.
  void mapNormal(const Hit& hit, const PathInputs* inputs, SurfacePoint& point) const;

 private:
  const PathInputs& inputsOf(int32_t material, const PathInputs* inputs) const {
    return inputs ? *inputs : context_.patterns.constantPath(material);
  }

  const ShadeContext& context_;
  std::vector<PathMaterial> materials_;
  bool any_varies_ = false;
};

}  // namespace encore
