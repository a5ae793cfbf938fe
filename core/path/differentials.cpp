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

// Singular values: A = rotation(u) * diag(large, small) * rotation(v), small with the sign of the determinant.
Spread widened(const Spread& spread, Vec3f direction, float width) {
  if (!(width > 0)) return spread;
  const Basis basis(direction);
  const float a = dot(basis.t, spread.x), b = dot(basis.t, spread.y), c = dot(basis.b, spread.x),
              d = dot(basis.b, spread.y);
  const float e = (a + d) / 2, f = (a - d) / 2, g = (c + b) / 2, h = (c - b) / 2;
  const float q = std::hypot(e, h), r = std::hypot(f, g);
  const float of_difference = std::atan2(g, f), of_sum = std::atan2(h, e);
  const float u = (of_sum + of_difference) / 2, v = (of_sum - of_difference) / 2;
  const auto wider = [&](float axis) { return std::copysign(std::hypot(axis, width), axis); };
  const float large = wider(q + r), small = wider(q - r);
  const float cos_u = std::cos(u), sin_u = std::sin(u), cos_v = std::cos(v), sin_v = std::sin(v);
  const auto column = [&](float first, float second) {  // of rotation(u) * (first, second)
    return basis.t * (cos_u * first - sin_u * second) + basis.b * (sin_u * first + cos_u * second);
  };
  return {column(large * cos_v, small * sin_v), column(-large * sin_v, small * cos_v)};
}

}  // namespace encore
