#include "core/trace/shadow_hits.h"

#include <tuple>

#include "core/trace/sphere.h"

namespace encore {

namespace {

// Barycentric coordinates as small as this may come from Embree's tolerance at edges, which is 2^-23.
constexpr float kEdgeTolerance = 0x1p-18f;
// Around a vertex several edges round at once.
constexpr float kVertexTolerance = 0x1p-14f;

bool comesBefore(const Hit& a, const Hit& b) {
  return std::tie(a.t, a.instance, a.mesh, a.triangle) < std::tie(b.t, b.instance, b.mesh, b.triangle);
}

bool sameTriangle(const Hit& a, const Hit& b) {
  return a.triangle == b.triangle && a.mesh == b.mesh && a.instance == b.instance;
}

// Where the ray meets the plane of a triangle: the same whatever the ray shares its packet with, unlike Embree's.
struct PlaneCrossing {
  double t;
  bool back;  // leaves through the outside

  PlaneCrossing(const TracedInstance& instance, const DicedMesh& mesh, uint32_t triangle, const Ray& ray) {
    const std::array<Vec3f, 3> p = Corners(mesh, triangle).at(ray.time, mesh.positions, mesh.motion_positions);
    const Affine3f f = instance.moves() ? worldAt(instance, ray.time) : instance.still.to_world;
    const Affine3d m{toDouble(f.ex), toDouble(f.ey), toDouble(f.ez), toDouble(f.origin)};
    const Vec3d p0 = toDouble(p[0]), e1 = m.vector(toDouble(p[1]) - p0), e2 = m.vector(toDouble(p[2]) - p0);
    const Vec3d n = cross(e1, e2);
    const double slope = dot(n, toDouble(ray.direction));
    t = dot(m.point(p0) - toDouble(ray.origin), n) / slope;
    back = slope > 0;
  }
};

// The corners of a hit's triangle and its weights of them.
struct Weights {
  std::array<Vec3f, 3> corner;
  std::array<float, 3> weight;

  Weights(const DicedMesh& mesh, const Hit& hit) : weight{1 - hit.b1 - hit.b2, hit.b1, hit.b2} {
    corner = Corners(mesh, hit.triangle).at(0, mesh.positions, {});
  }
};

bool onBoundary(const Hit& hit) { return std::min({hit.b1, hit.b2, 1 - hit.b1 - hit.b2}) <= kVertexTolerance; }

// Both hits lie where their triangles, of one mesh, share an edge or a vertex, and face the ray alike.
bool sameCrossing(const TracedInstance& instance, const DicedMesh& mesh, const Hit& a, const Hit& b, const Ray& ray) {
  if (a.instance != b.instance || a.mesh != b.mesh || !onBoundary(a) || !onBoundary(b)) return false;
  const Weights wa(mesh, a), wb(mesh, b);
  uint32_t shared = 0;
  float rest_a = 1, rest_b = 1;  // weights of what is not shared
  for (size_t i = 0; i < 3; ++i)
    for (size_t k = 0; k < 3; ++k)
      if (wa.corner[i] == wb.corner[k]) ++shared, rest_a -= wa.weight[i], rest_b -= wb.weight[k];
  const float tolerance = shared == 2 ? kEdgeTolerance : kVertexTolerance;
  if (shared == 0 || shared > 2 || rest_a > tolerance || rest_b > tolerance) return false;
  return PlaneCrossing(instance, mesh, a.triangle, ray).back == PlaneCrossing(instance, mesh, b.triangle, ray).back;
}

// Keeps the nearest hits in order. What was dropped lies beyond the last one, and so does what must be dropped now.
// replaces: the hit stands for one that was recorded, and is nearer. dropped: t of the nearest one that was dropped.
void insert(ShadowHits& to, const Hit& hit, bool replaces, float& dropped) {
  to.overflow |= to.count == kRecordedHits;
  if (to.overflow && !replaces && !comesBefore(hit, to.hits[to.count - 1])) {
    dropped = std::min(dropped, hit.t);
    return;
  }
  if (to.count == kRecordedHits) dropped = std::min(dropped, to.hits[kRecordedHits - 1].t);
  uint32_t at = to.count == kRecordedHits ? to.count - 1 : to.count++;
  for (; at > 0 && comesBefore(hit, to.hits[at - 1]); --at) to.hits[at] = to.hits[at - 1];
  to.hits[at] = hit;
}

void remove(ShadowHits& from, uint32_t at) {
  --from.count;
  std::copy(from.hits.begin() + at + 1, from.hits.begin() + from.count + 1, from.hits.begin() + at);
}

}  // namespace

bool ShadowRecorder::ends(uint32_t lane, const Hit& found) {
  const TracedInstance& instance = scene.instances[found.instance];
  const TracedMesh& mesh = scene.meshOf(found);
  if (groups && groups[lane]) {
    const std::vector<uint8_t>& casts = *groups[lane];
    const uint32_t group = resolveLinkGroup(instance, mesh);
    if (group < casts.size() && casts[group] == 0) return false;
  }
  const auto material = size_t(materialOfTriangle(instance, mesh, found.triangle));
  if (material >= scene.passes.size() || scene.passes[material] == 0) return true;

  const Ray& ray = rays[lane];
  if (isSpheres(*mesh.diced)) {
    recordSphere(lane, found, instance, *mesh.diced);
    return false;
  }
  Hit hit = found;
  const double t = PlaneCrossing(instance, *mesh.diced, hit.triangle, ray).t;
  if (float(t) <= ray.tnear) return false;                     // behind the start after all
  if (std::isfinite(t)) hit.t = std::min(float(t), ray.tfar);  // else Embree's, of a triangle without area
  const auto sameAs = [&](const Hit& other) { return sameCrossing(instance, *mesh.diced, other, hit, ray); };
  if (before) {
    const auto hits = std::span(before[lane].hits).first(before[lane].count);
    if (!comesBefore(hits.back(), hit) || std::any_of(hits.begin(), hits.end(), sameAs)) return false;
  }
  ShadowHits& result = results[lane];
  bool replaces = false;
  for (uint32_t i = 0; i < result.count; ++i) {
    if (sameTriangle(result.hits[i], hit)) return false;  // Embree may show a triangle twice
    if (!sameAs(result.hits[i])) continue;
    if (comesBefore(result.hits[i], hit)) return false;
    remove(result, i--);
    replaces = true;
  }
  insert(result, hit, replaces, dropped[lane]);
  return false;
}

// Both crossings at once: which one Embree shows first, and whether it shows the other, does not matter then.
void ShadowRecorder::recordSphere(uint32_t lane, const Hit& found, const TracedInstance& instance,
                                  const DicedMesh& mesh) {
  const Ray& ray = rays[lane];
  const SphereCrossings crossings(instance, mesh, found.triangle, ray);
  for (uint32_t k = 0; k < crossings.count; ++k) {
    Hit hit = found;
    hit.t = float(crossings.t[k]), hit.b1 = crossings.coordinates[k].x, hit.b2 = crossings.coordinates[k].y;
    if (!(hit.t > ray.tnear && hit.t <= ray.tfar)) continue;
    const auto isHit = [&](const Hit& other) {
      return sameTriangle(other, hit) && other.t == hit.t && other.b1 == hit.b1 && other.b2 == hit.b2;
    };
    if (before) {
      const auto hits = std::span(before[lane].hits).first(before[lane].count);
      if (comesBefore(hit, hits.back()) || std::any_of(hits.begin(), hits.end(), isHit)) continue;
    }
    ShadowHits& result = results[lane];
    const auto known = std::span(result.hits).first(result.count);
    if (std::none_of(known.begin(), known.end(), isHit)) insert(result, hit, false, dropped[lane]);
  }
}

// Hits at one distance stay together where there is room for all of them.
void ShadowRecorder::finish(uint32_t lane, bool occluded) {
  ShadowHits& result = results[lane];
  result.occluded = occluded;
  if (occluded || !result.overflow || result.hits[0].t >= dropped[lane]) return;
  while (result.hits[result.count - 1].t >= dropped[lane]) --result.count;
}

void filterShadowHits(const RTCFilterFunctionNArguments* arguments) {
  const auto* context = reinterpret_cast<const embree::Context*>(arguments->context);
  if (!context->recorder) return;
  ShadowRecorder& recorder = *static_cast<ShadowRecorder*>(context->recorder);
  const uint32_t n = arguments->N;
  for (uint32_t i = 0; i < n; ++i) {
    if (arguments->valid[i] == 0) continue;
    const uint32_t lane = RTCRayN_id(arguments->ray, n, i);
    RTCHitN* h = arguments->hit;
    const embree::Barycentric b(RTCHitN_u(h, n, i), RTCHitN_v(h, n, i));
    const Hit hit{RTCHitN_instID(h, n, i, 0),         RTCHitN_geomID(h, n, i), RTCHitN_primID(h, n, i), b.b1, b.b2,
                  RTCRayN_tfar(arguments->ray, n, i), recorder.rays[lane].time};
    if (!recorder.ends(lane, hit)) arguments->valid[i] = 0;
  }
}

// Where one of the instances shows a material that lets light pass, or one of the lights does not look.
std::vector<std::vector<uint8_t>> TraceScene::Impl::meshesThatMayPass() const {
  const auto passing = [&](int32_t material) {
    return size_t(material) < passes.size() && passes[size_t(material)] != 0;
  };
  const auto ignored = [&](uint32_t group) {
    return std::any_of(scene.lights.begin(), scene.lights.end(), [&](const Light& light) {
      return group < light.shadow_groups.size() && light.shadow_groups[group] == 0;
    });
  };
  const auto anyMaterial = [&](const Mesh& mesh) {
    return passing(mesh.material) || std::any_of(mesh.face_materials.begin(), mesh.face_materials.end(),
                                                 [&](int32_t m) { return m >= 0 && passing(m); });
  };
  std::vector<std::vector<uint8_t>> may_pass(scene.prototypes.size());
  for (size_t i = 0; i < scene.prototypes.size(); ++i) may_pass[i].resize(scene.prototypes[i].meshes.size());
  for (const TracedInstance& instance : instances) {
    const std::vector<uint32_t>& meshes = scene.prototypes[instance.prototype].meshes;
    for (size_t slot = 0; slot < meshes.size(); ++slot) {
      const Mesh& mesh = scene.meshes[meshes[slot]];
      const uint32_t group = instance.link_group >= 0 ? uint32_t(instance.link_group) : mesh.link_group;
      const bool may = instance.material >= 0 ? passing(instance.material) : anyMaterial(mesh);
      if (may || ignored(group)) may_pass[instance.prototype][slot] = 1;
    }
  }
  return may_pass;
}

}  // namespace encore
