#include "core/trace/trace_scene.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <set>
#include <utility>

#include "core/trace/shadow_hits.h"
#include "core/trace/sphere.h"
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

// Shares the mesh's spheres.
embree::Geometry makeSpheres(embree::Device& device, const DicedMesh& mesh, bool may_pass) {
  embree::Geometry geometry = device.newGeometry(RTC_GEOMETRY_TYPE_SPHERE_POINT);
  device.check("geometry");
  const auto set = [&](uint32_t step, const std::vector<Vec4f>& spheres) {
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, step, RTC_FORMAT_FLOAT4, spheres.data(), 0,
                               sizeof(Vec4f), spheres.size());
  };
  const size_t keys = mesh.motion_spheres.size();
  if (keys != 0) rtcSetGeometryTimeStepCount(geometry.get(), uint32_t(keys));
  for (uint32_t step = 0; step < keys; ++step) set(step, mesh.motion_spheres[step]);
  if (keys == 0) set(0, mesh.spheres);
  device.check("spheres");
  rtcSetGeometryUserData(geometry.get(), const_cast<DicedMesh*>(&mesh));  // the filter only reads it
  rtcSetGeometryIntersectFilterFunction(geometry.get(), filterSphereHits);
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
  const auto extendSpheres = [&](const std::vector<Vec4f>& spheres) {
    for (const Vec4f& s : spheres)
      if (s.w > 0) extend({{s.x - s.w, s.y - s.w, s.z - s.w}, {s.x + s.w, s.y + s.w, s.z + s.w}});
  };
  for (const TracedMesh& mesh : meshes) {
    extend(mesh.diced->positions);
    for (const std::vector<Vec3f>& key : mesh.diced->motion_positions) extend(key);
    extendSpheres(mesh.diced->spheres);
    for (const std::vector<Vec4f>& key : mesh.diced->motion_spheres) extendSpheres(key);
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

bool deforms(const DicedMesh& mesh) { return !mesh.motion_positions.empty() || !mesh.motion_spheres.empty(); }

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
  bytes += bytesOf(mesh.spheres);
  for (const auto& key : mesh.motion_spheres) bytes += bytesOf(key);
  return bytes;
}

}  // namespace

void TraceScene::Impl::addInstances() {
  prototypes.resize(scene.prototypes.size());
  instances.reserve(scene.instances.size());
  for (const Instance& instance : scene.instances) {
    instances.push_back(makeInstance(instance));
    if (instances.back().moves()) prototypes[instance.prototype].in_motion = moves = true;
  }
  moves |= !scene.camera.motion.empty() || std::any_of(diced.begin(), diced.end(), deforms);
}

PrototypeKey TraceScene::Impl::prototypeKey(uint32_t index, const std::vector<uint8_t>& may_pass) const {
  PrototypeKey key{{}, may_pass, false};
  for (const uint32_t mesh : scene.prototypes[index].meshes) {
    key.meshes.push_back(&diced[mesh]);
    key.in_motion |= prototypes[index].in_motion && deforms(diced[mesh]);
  }
  return key;
}

void TraceScene::Impl::addMeshes(uint32_t index) {
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
}

void TraceScene::Impl::buildPrototype(uint32_t index, const std::vector<uint8_t>& may_pass) {
  const Prototype& source = scene.prototypes[index];
  TracedPrototype& prototype = prototypes[index];
  const auto built = std::make_shared<BuiltPrototype>(BuiltPrototype{device, {}, device->newScene()});
  RTCScene scene_handle = built->scene.get();
  device->check(source.path);
  for (const uint32_t mesh : source.meshes) built->meshes.push_back(diced.shared(mesh));
  for (uint32_t slot = 0; slot < prototype.meshes.size(); ++slot) {
    const DicedMesh& mesh = *prototype.meshes[slot].diced;
    if (mesh.triangleCount() == 0 && !isSpheres(mesh)) continue;
    const embree::Geometry geometry =
        (isSpheres(mesh) ? makeSpheres : makeTriangles)(*device, mesh, may_pass[slot] != 0);
    rtcAttachGeometryByID(scene_handle, geometry.get(), slot);
  }
  if (prototypeKey(index, may_pass).in_motion) {
    const embree::Geometry geometry = makeBounds(*device, prototype.meshes);
    rtcAttachGeometryByID(scene_handle, geometry.get(), uint32_t(prototype.meshes.size()));
  }
  rtcCommitScene(scene_handle);
  device->check(source.path);
  prototype.built = built;
}

void TraceScene::Impl::build(const std::vector<std::vector<uint8_t>>& may_pass, TraceCache* cache) {
  std::vector<uint8_t> placed(scene.prototypes.size(), 0);
  for (const Instance& instance : scene.instances) placed[instance.prototype] = 1;
  // What the cache holds of other scenes goes before anything new comes.
  std::vector<PrototypeKey> missing(cache ? scene.prototypes.size() : 0);
  if (cache) {
    std::map<PrototypeKey, std::shared_ptr<const BuiltPrototype>> kept, &known = cache->impl().prototypes;
    for (uint32_t i = 0; i < placed.size(); ++i) {
      if (!placed[i]) continue;
      PrototypeKey key = prototypeKey(i, may_pass[i]);
      if (const auto again = kept.find(key); again != kept.end()) {
        prototypes[i].built = again->second;
      } else if (const auto found = known.find(key); found != known.end()) {
        prototypes[i].built = found->second;
        kept.insert(known.extract(found));
      } else {
        missing[i] = std::move(key);
      }
    }
    known = std::move(kept);
    cache->impl().built = 0;
  }
  tbb::parallel_for(size_t{0}, scene.prototypes.size(), [&](size_t i) {
    const FlushDenormals flush_worker;
    if (!placed[i]) return;
    addMeshes(uint32_t(i));
    // Isolated: a thread that waits for its build must not start another one on top of it.
    if (!prototypes[i].built) tbb::this_task_arena::isolate([&] { buildPrototype(uint32_t(i), may_pass[i]); });
  });
  for (uint32_t i = 0; i < missing.size(); ++i) {
    if (missing[i].meshes.empty()) continue;
    ++cache->impl().built;
    // Meshes without an identity are diced anew for every scene.
    const auto& meshes = scene.prototypes[i].meshes;
    if (std::all_of(meshes.begin(), meshes.end(), [&](uint32_t m) { return scene.meshes[m].identity != nullptr; }))
      cache->impl().prototypes.emplace(std::move(missing[i]), prototypes[i].built);
  }
}

void TraceScene::Impl::buildTop() {
  top = device->newScene();
  device->check("scene");
  for (uint32_t i = 0; i < instances.size(); ++i) {
    if (!instances[i].traceable) continue;
    largest_origin = std::min(largest_origin, instances[i].largest_origin);
    const embree::Geometry geometry =
        makeInstanceGeometry(*device, instances[i], prototypes[instances[i].prototype].built->scene.get());
    rtcAttachGeometryByID(top.get(), geometry.get(), i);
  }
  rtcCommitScene(top.get());
  device->check("scene");
  RTCBounds b;
  rtcGetSceneBounds(top.get(), &b);
  const Vec3f size{b.upper_x - b.lower_x, b.upper_y - b.lower_y, b.upper_z - b.lower_z};
  diagonal = size.x >= 0 && isFinite(size) ? length(size) : 0;  // an empty scene has inverted bounds
}

TraceScene::TraceScene(const Scene& scene, DicedMeshes diced, bool world_space_parameters,
                       std::span<const uint8_t> passes, TraceCache* cache)
    : impl_(std::make_unique<Impl>(scene, std::move(diced), cache)) {
  const FlushDenormals flush;
  impl_->passes.assign(passes.begin(), passes.end());
  impl_->addInstances();
  const std::vector<std::vector<uint8_t>> may_pass = impl_->meshesThatMayPass();
  for (const std::vector<uint8_t>& meshes : may_pass)
    impl_->filtered |= std::any_of(meshes.begin(), meshes.end(), [](uint8_t may) { return may != 0; });
  const bool has_spheres = std::any_of(impl_->diced.begin(), impl_->diced.end(), isSpheres);
  if (impl_->filtered || has_spheres) impl_->device->requireFilters();
  impl_->build(may_pass, cache);
  impl_->buildTop();
  if (world_space_parameters) impl_->scales = std::make_unique<ParameterScales>(scene, impl_->diced);
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
  uint64_t bytes = impl_->device->bytes() + bytesOf(impl_->instances);
  for (const TracedInstance& instance : impl_->instances) bytes += bytesOf(instance.keys);
  std::set<const DicedMesh*> counted;
  for (const DicedMesh& mesh : impl_->diced)
    if (counted.insert(&mesh).second) bytes += bytesOf(mesh);
  if (impl_->scales) bytes += impl_->scales->bytes();
  return bytes;
}

}  // namespace encore
