// The lean side of surface(): what the direct layer needs of first hits, sixteen at a time.
#include "core/trace/packets.h"

#include <time.h>

#include <bit>

#include "core/trace/clones.h"
#include "core/trace/sphere.h"
#include "core/trace/trace_impl.h"

namespace encore {

namespace {

// What all hits on one triangle of one instance share, at one time if it moves, in world space.
struct TriangleRecord {
  uint32_t instance = kNoInstance, mesh = 0, triangle = 0;
  uint32_t primitive_front = 0;  // SurfaceKey::primitive_side of the outside
  int32_t material = 0;
  bool degenerate = false;  // ng depends on the ray, or on the hit
  bool sphere = false;      // nothing below holds for all hits
  bool smooth = false;
  bool moves = false;
  float time = 0;
  Vec2f uv, duv1, duv2, scale;
  Vec3f ng;
  Vec3f n, dn1, dn2;  // not of unit length; only where smooth
  bool has_gradients = false;
  ParameterGradients gradients;  // filled when first asked for

  bool holds(const Hit& hit) const {
    return triangle == hit.triangle && mesh == hit.mesh && instance == hit.instance && (!moves || time == hit.time);
  }
};

// Fills the lanes of `points` whose hits lie on the record's triangle, if it moves at its time. Returns them as bits.
template <bool kMoves>
[[gnu::always_inline]] inline uint32_t resolve(const TriangleRecord& __restrict r, const RayPacket& __restrict rays,
                                               const HitPacket& __restrict hits, SurfacePacket& __restrict points) {
  // Read before the loop, so that it has no conditional loads.
  const Vec3f ng = r.ng;
  const uint32_t smooth = r.smooth ? 1 : 0, primitive_front = r.primitive_front;
  const int32_t material = r.material;
  uint32_t lanes = 0;
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    bool match = (hits.triangle[i] == r.triangle) & (hits.mesh[i] == r.mesh) & (hits.instance[i] == r.instance);
    if constexpr (kMoves) match &= hits.time[i] == r.time;
    lanes |= match ? 1u << i : 0u;
    const float b1 = hits.b1[i], b2 = hits.b2[i];
    const float dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    const bool back = ng.x * dx + ng.y * dy + ng.z * dz > 0;

    const float raw_u = r.uv.x + (r.duv1.x * b1 + r.duv2.x * b2), raw_v = r.uv.y + (r.duv1.y * b1 + r.duv2.y * b2);
    const float u = (raw_u < 0 ? 0 : raw_u > 1 ? 1 : raw_u) * r.scale.x;
    const float v = (raw_v < 0 ? 0 : raw_v > 1 ? 1 : raw_v) * r.scale.y;

    const float nx = r.n.x + (r.dn1.x * b1 + r.dn2.x * b2), ny = r.n.y + (r.dn1.y * b1 + r.dn2.y * b2),
                nz = r.n.z + (r.dn1.z * b1 + r.dn2.z * b2);
    const float size = std::sqrt(nx * nx + ny * ny + nz * nz), factor = 1 / size;
    const bool useful =
        (smooth != 0) & (nx * ng.x + ny * ng.y + nz * ng.z > 0) & (size <= std::numeric_limits<float>::max());
    const float sx = useful ? nx * factor : ng.x, sy = useful ? ny * factor : ng.y, sz = useful ? nz * factor : ng.z;
    const float ox = back ? -sx : sx, oy = back ? -sy : sy, oz = back ? -sz : sz;

    points.primitive_side[i] = match ? primitive_front | uint32_t(back) : points.primitive_side[i];
    points.material[i] = match ? material : points.material[i];
    points.u[i] = match ? u : points.u[i], points.v[i] = match ? v : points.v[i];
    points.nx[i] = match ? ox : points.nx[i], points.ny[i] = match ? oy : points.ny[i];
    points.nz[i] = match ? oz : points.nz[i];
  }
  return lanes;
}

ENCORE_AVX2_CLONES
uint32_t resolveLanes(const TriangleRecord& record, const RayPacket& rays, const HitPacket& hits,
                      SurfacePacket& points) {
  return resolve<false>(record, rays, hits, points);
}
ENCORE_AVX2_CLONES
uint32_t resolveMovingLanes(const TriangleRecord& record, const RayPacket& rays, const HitPacket& hits,
                            SurfacePacket& points) {
  return resolve<true>(record, rays, hits, points);
}

// Hits on triangles without a normal: the slow way.
void resolveLane(const TraceScene& trace, const RayPacket& rays, const HitPacket& hits, uint32_t lane,
                 SurfacePacket& points) {
  const Vec3f direction{rays.dx[lane], rays.dy[lane], rays.dz[lane]};
  const SurfacePoint point = trace.surface(hits.hit(lane), direction, false);
  const Vec3f n = point.side ? -point.ns : point.ns;
  points.primitive_side[lane] = point.key(0).primitive_side;
  points.material[lane] = point.material;
  points.u[lane] = point.uv.x, points.v[lane] = point.uv.y;
  points.nx[lane] = n.x, points.ny[lane] = n.y, points.nz[lane] = n.z;
}

ENCORE_AVX2_CLONES
uint32_t hitLanes(const HitPacket& hits) {
  uint32_t lanes = 0;
  for (uint32_t i = 0; i < kPacketWidth; ++i) lanes |= hits.instance[i] != kNoInstance ? 1u << i : 0u;
  return lanes;
}

constexpr uint32_t kAllLanes = (1u << kPacketWidth) - 1;

// Records of the triangles met lately: samples of neighbouring pixels share most of them.
constexpr uint32_t kRecords = 256;

uint32_t slotOf(const Hit& hit) {
  return ((hit.triangle * 0x9e3779b1u) ^ (hit.mesh * 0x85ebca77u) ^ (hit.instance * 0xc2b2ae3du)) >> 24;
}
static_assert(kRecords == 1u << 8);

// Processor time of this thread: what others do on the machine does not count.
double threadSeconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + double(now.tv_nsec) * 1e-9;
}

}  // namespace

struct PacketTracer::Impl {
  Impl(const TraceScene& trace_, Vec3f origin_, bool own_origins_)
      : trace(trace_),
        query(trace_.impl_->query(Coherence::Coherent)),
        own_origins(own_origins_),
        own_times(trace_.impl_->moves),
        records(kRecords) {
    query.setOrigin(own_origins ? Vec3f{} : origin_);
  }

  // Inline, so that it is compiled for the processor of its caller.
  [[gnu::always_inline]] void load(embree::Query& to, const RayPacket& rays, uint32_t count) const {
    if (own_origins || own_times)
      to.setOwnRays(rays, count, own_origins, own_times);
    else
      to.setRays(rays, count);
  }

  TriangleRecord& record(const Hit& hit) {
    TriangleRecord& r = records[slotOf(hit)];
    if (!r.holds(hit)) fill(r, hit);
    return r;
  }
  void fill(TriangleRecord& r, const Hit& hit) const;

  const TraceScene& trace;
  embree::Query query;
  bool own_origins, own_times;
  std::vector<TriangleRecord> records;
};

// The expressions are surface()'s, so that the results are.
void PacketTracer::Impl::fill(TriangleRecord& r, const Hit& hit) const {
  const TraceScene::Impl& scene = *trace.impl_;
  const TracedInstance& instance = scene.instances[hit.instance];
  const TracedMesh& mesh = scene.meshOf(hit);
  const DicedMesh& diced = *mesh.diced;
  r = {};
  r.instance = hit.instance, r.mesh = hit.mesh, r.triangle = hit.triangle;
  if (isSpheres(diced)) {
    r.sphere = r.degenerate = true;
    return;
  }
  const Corners corners(diced, hit.triangle);
  const uint32_t primitive = diced.triangle_primitive[hit.triangle];
  r.primitive_front = (mesh.first_primitive + primitive) << 1;
  r.material = resolveMaterial(instance, mesh, primitive);
  r.scale = scene.parameterScale(hit.instance, mesh.first_primitive + primitive);
  r.uv = diced.uv[corners.i0];
  r.duv1 = diced.uv[corners.i1] - r.uv, r.duv2 = diced.uv[corners.i2] - r.uv;

  r.moves = instance.moves() || !diced.motion_positions.empty();
  r.time = hit.time;
  const PlacedTriangle placed(instance, diced, corners, hit.time);
  const LocalTriangle triangle(placed.edge1, placed.edge2);
  const Affine3f& to_prototype = placed.place().to_prototype;
  const Vec3f covector = to_prototype.transposedVector(triangle.normal);
  const float covector_length = length(covector);
  r.degenerate = !(covector_length > 0);
  if (!r.degenerate) r.ng = covector * (1 / covector_length);
  r.smooth = !diced.normals.empty();
  if (!r.smooth) return;
  const std::array<Vec3f, 3> n = corners.at(hit.time, diced.normals, diced.motion_normals);
  r.n = to_prototype.transposedVector(n[0]);
  r.dn1 = to_prototype.transposedVector(n[1] - n[0]);
  r.dn2 = to_prototype.transposedVector(n[2] - n[0]);
}

PacketTracer::PacketTracer(const TraceScene& trace, Vec3f origin, bool own_origins)
    : impl_(std::make_unique<Impl>(trace, origin, own_origins)) {}
PacketTracer::~PacketTracer() = default;

ENCORE_AVX2_CLONES
void PacketTracer::intersect(const RayPacket& rays, uint32_t count, HitPacket& hits) {
  embree::Query& query = impl_->query;
  impl_->load(query, rays, count);
  query.intersect(impl_->trace.impl_->top.get());
  query.hits(hits);
}

void PacketTracer::surface(const RayPacket& rays, const HitPacket& hits, SurfacePacket& points) {
  uint32_t left = hitLanes(hits);
  if (left != kAllLanes) points = {};
  while (left != 0) {
    const uint32_t lane = uint32_t(std::countr_zero(left));
    const TriangleRecord& record = impl_->record(hits.hit(lane));
    if (record.degenerate) {
      resolveLane(impl_->trace, rays, hits, lane, points);
      left &= left - 1;
    } else {
      left &= ~(record.moves ? resolveMovingLanes : resolveLanes)(record, rays, hits, points);
    }
  }
}

Vec3f PacketTracer::geometricNormal(const RayPacket& rays, const HitPacket& hits, uint32_t lane) {
  const TriangleRecord& record = impl_->record(hits.hit(lane));
  if (record.sphere) return impl_->trace.surface(hits.hit(lane), {}, false).ng;
  return record.degenerate ? Vec3f{-rays.dx[lane], -rays.dy[lane], -rays.dz[lane]} : record.ng;
}

ParameterGradients PacketTracer::gradients(const HitPacket& hits, uint32_t lane) {
  const Hit hit = hits.hit(lane);
  TriangleRecord& record = impl_->record(hit);
  if (record.has_gradients) return record.gradients;
  const TraceScene::Impl& scene = *impl_->trace.impl_;
  if (record.sphere) {
    const SurfacePoint point = impl_->trace.surface(hit, {}, false);
    return parameterGradients(kSphereParameters[0], kSphereParameters[1], point.e1, point.e2,
                              scene.parameterScale(hit.instance, point.primitive));
  }
  const DicedMesh& mesh = *scene.meshOf(hit).diced;
  const Corners corners(mesh, hit.triangle);
  const PlacedTriangle placed(scene.instances[hit.instance], mesh, corners, hit.time);
  const Affine3f& m = placed.place().to_world;
  record.gradients = parameterGradients(mesh, corners, m.vector(placed.edge1), m.vector(placed.edge2), record.scale);
  record.has_gradients = true;
  return record.gradients;
}

double PacketTracer::rawSeconds(std::span<const RayPacket> packets) {
  std::vector<embree::Query> queries(packets.size(), impl_->query);
  for (size_t i = 0; i < packets.size(); ++i) impl_->load(queries[i], packets[i], kPacketWidth);
  const double start = threadSeconds();
  for (embree::Query& query : queries) query.intersect16(impl_->trace.impl_->top.get());
  return threadSeconds() - start;
}

}  // namespace encore
