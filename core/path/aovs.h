// Arbitrary output variables: what Settings::aovs ask of the camera's first hits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/path/path.h"
#include "core/scene/aov.h"

namespace encore {

inline constexpr uint32_t kNoSample = 0xffffffffu;

// Values at the first hits of a batch, in slot order. Keeps references to its arguments. What each kind of Aov is:
// core/scene/aov.h; the film resolves them (Film::addAov(), setAov()).
class AovValues {
 public:
  AovValues(const ShadeContext& context, const CameraRays& camera);

  // The slot of the closest sample of every pixel, the first of those at one depth; kNoSample: nothing was hit.
  // first: per_pixel slots for each.
  std::vector<uint32_t> closest(std::span<const FirstHit> first, uint32_t per_pixel) const;

  // Unfiltered: of the slots that closest() chose. Kind::Position and EyePosition: 3 values per pixel, 0 where nothing
  // was hit. values: 3 * slots.size().
  void positions(const Aov& aov, std::span<const FirstHit> first, std::span<const uint32_t> slots,
                 std::span<float> values) const;
  // Kind::PrimId, InstanceId, ElementId: one per pixel, -1 where nothing was hit.
  void ids(const Aov& aov, std::span<const FirstHit> first, std::span<const uint32_t> slots,
           std::span<int32_t> ids) const;
  // Kind::Primvar: aov.components per sample; 0 where nothing was hit or the mesh has no such primvar.
  void primvar(const Aov& aov, std::span<const FirstHit> first, std::span<float> values) const;
  // Kind::EyeNormal of resolved normals in world space. The camera's scale does not count.
  void eyeNormals(std::span<const Vec3f> normals, std::span<float> values) const;

 private:
  const ShadeContext& context_;
  const CameraRays& camera_;
  Affine3d to_camera_;
  Affine3d normal_to_camera_;  // its columns are where the axes of the world go
};

}  // namespace encore
