#include "core/path/differentials.h"

namespace encore {

Vec3f refractDifferential(Vec3f direction, Vec3f out, Vec3f n, float eta, Vec3f dd, Vec3f dn) {
  const float ratio = 1 / eta;
  const float cos_in = dot(direction, n), cos_out = dot(out, n);  // both negative
  const float change = dot(dd, n) + dot(direction, dn);
  const float mu = ratio * cos_in - cos_out;
  const float dmu = (ratio - ratio * ratio * cos_in / cos_out) * change;
  return dd * ratio - (dn * mu + n * dmu);
}

Vec3f shortened(Vec3f v, float longest) {
  if (!isFinite(v)) return {};
  const float size = maxComponent(absolute(v));
  if (size > longest) v = v * (longest / size);  // first, so that the squares below stay finite
  const float l = length(v);
  return l > longest ? v * (longest / l) : v;
}

}  // namespace encore
