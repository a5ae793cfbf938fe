#include "core/trace/sphere.h"

#include <cmath>

namespace encore {

namespace {

Affine3d toDouble(const Affine3f& f) {
  return {encore::toDouble(f.ex), encore::toDouble(f.ey), encore::toDouble(f.ez), encore::toDouble(f.origin)};
}

// Where a ray meets a sphere, in the sphere's space. direction: of any length.
struct Chord {
  bool hits = false;
  double t[2];
  Vec3d out[2];  // from the centre

  Chord(Vec3d origin, Vec3d direction, Vec3d centre, double radius) {
    const Vec3d to_centre = centre - origin;
    const double square = dot(direction, direction);
    if (!(square > 0) || !(radius > 0)) return;
    const double middle = dot(to_centre, direction) / square;
    const Vec3d nearest = direction * middle - to_centre;  // from the centre to the ray
    const double rest = radius * radius - dot(nearest, nearest);
    hits = rest >= 0;
    const double half = std::sqrt(std::max(0.0, rest) / square);
    t[0] = middle - half, t[1] = middle + half;
    out[0] = nearest - direction * half, out[1] = nearest + direction * half;
  }
};

}  // namespace

Vec2f sphereCoordinates(Vec3d direction) {
  const auto [u, v] = sphereParameters(direction);
  return {float(u / 2), float(v / 2)};
}

Vec4f sphereAt(const DicedMesh& mesh, uint32_t point, float time) {
  if (mesh.motion_spheres.empty()) return mesh.spheres[point];
  const KeyTime key(time, mesh.motion_spheres.size());
  const Vec4f a = mesh.motion_spheres[key.first][point], b = mesh.motion_spheres[key.first + 1][point];
  const Vec3f centre = key.between(Vec3f{a.x, a.y, a.z}, Vec3f{b.x, b.y, b.z});
  return {centre.x, centre.y, centre.z, a.w};
}

SphereSpot::SphereSpot(const DicedMesh& mesh, const Hit& hit) {
  const Vec4f sphere = sphereAt(mesh, hit.triangle, hit.time);
  centre = {sphere.x, sphere.y, sphere.z}, radius = sphere.w;
  const SphereNormal at(2 * double(hit.b1), 2 * double(hit.b2));
  normal = toFloat(at.n), dn1 = toFloat(at.du * 2.0), dn2 = toFloat(at.dv * 2.0);
}

SphereCrossings::SphereCrossings(const TracedInstance& instance, const DicedMesh& mesh, uint32_t point,
                                 const Ray& ray) {
  const Affine3d to_world = toDouble(instance.moves() ? worldAt(instance, ray.time) : instance.still.to_world);
  const Affine3d to_prototype = inverse(to_world);
  const Vec4f sphere = sphereAt(mesh, point, ray.time);
  const Chord chord(to_prototype.point(encore::toDouble(ray.origin)),
                    to_prototype.vector(encore::toDouble(ray.direction)),
                    encore::toDouble(Vec3f{sphere.x, sphere.y, sphere.z}), sphere.w);
  if (!chord.hits) return;
  for (count = 0; count < 2; ++count)
    t[count] = chord.t[count], coordinates[count] = sphereCoordinates(chord.out[count]);
}

// Embree's normal says which of the two crossings it is; where exactly is found anew, because a sphere far from the
// ray's origin comes out rough in single precision.
void filterSphereHits(const RTCFilterFunctionNArguments* arguments) {
  const DicedMesh& mesh = *static_cast<const DicedMesh*>(arguments->geometryUserPtr);
  const uint32_t n = arguments->N;
  RTCRayN* r = arguments->ray;
  RTCHitN* h = arguments->hit;
  for (uint32_t i = 0; i < n; ++i) {
    if (arguments->valid[i] == 0) continue;
    const Vec4f sphere = sphereAt(mesh, RTCHitN_primID(h, n, i), RTCRayN_time(r, n, i));
    const Vec3d direction{RTCRayN_dir_x(r, n, i), RTCRayN_dir_y(r, n, i), RTCRayN_dir_z(r, n, i)};
    const Vec3d normal{RTCHitN_Ng_x(h, n, i), RTCHitN_Ng_y(h, n, i), RTCHitN_Ng_z(h, n, i)};
    const Chord chord({RTCRayN_org_x(r, n, i), RTCRayN_org_y(r, n, i), RTCRayN_org_z(r, n, i)}, direction,
                      {sphere.x, sphere.y, sphere.z}, sphere.w);
    const Vec2f b = sphereCoordinates(chord.hits ? chord.out[dot(normal, direction) > 0 ? 1 : 0] : normal);
    RTCHitN_u(h, n, i) = b.x, RTCHitN_v(h, n, i) = b.y;
  }
}

}  // namespace encore
