#include "core/trace/motion.h"

#include "core/trace/sphere.h"
#include "core/trace/trace_impl.h"

namespace encore {

namespace {

// Embree inverts transforms in float: determinants within float's range, and no inverse that would send
// ordinary coordinates beyond what Embree takes. What is scaled by 1e-9 cannot be seen anyway.
constexpr double kSmallestDeterminant = 1e-36, kLargestStretch = 1e9;

Affine3d toDouble(const Affine3f& f) {
  return {encore::toDouble(f.ex), encore::toDouble(f.ey), encore::toDouble(f.ez), encore::toDouble(f.origin)};
}

// |a| × |b| without cancellation: what rounding errors of a cross product are relative to.
Vec3d absoluteCross(Vec3d a, Vec3d b) {
  a = absolute(a), b = absolute(b);
  return {a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x};
}

// Largest entry of the linear part of the inverse.
double stretchOf(const Affine3d& to_prototype) {
  return std::max({maxComponent(absolute(to_prototype.ex)), maxComponent(absolute(to_prototype.ey)),
                   maxComponent(absolute(to_prototype.ez))});
}

// What Embree computes from one matrix.
struct Conditioning {
  double determinant, stretch;
  bool traceable() const {
    const double det = std::abs(determinant);
    return det > kSmallestDeterminant && det < 1 / kSmallestDeterminant && stretch < kLargestStretch;
  }
};

Conditioning conditioningOf(const Affine3d& m) { return {m.determinant(), stretchOf(inverse(m))}; }

// Between two keys the determinant is a cubic; where it is extreme and at even steps between. false: the
// matrix is singular, or nearly so, somewhere.
bool traceableBetween(const Affine3d& a, const Affine3d& b, double& stretch) {
  const auto at = [&](double w) {
    return Affine3d{a.ex * (1 - w) + b.ex * w, a.ey * (1 - w) + b.ey * w, a.ez * (1 - w) + b.ez * w, {}};
  };
  constexpr int kSteps = 16;
  double weights[kSteps + 3];
  for (int i = 0; i <= kSteps; ++i) weights[i] = double(i) / kSteps;
  int count = kSteps + 1;
  // d0 + c1 w + c2 w² + c3 w³ through four points; its extremes are the roots of c1 + 2 c2 w + 3 c3 w².
  const double d0 = at(0).determinant(), y1 = at(1).determinant() - d0, y2 = at(-1).determinant() - d0,
               y3 = at(2).determinant() - d0;
  const double c2 = (y1 + y2) / 2, c3 = (y3 - 4 * c2 - (y1 - y2)) / 6, c1 = y1 - c2 - c3;
  const double root = std::sqrt(std::max(0.0, c2 * c2 - 3 * c1 * c3));
  const double q = -(c2 + std::copysign(root, c2));
  for (const double w : {q / (3 * c3), c1 / q})
    if (w > 0 && w < 1) weights[count++] = w;
  for (int i = 0; i < count; ++i) {
    const Conditioning here = conditioningOf(at(weights[i]));
    if (!here.traceable() || (here.determinant < 0) != (d0 < 0)) return false;
    stretch = std::max(stretch, here.stretch);
  }
  return true;
}

// Embree multiplies both keys and adds; the time within the segment is known to a rounding of the number of
// segments at most. Ours is rounded once.
Vec3f betweenError(Vec3f a, Vec3f b, size_t segments) {
  return componentMax(absolute(a), absolute(b)) * float(roundingGamma(6)) +
         absolute(b - a) * float(roundingGamma(2) * double(segments));
}

void setReach(TracedInstance& traced, double stretch) {
  traced.largest_origin = embree::kLargestCoordinate / float(3 * std::max(1.0, stretch));
}

}  // namespace

// Embree computes the inverse as adjugate / determinant, and transforms origins with it, all in float.
// To first order a point p comes out wrong by at most A (|p| + |translation|) in prototype space, where
//   A = |inverse| (γ(6) + γ(8) det⁺/|det|) + γ(4) adj⁺/|det|   (⁺: sums of absolute products),
// hence by |to_world| A (...) in world space.
void addRayError(Placement& placement) {
  const Affine3d m = toDouble(placement.to_world), w = inverse(m);  // of what Embree is given
  const double det = std::abs(m.determinant());
  // Row i of the inverse is a cross product of two columns, over the determinant.
  const Vec3d adjugate[3] = {absoluteCross(m.ey, m.ez), absoluteCross(m.ez, m.ex), absoluteCross(m.ex, m.ey)};
  const Vec3d rows[3] = {{w.ex.x, w.ey.x, w.ez.x}, {w.ex.y, w.ey.y, w.ez.y}, {w.ex.z, w.ey.z, w.ez.z}};
  const double det_ratio = dot(absolute(m.ex), adjugate[0]) / det;
  Vec3d a[3];
  for (int i = 0; i < 3; ++i)
    a[i] =
        absolute(rows[i]) * (roundingGamma(6) + roundingGamma(8) * det_ratio) + adjugate[i] * (roundingGamma(4) / det);
  Vec3f* const out[3] = {&placement.ray_error_x, &placement.ray_error_y, &placement.ray_error_z};
  for (int i = 0; i < 3; ++i)
    *out[i] = toFloat(a[0] * std::abs(m.ex[i]) + a[1] * std::abs(m.ey[i]) + a[2] * std::abs(m.ez[i]));
}

TracedInstance makeInstance(const Instance& instance) {
  TracedInstance traced;
  traced.prototype = instance.prototype;
  traced.material = instance.material, traced.link_group = instance.link_group;
  for (const Affine3d& key : instance.motion) traced.keys.push_back(toFloat(key));
  traced.still.to_world = traced.moves() ? traced.keys[0] : toFloat(instance.to_world);
  const auto stays = [&](const Affine3f& key) { return key == traced.keys[0]; };
  if (std::all_of(traced.keys.begin(), traced.keys.end(), stays)) traced.keys.clear();
  traced.keys.shrink_to_fit();
  double stretch = 0;
  for (size_t i = 0; i + 1 < traced.keys.size(); ++i)
    traced.traceable &= traceableBetween(toDouble(traced.keys[i]), toDouble(traced.keys[i + 1]), stretch);
  if (traced.moves()) {
    setReach(traced, 2 * stretch);  // between the steps that were looked at
    return traced;
  }
  const Affine3d m = toDouble(traced.still.to_world), w = inverse(m);
  const Conditioning here{m.determinant(), stretchOf(w)};
  traced.traceable = here.traceable();
  if (!traced.traceable) return traced;
  traced.still.to_prototype = toFloat(w);
  setReach(traced, here.stretch);
  addRayError(traced.still);
  return traced;
}

Affine3f worldAt(const TracedInstance& instance, float time) {
  const KeyTime key(time, instance.keys.size());
  return key.between(instance.keys[key.first], instance.keys[key.first + 1]);
}

Placement placementAt(const TracedInstance& instance, float time) {
  Placement placement;
  placement.to_world = worldAt(instance, time);
  placement.to_prototype = toFloat(inverse(toDouble(placement.to_world)));
  return placement;
}

Affine3f keyError(const TracedInstance& instance, float time) {
  const size_t segments = instance.keys.size() - 1;
  const KeyTime key(time, instance.keys.size());
  const Affine3f &a = instance.keys[key.first], &b = instance.keys[key.first + 1];
  return {betweenError(a.ex, b.ex, segments), betweenError(a.ey, b.ey, segments), betweenError(a.ez, b.ez, segments),
          betweenError(a.origin, b.origin, segments)};
}

Vec3f centreError(const DicedMesh& mesh, uint32_t point, float time) {
  if (mesh.motion_spheres.empty()) return {};
  const KeyTime key(time, mesh.motion_spheres.size());
  const Vec4f &a = mesh.motion_spheres[key.first][point], &b = mesh.motion_spheres[key.first + 1][point];
  return betweenError({a.x, a.y, a.z}, {b.x, b.y, b.z}, mesh.motion_spheres.size() - 1);
}

Vec3f vertexError(const DicedMesh& mesh, const Corners& corners, float time) {
  const KeyTime key(time, mesh.motion_positions.size());
  const std::vector<Vec3f>&a = mesh.motion_positions[key.first], &b = mesh.motion_positions[key.first + 1];
  Vec3f worst;
  for (const uint32_t i : {corners.i0, corners.i1, corners.i2})
    worst = componentMax(worst, betweenError(a[i], b[i], mesh.motion_positions.size() - 1));
  return worst;
}

}  // namespace encore
