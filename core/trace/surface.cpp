// What is known at a hit: position with its rounding error, normals, parametric coordinates.
#include "core/trace/sphere.h"
#include "core/trace/trace_impl.h"
#include "core/trace/traced_triangle.h"

namespace encore {

namespace {

constexpr float gammaf(int n) { return float(roundingGamma(n)); }

// Rounding products of a × b are relative to this.
Vec3f absoluteCross(Vec3f a, Vec3f b) {
  a = absolute(a), b = absolute(b);
  return {a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x};
}

}  // namespace

// How far from the plane, in units of `scale`, a ray's origin over this triangle must be for Embree's
// robust test to see it on the right side. The test moves the vertices to the origin, takes the normal of
// the moved triangle (for each component from the pair of edges with the smaller products) and compares
// dot(v0, normal) with 0: the moved vertices, the cross product and the dot product each round. The same
// bound times the longest edge keeps rays that graze the plane from coming back to the triangle.
// Never more than the triangle's own height: nothing sensible can be said about needles thinner than that.
float LocalTriangle::planeError() const {
  const float normal_length = length(normal);
  const Vec3f e3 = e2 - e1;
  const Vec3f reach = componentMax(componentMax(absolute(e1), absolute(e2)), absolute(e3));
  const Vec3f c1 = absoluteCross(e2, e1), c2 = absoluteCross(e1, e3);
  const Vec3f products{std::min(c1.x, c2.x), std::min(c1.y, c2.y), std::min(c1.z, c2.z)};
  const float bound = (gammaf(4) * dot(reach, absolute(normal)) + gammaf(4) * dot(reach, products)) / normal_length;
  const float longest = std::sqrt(std::max({dot(e1, e1), dot(e2, e2), dot(e3, e3)}));
  return std::min(bound, normal_length / longest);
}

int32_t resolveMaterial(const TracedInstance& instance, const TracedMesh& mesh, uint32_t primitive) {
  if (instance.material >= 0) return instance.material;
  if (!mesh.mesh->face_materials.empty()) {
    const uint32_t face = isSpheres(*mesh.diced) ? primitive : mesh.diced->primitive_face[primitive];
    const int32_t material = mesh.mesh->face_materials[face];
    if (material >= 0) return material;
  }
  return mesh.mesh->material;
}

int32_t materialOfTriangle(const TracedInstance& instance, const TracedMesh& mesh, uint32_t triangle) {
  if (instance.material >= 0 || mesh.mesh->face_materials.empty()) return resolveMaterial(instance, mesh, 0);
  return resolveMaterial(instance, mesh, isSpheres(*mesh.diced) ? triangle : mesh.diced->triangle_primitive[triangle]);
}

int32_t TraceScene::material(const Hit& hit) const {
  return materialOfTriangle(impl_->instances[hit.instance], impl_->meshOf(hit), hit.triangle);
}

TracedTriangle::TracedTriangle(const TraceScene& trace, const Hit& hit)
    : instance_index_(hit.instance), mesh_(hit.mesh), triangle_(hit.triangle), time_(hit.time) {
  const TraceScene::Impl& scene = *trace.impl_;
  instance_ = &scene.instances[hit.instance];
  const TracedMesh& mesh = scene.meshOf(hit);
  const DicedMesh& diced = *mesh.diced;
  if (!diced.motion_positions.empty()) deforming_ = &diced;
  moves_ = deforming_ || instance_->moves();
  thin_ = mesh.mesh->thin_walled;
  if (isSpheres(diced)) {
    fillSphere(scene, mesh, hit);
    return;
  }
  const Corners corners(diced, hit.triangle);
  const uint32_t primitive = diced.triangle_primitive[hit.triangle];
  primitive_ = mesh.first_primitive + primitive;
  material_ = resolveMaterial(*instance_, mesh, primitive);
  scale_ = scene.parameterScale(hit.instance, primitive_);
  uv_ = diced.uv[corners.i0];
  duv1_ = diced.uv[corners.i1] - uv_, duv2_ = diced.uv[corners.i2] - uv_;

  const PlacedTriangle placed(*instance_, diced, corners, hit.time);
  p0_ = placed.p0, edge1_ = placed.edge1, edge2_ = placed.edge2;
  e1_ = placed.place().to_world.vector(edge1_), e2_ = placed.place().to_world.vector(edge2_);
  const LocalTriangle triangle(edge1_, edge2_);
  const Affine3f& to_prototype = placed.place().to_prototype;
  const Vec3f covector = to_prototype.transposedVector(triangle.normal);
  const float covector_length = length(covector);
  degenerate_ = !(covector_length > 0);
  if (!degenerate_) ng_ = covector * (1 / covector_length);
  smooth_ = !diced.normals.empty();
  if (!smooth_) return;
  const std::array<Vec3f, 3> n = corners.at(hit.time, diced.normals, diced.motion_normals);
  n_ = to_prototype.transposedVector(n[0]);
  dn1_ = to_prototype.transposedVector(n[1] - n[0]);
  dn2_ = to_prototype.transposedVector(n[2] - n[0]);
}

// The tangent triangle of one hit. Its position is the spot's, but for roundings that sphere_error_ covers.
void TracedTriangle::fillSphere(const TraceScene::Impl& scene, const TracedMesh& mesh, const Hit& hit) {
  const DicedMesh& diced = *mesh.diced;
  moves_ = true, time_ = std::numeric_limits<float>::quiet_NaN();  // holds no other hit
  primitive_ = mesh.first_primitive + hit.triangle;
  material_ = resolveMaterial(*instance_, mesh, hit.triangle);
  scale_ = scene.parameterScale(hit.instance, primitive_);
  duv1_ = kSphereParameters[0], duv2_ = kSphereParameters[1];

  const SphereSpot spot(diced, hit);
  edge1_ = spot.dn1 * spot.radius, edge2_ = spot.dn2 * spot.radius;
  p0_ = spot.position() - (edge1_ * hit.b1 + edge2_ * hit.b2);
  const std::optional<Placement> moving =
      instance_->moves() ? std::optional(placementAt(*instance_, hit.time)) : std::nullopt;
  const Placement& place = moving ? *moving : instance_->still;
  e1_ = place.to_world.vector(edge1_), e2_ = place.to_world.vector(edge2_);
  n_ = place.to_prototype.transposedVector(spot.normal);
  const float covector_length = length(n_);
  degenerate_ = !(covector_length > 0);
  if (!degenerate_) ng_ = n_ * (1 / covector_length);
  dn1_ = place.to_prototype.transposedVector(spot.dn1), dn2_ = place.to_prototype.transposedVector(spot.dn2);
  n_ = n_ - (dn1_ * hit.b1 + dn2_ * hit.b2);
  smooth_ = true;

  // Embree compares squares, which are known to some roundings of the squared radius: rays that leave the sphere have
  // to begin as far from it for that to tell. To the position come its own roundings and those of the centre.
  const Vec3f size = absolute(spot.centre) + Vec3f{spot.radius, spot.radius, spot.radius};
  const Vec3f local_error = size * gammaf(4) + centreError(diced, hit.triangle, hit.time) * 2;
  const Affine3f& m = place.to_world;
  has_plane_error_ = true;
  plane_error_ = Affine3f{absolute(m.ex), absolute(m.ey), absolute(m.ez), {}}.vector(local_error);
  if (!degenerate_) plane_error_ = plane_error_ + absolute(ng_) * (spot.radius * gammaf(16) / covector_length);
}

SurfacePoint TracedTriangle::surface(const Hit& hit, Vec3f direction) const {
  SurfacePoint point;
  const Vec3f local = p0_ + (edge1_ * hit.b1 + edge2_ * hit.b2);
  point.position =
      instance_->moves() ? worldAt(*instance_, hit.time).point(local) : instance_->still.to_world.point(local);
  point.e1 = e1_, point.e2 = e2_;
  point.ng = degenerate_ ? -direction : ng_;
  point.side = dot(point.ng, direction) > 0 ? 1 : 0;
  point.ns = point.ng;
  if (smooth_) {
    const Vec3f n = n_ + (dn1_ * hit.b1 + dn2_ * hit.b2);
    const float size = length(n);
    if (dot(n, point.ng) > 0 && std::isfinite(size)) {  // else it is useless
      const float factor = 1 / size;
      point.ns = n * factor;
      point.dn1 = (dn1_ - point.ns * dot(point.ns, dn1_)) * factor;
      point.dn2 = (dn2_ - point.ns * dot(point.ns, dn2_)) * factor;
    }
  }
  point.primitive = primitive_;
  point.material = material_;
  point.thin = thin_;
  point.time = hit.time;
  const Vec2f uv = uv_ + (duv1_ * hit.b1 + duv2_ * hit.b2);
  point.uv = {std::clamp(uv.x, 0.0f, 1.0f) * scale_.x, std::clamp(uv.y, 0.0f, 1.0f) * scale_.y};
  return point;
}

// Follows PBR 4th ed., §6.8: point = p0 + (b1 e1 + b2 e2) in prototype space, then transformed; every
// rounding is bounded to first order. To that comes what Embree's own transform of a ray that starts here,
// and its test against this triangle, may add.
Vec3f TracedTriangle::positionError(const Hit& hit, const SurfacePoint& point) {
  if (instance_->moves()) return movingPositionError(hit, point);
  if (!has_plane_error_) fillPlaneError(instance_->still);
  return positionErrorAt(instance_->still, hit, point);
}

Vec3f TracedTriangle::positionErrorAt(const Placement& place, const Hit& hit, const SurfacePoint& point) const {
  const Vec3f local = p0_ + (edge1_ * hit.b1 + edge2_ * hit.b2);
  const Vec3f from_corner = absolute(edge1_) * hit.b1 + absolute(edge2_) * hit.b2;

  const Affine3f& m = place.to_world;
  const Affine3f magnitude{absolute(m.ex), absolute(m.ey), absolute(m.ez), absolute(m.origin)};
  const Vec3f local_error = absolute(local) * gammaf(1) + from_corner * gammaf(5);
  const Vec3f reach = absolute(point.position) + magnitude.origin + absolute(point.e1) + absolute(point.e2);
  return magnitude.point(absolute(local)) * gammaf(4) + magnitude.vector(local_error) +
         Vec3f{dot(place.ray_error_x, reach), dot(place.ray_error_y, reach), dot(place.ray_error_z, reach)} +
         plane_error_;
}

// To that comes how far Embree's interpolated matrix may be from ours.
Vec3f TracedTriangle::movingPositionError(const Hit& hit, const SurfacePoint& point) {
  Placement place = placementAt(*instance_, hit.time);
  addRayError(place);
  if (!has_plane_error_) fillPlaneError(place);
  const Vec3f reach = absolute(p0_) + absolute(edge1_) + absolute(edge2_);
  return positionErrorAt(place, hit, point) + keyError(*instance_, hit.time).point(reach);
}

// A distance along the prototype-space normal, seen along the world-space one. Where the mesh deforms, Embree's
// triangle is beside ours: twice, because rays may start a little outside of it.
void TracedTriangle::fillPlaneError(const Placement& place) {
  has_plane_error_ = true;
  if (!degenerate_) {
    const LocalTriangle triangle(edge1_, edge2_);
    const float covector_length = length(place.to_prototype.transposedVector(triangle.normal));
    const float stretch = triangle.scale * length(triangle.normal) / covector_length;
    plane_error_ = absolute(ng_) * (triangle.planeError() * stretch);
  }
  if (!deforming_) return;
  const Affine3f& m = place.to_world;
  const Vec3f error = vertexError(*deforming_, Corners(*deforming_, triangle_), time_) * 2;
  plane_error_ = plane_error_ + Affine3f{absolute(m.ex), absolute(m.ey), absolute(m.ez), {}}.vector(error);
}

void TracedTriangle::fillGradients() {
  has_gradients_ = true;
  const Vec3d a = toDouble(e1_), b = toDouble(e2_), n = cross(a, b);
  const double area2 = dot(n, n);
  if (!(area2 > 0)) return;
  of_b1_ = toFloat(cross(b, n) / area2), of_b2_ = toFloat(cross(n, a) / area2);
}

Vec3f TraceScene::positionError(const Hit& hit, const SurfacePoint& point) const {
  return TracedTriangle(*this, hit).positionError(hit, point);
}

SurfacePoint TraceScene::surface(const Hit& hit, Vec3f direction, bool with_error) const {
  TracedTriangle triangle(*this, hit);
  SurfacePoint point = triangle.surface(hit, direction);
  if (with_error) point.position_error = triangle.positionError(hit, point);
  return point;
}

// Of the triangle's size: far below the rounding of any point that has one, far above denormal numbers.
constexpr float kLeastOffset = 0x1p-46f;

// Pharr et al., PBR 4th ed., §6.8.6: far enough along ng that the box of the error is left behind, then one
// representable number further on every axis.
Vec3f SurfacePoint::offsetOrigin(Vec3f direction) const {
  // A plane through the origin can have no rounding error at all; a denormal step would be flushed to zero.
  const float distance = std::max(dot(absolute(ng), position_error),
                                  kLeastOffset * std::max(maxComponent(absolute(e1)), maxComponent(absolute(e2))));
  const Vec3f offset = ng * (dot(ng, direction) < 0 ? -distance : distance);
  Vec3f origin = position + offset;
  for (int axis = 0; axis < 3; ++axis)
    if (offset[axis] != 0)
      origin[axis] = std::nextafter(origin[axis], std::copysign(std::numeric_limits<float>::infinity(), offset[axis]));
  return origin;
}

// Least squares: the dual basis of (e1, e2). In double, because squares of micropolygon areas underflow float.
Vec2f SurfacePoint::barycentricChange(Vec3f dp) const {
  const Vec3d a = toDouble(e1), b = toDouble(e2), d = toDouble(dp);
  const Vec3d n = cross(a, b);
  const double area2 = dot(n, n);
  if (!(area2 > 0)) return {0, 0};
  return {float(dot(cross(d, b), n) / area2), float(dot(cross(a, d), n) / area2)};
}

// Least squares, as barycentricChange().
ParameterGradients parameterGradients(Vec2f uv1, Vec2f uv2, Vec3f e1, Vec3f e2, Vec2f scale) {
  const Vec3d a = toDouble(e1), b = toDouble(e2), n = cross(a, b);
  const double area2 = dot(n, n);
  if (!(area2 > 0)) return {};
  const Vec3d of_b1 = cross(b, n) / area2, of_b2 = cross(n, a) / area2;
  return {toFloat((of_b1 * double(uv1.x) + of_b2 * double(uv2.x)) * double(scale.x)),
          toFloat((of_b1 * double(uv1.y) + of_b2 * double(uv2.y)) * double(scale.y))};
}

ParameterGradients parameterGradients(const DicedMesh& mesh, const Corners& corners, Vec3f e1, Vec3f e2, Vec2f scale) {
  return parameterGradients(mesh.uv[corners.i1] - mesh.uv[corners.i0], mesh.uv[corners.i2] - mesh.uv[corners.i0], e1,
                            e2, scale);
}

float TraceScene::parametricFootprint(const Hit& hit, const SurfacePoint& point, Vec3f dpdx, Vec3f dpdy) const {
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  if (isSpheres(mesh))
    return parameterGradients(kSphereParameters[0], kSphereParameters[1], point.e1, point.e2,
                              impl_->parameterScale(hit.instance, point.primitive))
        .footprint(dpdx, dpdy);
  return parameterGradients(mesh, Corners(mesh, hit.triangle), point.e1, point.e2,
                            impl_->parameterScale(hit.instance, point.primitive))
      .footprint(dpdx, dpdy);
}

}  // namespace encore
