// What meshes carry besides their shape, at hits; and their triangles, for lights that are made of them.
#include <string>
#include <string_view>

#include "core/trace/sphere.h"
#include "core/trace/trace_impl.h"

namespace encore {

namespace {

// Of the set called `name`, where it has values; else -1.
template <class T>
int32_t slotOf(const std::vector<Primvar<T>>& sets, const std::vector<std::vector<T>>& diced, const std::string& name) {
  for (size_t i = 0; i < sets.size(); ++i)
    if (sets[i].name == name) return i < diced.size() && !diced[i].empty() ? int32_t(i) : -1;
  return -1;
}

// Slots from here on are of Instance::primvars.
constexpr int32_t kInstanceSlots = 1 << 30;

// The value that an instance gives to a name, if it does.
struct InstanceValue {
  int32_t slot = -1;
  bool wins = false;
};

InstanceValue instanceValueOf(const Scene& scene, uint32_t instance, std::string_view name) {
  if (scene.instance_primvars.empty()) return {};
  const std::vector<InstancePrimvar>& primvars = scene.instances[instance].primvars;
  for (size_t i = 0; i < primvars.size(); ++i)
    if (scene.instance_primvars[primvars[i].name] == name) return {kInstanceSlots + int32_t(i), primvars[i].wins};
  return {};
}

const Vec4f& instanceValue(const Scene& scene, const Hit& hit, int32_t slot) {
  return scene.instances[hit.instance].primvars[size_t(slot - kInstanceSlots)].value;
}

}  // namespace

TexcoordPoint TraceScene::texcoord(const Hit& hit, const SurfacePoint& point, int32_t slot, Vec3f dpdx,
                                   Vec3f dpdy) const {
  if (slot < 0) return {};
  if (slot >= kInstanceSlots) {
    const Vec4f& value = instanceValue(impl_->scene, hit, slot);
    return {{value.x, value.y}, {}, {}};
  }
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  const std::vector<Vec2f>& values = mesh.texcoords[size_t(slot)];
  if (isSpheres(mesh)) return {sphereValue(values, hit.triangle), {}, {}};
  const Corners corners(mesh, hit.triangle);
  const Vec2f st1 = values[corners.i1] - values[corners.i0], st2 = values[corners.i2] - values[corners.i0];
  const Vec2f bx = point.barycentricChange(dpdx), by = point.barycentricChange(dpdy);
  return {corners.interpolate(values, hit.b1, hit.b2), st1 * bx.x + st2 * bx.y, st1 * by.x + st2 * by.y};
}

int32_t TraceScene::texcoordSlot(const Hit& hit, const std::string& name) const {
  const InstanceValue given = instanceValueOf(impl_->scene, hit.instance, name);
  if (given.wins) return given.slot;
  const TracedMesh& mesh = impl_->meshOf(hit);
  const int32_t own = slotOf(mesh.mesh->texcoords, mesh.diced->texcoords, name);
  return own >= 0 ? own : given.slot;
}

Vec3f TraceScene::displayColor(const Hit& hit) const {
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  const InstanceValue given = instanceValueOf(impl_->scene, hit.instance, "displayColor");
  if (given.slot >= 0 && (given.wins || mesh.display_color.empty())) {
    const Vec4f& value = instanceValue(impl_->scene, hit, given.slot);
    return {value.x, value.y, value.z};
  }
  if (mesh.display_color.empty()) return {0.18f, 0.18f, 0.18f};
  if (isSpheres(mesh)) return sphereValue(mesh.display_color, hit.triangle);
  return Corners(mesh, hit.triangle).interpolate(mesh.display_color, hit.b1, hit.b2);
}

int32_t TraceScene::primvarSlot(const Hit& hit, const std::string& name) const {
  const InstanceValue given = instanceValueOf(impl_->scene, hit.instance, name);
  if (given.wins) return given.slot;
  const TracedMesh& mesh = impl_->meshOf(hit);
  const int32_t own = slotOf(mesh.mesh->primvars, mesh.diced->primvars, name);
  return own >= 0 ? own : given.slot;
}

Vec4f TraceScene::primvar(const Hit& hit, int32_t slot) const {
  if (slot < 0) return {};
  if (slot >= kInstanceSlots) return instanceValue(impl_->scene, hit, slot);
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  if (isSpheres(mesh)) return sphereValue(mesh.primvars[size_t(slot)], hit.triangle);
  return Corners(mesh, hit.triangle).interpolate(mesh.primvars[size_t(slot)], hit.b1, hit.b2);
}

// The edges are e1 = dp/ds s1 + dp/dt t1 and e2 = dp/ds s2 + dp/dt t2. In double, because products of a
// micropolygon's texture coordinates cancel.
bool TraceScene::tangents(const Hit& hit, const SurfacePoint& point, int32_t slot, Vec3f& dpds, Vec3f& dpdt) const {
  if (slot < 0 || slot >= kInstanceSlots) return false;
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  if (isSpheres(mesh)) return false;
  const std::vector<Vec2f>& values = mesh.texcoords[size_t(slot)];
  const Corners corners(mesh, hit.triangle);
  const Vec2f st0 = values[corners.i0], st1 = values[corners.i1], st2 = values[corners.i2];
  const double s1 = double(st1.x) - double(st0.x), t1 = double(st1.y) - double(st0.y);
  const double s2 = double(st2.x) - double(st0.x), t2 = double(st2.y) - double(st0.y);
  const double determinant = s1 * t2 - s2 * t1;
  const Vec3d e1 = toDouble(point.e1), e2 = toDouble(point.e2);
  const Vec3f s = toFloat((e1 * t2 - e2 * t1) / determinant), t = toFloat((e2 * s1 - e1 * s2) / determinant);
  if (determinant == 0 || !isFinite(s) || !isFinite(t) || s == Vec3f{} || t == Vec3f{}) return false;
  dpds = s, dpdt = t;
  return true;
}

uint32_t TraceScene::linkGroup(const Hit& hit) const {
  return resolveLinkGroup(impl_->instances[hit.instance], impl_->meshOf(hit));
}

uint32_t TraceScene::element(const Hit& hit) const {
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  return isSpheres(mesh) ? hit.triangle : mesh.primitive_face[mesh.triangle_primitive[hit.triangle]];
}

Vec3f TraceScene::objectPosition(const Hit& hit) const {
  const DicedMesh& mesh = *impl_->meshOf(hit).diced;
  if (isSpheres(mesh)) return SphereSpot(mesh, hit).position();
  const std::array<Vec3f, 3> p = Corners(mesh, hit.triangle).at(hit.time, mesh.positions, mesh.motion_positions);
  return p[0] + ((p[1] - p[0]) * hit.b1 + (p[2] - p[0]) * hit.b2);
}

uint32_t TraceScene::meshCount(uint32_t instance) const {
  return uint32_t(impl_->prototypes[impl_->instances[instance].prototype].meshes.size());
}

uint32_t TraceScene::triangleCount(uint32_t instance, uint32_t mesh) const {
  return uint32_t(impl_->meshOf({instance, mesh}).diced->triangleCount());
}

std::array<Vec3f, 3> TraceScene::triangle(uint32_t instance, uint32_t mesh, uint32_t triangle, float time) const {
  const TracedInstance& traced = impl_->instances[instance];
  const DicedMesh& diced = *impl_->meshOf({instance, mesh}).diced;
  std::array<Vec3f, 3> p = Corners(diced, triangle).at(time, diced.positions, diced.motion_positions);
  const Affine3f to_world = traced.moves() ? worldAt(traced, time) : traced.still.to_world;
  for (Vec3f& corner : p) corner = to_world.point(corner);
  return p;
}

}  // namespace encore
