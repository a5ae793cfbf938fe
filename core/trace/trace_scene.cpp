#include "core/trace/trace_scene.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cstring>

#include "core/trace/shadow_hits.h"
#include "core/trace/trace_impl.h"

namespace encore {

namespace {

// A key keeps the side of a primitive in its lowest bit.
constexpr uint64_t kMaxPrimitives = uint64_t{1} << 31;

void setVertices(embree::Device& device, RTCGeometry geometry, uint32_t step, const std::vector<Vec3f>& positions) {
  void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, step, RTC_FORMAT_FLOAT3, sizeof(Vec3f),
                                           positions.size());
  device.check("vertex buffer");
  std::memcpy(vertices, positions.data(), positions.size() * sizeof(Vec3f));
}

// A triangle geometry that shares the mesh's indices. Vertices are copied into a buffer of Embree's own,
// because Embree reads 16 bytes at each and DicedMesh has no padding after its last 12.
embree::Geometry makeTriangles(embree::Device& device, const DicedMesh& mesh, bool may_pass) {
  embree::Geometry geometry = device.newGeometry(RTC_GEOMETRY_TYPE_TRIANGLE);
  device.check("geometry");
  if (mesh.motion_positions.empty()) {
    setVertices(device, geometry.get(), 0, mesh.positions);
  } else {
    rtcSetGeometryTimeStepCount(geometry.get(), uint32_t(mesh.motion_positions.size()));
    device.check("times of a mesh");
    for (uint32_t step = 0; step < mesh.motion_positions.size(); ++step)
      setVertices(device, geometry.get(), step, mesh.motion_positions[step]);
  }
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                             3 * sizeof(uint32_t), mesh.triangleCount());
  if (may_pass) rtcSetGeometryOccludedFilterFunction(geometry.get(), filterShadowHits);
  rtcCommitGeometry(geometry.get());
  return geometry;
}

// Embree takes the bounds of a moving instance at its keys and goes straight between them, which is wrong for
// vertices that move as well: their paths in the world are curves. Two triangles without area, which nothing can
// hit, keep the prototype's bounds at all times where they are over the whole shutter; straight is then right.
embree::Geometry makeBounds(embree::Device& device, const std::vector<TracedMesh>& meshes) {
  Vec3f low, high;
  bool any = false;
  const auto extend = [&](const std::vector<Vec3f>& positions) {
    for (const Vec3f& p : positions) {
      low = any ? -componentMax(-low, -p) : p, high = any ? componentMax(high, p) : p;
      any = true;
    }
  };
  for (const TracedMesh& mesh : meshes) {
    extend(mesh.diced->positions);
    for (const std::vector<Vec3f>& key : mesh.diced->motion_positions) extend(key);
  }
  const Vec3f rounding = componentMax(absolute(low), absolute(high)) * 0x1p-20f;  // of vertices between keys
  embree::Geometry geometry = device.newGeometry(RTC_GEOMETRY_TYPE_TRIANGLE);
  device.check("geometry");
  setVertices(device, geometry.get(), 0, {low - rounding, high + rounding, {}});  // the last one is padding
  void* indices =
      rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), 2);
  device.check("index buffer");
  constexpr uint32_t kCorners[6] = {0, 0, 0, 1, 1, 1};
  std::memcpy(indices, kCorners, sizeof(kCorners));
  rtcCommitGeometry(geometry.get());
  return geometry;
}

embree::Geometry makeInstanceGeometry(embree::Device& device, const TracedInstance& instance, RTCScene prototype) {
  embree::Geometry geometry = device.newGeometry(RTC_GEOMETRY_TYPE_INSTANCE);
  device.check("instance");
  rtcSetGeometryInstancedScene(geometry.get(), prototype);
  const auto set = [&](uint32_t step, const Affine3f& m) {
    const float columns[12] = {m.ex.x, m.ex.y, m.ex.z, m.ey.x,     m.ey.y,     m.ey.z,
                               m.ez.x, m.ez.y, m.ez.z, m.origin.x, m.origin.y, m.origin.z};
    rtcSetGeometryTransform(geometry.get(), step, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns);
  };
  if (instance.moves()) {
    rtcSetGeometryTimeStepCount(geometry.get(), uint32_t(instance.keys.size()));
    device.check("times of an instance");
    for (uint32_t step = 0; step < instance.keys.size(); ++step) set(step, instance.keys[step]);
  } else {
    set(0, instance.still.to_world);
  }
  rtcCommitGeometry(geometry.get());
  return geometry;
}

bool deforms(const TracedMesh& mesh) { return !mesh.diced->motion_positions.empty(); }

template <class T>
uint64_t bytesOf(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

uint64_t bytesOf(const DicedMesh& mesh) {
  uint64_t bytes = bytesOf(mesh.positions) + bytesOf(mesh.normals) + bytesOf(mesh.uv) + bytesOf(mesh.display_color) +
                   bytesOf(mesh.triangles) + bytesOf(mesh.triangle_primitive) + bytesOf(mesh.primitive_face);
  for (const auto& st : mesh.texcoords) bytes += bytesOf(st);
  for (const auto& values : mesh.primvars) bytes += bytesOf(values);
  for (const auto& key : mesh.motion_positions) bytes += bytesOf(key);
  for (const auto& key : mesh.motion_normals) bytes += bytesOf(key);
  return bytes;
}

}  // namespace

void TraceScene::Impl::addInstances() {
  prototypes.resize(scene.prototypes.size());
  for (const Instance& instance : scene.instances) {
    instances.push_back(makeInstance(instance));
    if (instances.back().moves()) prototypes[instance.prototype].in_motion = moves = true;
  }
  const auto keyed = [](const DicedMesh& mesh) { return !mesh.motion_positions.empty(); };
  moves |= !scene.camera.motion.empty() || std::any_of(diced.begin(), diced.end(), keyed);
}

void TraceScene::Impl::buildPrototype(uint32_t index, const std::vector<uint8_t>& may_pass) {
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
    const embree::Geometry geometry = makeTriangles(device, mesh, may_pass[slot] != 0);
    rtcAttachGeometryByID(prototype.scene.get(), geometry.get(), slot);
  }
  if (prototype.in_motion && std::any_of(prototype.meshes.begin(), prototype.meshes.end(), deforms)) {
    const embree::Geometry geometry = makeBounds(device, prototype.meshes);
    rtcAttachGeometryByID(prototype.scene.get(), geometry.get(), uint32_t(prototype.meshes.size()));
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

TraceScene::TraceScene(const Scene& scene, const std::vector<DicedMesh>& diced, bool world_space_parameters,
                       std::span<const uint8_t> passes)
    : impl_(std::make_unique<Impl>(scene, diced)) {
  const FlushDenormals flush;
  impl_->passes.assign(passes.begin(), passes.end());
  impl_->addInstances();
  const std::vector<std::vector<uint8_t>> may_pass = impl_->meshesThatMayPass();
  for (const std::vector<uint8_t>& meshes : may_pass)
    impl_->filtered |= std::any_of(meshes.begin(), meshes.end(), [](uint8_t may) { return may != 0; });
  if (impl_->filtered) impl_->device.requireFilters();
  std::vector<uint8_t> placed(scene.prototypes.size(), 0);
  for (const Instance& instance : scene.instances) placed[instance.prototype] = 1;
  tbb::parallel_for(size_t{0}, scene.prototypes.size(), [&](size_t i) {
    const FlushDenormals flush_worker;
    // Isolated: a thread that waits for its build must not start another one on top of it.
    if (placed[i]) tbb::this_task_arena::isolate([&] { impl_->buildPrototype(uint32_t(i), may_pass[i]); });
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

Vec3f TraceScene::worldPosition(Vec3f position) const { return toFloat(toDouble(position) + impl_->scene.origin); }

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
  for (const TracedInstance& instance : impl_->instances) bytes += bytesOf(instance.keys);
  for (const DicedMesh& mesh : impl_->diced) bytes += bytesOf(mesh);
  if (impl_->scales) bytes += impl_->scales->bytes();
  return bytes;
}

}  // namespace encore
