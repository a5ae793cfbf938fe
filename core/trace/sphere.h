// Hits on points, which Embree traces as spheres.
//
// Hit::triangle is the point's index. Hit::b1 and b2 are half the parameters (core/dice/spheres.h), so that their sum
// is at most 1, as of triangles. The position is the centre plus the radius times the normal there: it lies on the
// sphere however far away the ray began.
#pragma once

#include <array>
#include <span>

#include "core/dice/spheres.h"
#include "core/trace/embree_api.h"
#include "core/trace/trace_impl.h"

namespace encore {

// A place on a sphere in prototype space.
struct SphereSpot {
  Vec3f centre;
  float radius;
  Vec3f normal;    // unit
  Vec3f dn1, dn2;  // its change by b1 and b2

  SphereSpot(const DicedMesh& mesh, const Hit& hit);
  Vec3f position() const { return centre + normal * radius; }
};

// Change of (u, v) by b1, and by b2.
inline constexpr std::array<Vec2f, 2> kSphereParameters{Vec2f{2, 0}, Vec2f{0, 2}};

// (b1, b2) of a direction from the centre.
Vec2f sphereCoordinates(Vec3d direction);

// Centre and radius at a time, as SphereSpot has them.
Vec4f sphereAt(const DicedMesh& mesh, uint32_t point, float time);
// How far Embree's centre may be from that, prototype space.
Vec3f centreError(const DicedMesh& mesh, uint32_t point, float time);

// Both crossings of a ray with a sphere of an instance, nearest first, in double precision: the same whatever the ray
// shares its packet with. count 0: it misses.
struct SphereCrossings {
  uint32_t count = 0;
  std::array<double, 2> t;
  std::array<Vec2f, 2> coordinates;

  SphereCrossings(const TracedInstance& instance, const DicedMesh& mesh, uint32_t point, const Ray& ray);
};

// The coordinates of hits on a geometry of spheres, whose user data is the DicedMesh: Embree has none.
void filterSphereHits(const RTCFilterFunctionNArguments* arguments);

// A value per sphere, or one for all.
template <class T>
T sphereValue(const std::vector<T>& values, uint32_t point) {
  return values.size() == 1 ? values[0] : values[point];
}

}  // namespace encore
