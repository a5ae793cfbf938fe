// How a light's emission depends on its direction (UsdLuxShapingAPI), without profiles.
#pragma once

#include "core/scene/light.h"

namespace encore {

// Factor on the radiance that leaves the light along `emitted` (unit). Focus: |cos|^focus of the angle to the light's
// axis mixes focusTint with white. Cone: 0 beyond cone_angle, and a smooth step up to it from (1 - softness) of it.
// Formulas: UsdLuxShapingAPI of OpenUSD 25; the axis, where the text says normal, as its hdEmbree does. Only lights at
// finite distance are shaped.
Vec3f shapingFactor(const Light& light, Vec3f emitted);

// At least the largest component of shapingFactor() over all directions within a cone around `emitted`.
float shapingBound(const Light& light, Vec3f emitted, float half_angle_radians);

}  // namespace encore
