#include "core/trace/trace_scene.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cstring>

#include "core/trace/trace_impl.h"

namespace encore {

namespace {

// A key keeps the side of a primitive in its lowest bit.
constexpr uint64_t kMaxPrimitives = uint64_t{1} << 31;

// Embree inverts transforms in float: determinants within float's range, and no inverse that would send
// ordinary coordinates beyond what Embree takes. What is scaled by 1e-9 cannot be seen anyway.
constexpr double kSmallestDeterminant = 1e-36, kLargestStretch = 1e9;

// A triangle geometry that shares the mesh's indices. Vertices are copied into a buffer of Embree's own,
// because Embree reads 16 bytes at each and DicedMesh has no padding after its last 12.
embree::Geometry makeTriangles(embree::Device& device, const DicedMesh& mesh) {
  embree::Geometry geometry = device.newGeometry(RTC_GEOMETRY_TYPE_TRIANGLE);
  device.check("geometry");
  void* vertices = rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3f),
                                           mesh.positions.size());
  device.check("vertex buffer");
  std::memcpy(vertices, mesh.positions.data(), mesh.positions.size() * sizeof(Vec3f));
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                             3 * sizeof(uint32_t), mesh.triangleCount());
  rtcCommitGeometry(geometry.get());
  return geometry;
}

embree::Geometry makeInstanceGeometry(embree::Device& device, const TracedInstance& instance, RTCScene prototype) {
  embree::Geometry geometry = device.newGeometry(RTC_GEOMETRY_TYPE_INSTANCE);
  device.check("instance");
  const Affine3f& m = instance.to_world;
  const float columns[12] = {m.ex.x, m.ex.y, m.ex.z, m.ey.x,     m.ey.y,     m.ey.z,
                             m.ez.x, m.ez.y, m.ez.z, m.origin.x, m.origin.y, m.origin.z};
  rtcSetGeometryInstancedScene(geometry.get(), prototype);
  rtcSetGeometryTransform(geometry.get(), 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns);
  rtcCommitGeometry(geometry.get());
  return geometry;
}

// |a| × |b| without cancellation: what rounding errors of a cross product are relative to.
Vec3d absoluteCross(Vec3d a, Vec3d b) {
  a = absolute(a), b = absolute(b);
  return {a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x};
}

template <class T>
uint64_t bytesOf(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

uint64_t bytesOf(const DicedMesh& mesh) {
  uint64_t bytes = bytesOf(mesh.positions) + bytesOf(mesh.normals) + bytesOf(mesh.uv) + bytesOf(mesh.display_color) +
                   bytesOf(mesh.triangles) + bytesOf(mesh.triangle_primitive) + bytesOf(mesh.primitive_face);
  for (const auto& st : mesh.texcoords) bytes += bytesOf(st);
  return bytes;
}

}  // namespace

// Embree computes the inverse as adjugate / determinant, and transforms origins with it, all in float.
// To first order a point p comes out wrong by at most A (|p| + |translation|) in prototype space, where
//   A = |inverse| (γ(6) + γ(8) det⁺/|det|) + γ(4) adj⁺/|det|   (⁺: sums of absolute products),
// hence by |to_world| A (...) in world space.
TracedInstance makeInstance(const Instance& instance) {
  TracedInstance traced;
  traced.prototype = instance.prototype;
  traced.material = instance.material;
  traced.to_world = toFloat(instance.to_world);
  const Affine3f& f = traced.to_world;
  const Affine3d m{toDouble(f.ex), toDouble(f.ey), toDouble(f.ez), toDouble(f.origin)};  // what Embree is given
  const double det = std::abs(m.determinant());
  const Affine3d w = inverse(m);
  const double stretch =
      std::max({maxComponent(absolute(w.ex)), maxComponent(absolute(w.ey)), maxComponent(absolute(w.ez))});
  traced.traceable = det > kSmallestDeterminant && det < 1 / kSmallestDeterminant && stretch < kLargestStretch;
  if (!traced.traceable) return traced;
  traced.to_prototype = toFloat(w);
  traced.largest_origin = embree::kLargestCoordinate / float(3 * std::max(1.0, stretch));

  // Row i of the inverse is a cross product of two columns, over the determinant.
  const Vec3d adjugate[3] = {absoluteCross(m.ey, m.ez), absoluteCross(m.ez, m.ex), absoluteCross(m.ex, m.ey)};
  const Vec3d rows[3] = {{w.ex.x, w.ey.x, w.ez.x}, {w.ex.y, w.ey.y, w.ez.y}, {w.ex.z, w.ey.z, w.ez.z}};
  const double det_ratio = dot(absolute(m.ex), adjugate[0]) / det;
  Vec3d a[3];
  for (int i = 0; i < 3; ++i)
    a[i] =
        absolute(rows[i]) * (roundingGamma(6) + roundingGamma(8) * det_ratio) + adjugate[i] * (roundingGamma(4) / det);
  Vec3f* const out[3] = {&traced.ray_error_x, &traced.ray_error_y, &traced.ray_error_z};
  for (int i = 0; i < 3; ++i)
    *out[i] = toFloat(a[0] * std::abs(m.ex[i]) + a[1] * std::abs(m.ey[i]) + a[2] * std::abs(m.ez[i]));
  return traced;
}

void TraceScene::Impl::buildPrototype(uint32_t index) {
  const Prototype& source = scene.prototypes[index];
  TracedPrototype& prototype = prototypes[index];
  uint64_t primitives = 0;
  for (const uint32_t mesh : source.meshes) {
    prototype.meshes.push_back({&scene.meshes[mesh], &diced[mesh], uint32_t(primitives)});
    primitives += diced[mesh].primitiveCount();
    if (primitives >= kMaxPrimitives)
      throw Error(ErrorKind::Memory, std::to_string(primitives) + " primitives in one prototype are too many",
                  source.path, "Split it into several prototypes");
  }
  prototype.primitives = uint32_t(primitives);
  prototype.scene = device.newScene();
  device.check(source.path);
  for (uint32_t slot = 0; slot < prototype.meshes.size(); ++slot) {
    const DicedMesh& mesh = *prototype.meshes[slot].diced;
    if (mesh.triangleCount() == 0) continue;
    const embree::Geometry geometry = makeTriangles(device, mesh);
    rtcAttachGeometryByID(prototype.scene.get(), geometry.get(), slot);
  }
  rtcCommitScene(prototype.scene.get());
  device.check(source.path);
}

void TraceScene::Impl::buildTop() {
  top = device.newScene();
  device.check("scene");
  for (uint32_t i = 0; i < instances.size(); ++i) {
    if (!instances[i].traceable) continue;
    largest_origin = std::min(largest_origin, instances[i].largest_origin);
    const embree::Geometry geometry =
        makeInstanceGeometry(device, instances[i], prototypes[instances[i].prototype].scene.get());
    rtcAttachGeometryByID(top.get(), geometry.get(), i);
  }
  rtcCommitScene(top.get());
  device.check("scene");
  RTCBounds b;
  rtcGetSceneBounds(top.get(), &b);
  const Vec3f size{b.upper_x - b.lower_x, b.upper_y - b.lower_y, b.upper_z - b.lower_z};
  diagonal = size.x >= 0 && isFinite(size) ? length(size) : 0;  // an empty scene has inverted bounds
}

TraceScene::TraceScene(const Scene& scene, const std::vector<DicedMesh>& diced, bool world_space_parameters)
    : impl_(std::make_unique<Impl>(scene, diced)) {
  const FlushDenormals flush;
  std::vector<uint8_t> placed(scene.prototypes.size(), 0);
  for (const Instance& instance : scene.instances) {
    impl_->instances.push_back(makeInstance(instance));
    placed[instance.prototype] = 1;
  }
  impl_->prototypes.resize(scene.prototypes.size());
  tbb::parallel_for(size_t{0}, scene.prototypes.size(), [&](size_t i) {
    const FlushDenormals flush_worker;
    // Isolated: a thread that waits for its build must not start another one on top of it.
    if (placed[i]) tbb::this_task_arena::isolate([&] { impl_->buildPrototype(uint32_t(i)); });
  });
  impl_->buildTop();
  if (world_space_parameters) impl_->scales = std::make_unique<ParameterScales>(scene, diced);
}

TraceScene::~TraceScene() = default;

std::vector<uint32_t> TraceScene::untraceable() const {
  std::vector<uint32_t> indices;
  for (uint32_t i = 0; i < impl_->instances.size(); ++i)
    if (!impl_->instances[i].traceable) indices.push_back(i);
  return indices;
}

float TraceScene::diagonal() const { return impl_->diagonal; }

uint64_t TraceScene::primitiveCount() const {
  uint64_t count = 0;
  for (const TracedInstance& instance : impl_->instances) count += impl_->prototypes[instance.prototype].primitives;
  return count;
}

uint64_t TraceScene::micropolygonCount() const {
  uint64_t count = 0;
  for (const DicedMesh& mesh : impl_->diced) count += mesh.micropolygons;
  return count;
}

uint64_t TraceScene::memoryBytes() const {
  uint64_t bytes = impl_->device.bytes() + bytesOf(impl_->instances);
  for (const DicedMesh& mesh : impl_->diced) bytes += bytesOf(mesh);
  if (impl_->scales) bytes += impl_->scales->bytes();
  return bytes;
}

}  // namespace encore
