// Embree 3.13 behind owning handles: the only file that includes its headers. What Embree 4 does
// differently (query arguments instead of an intersect context) is confined to Query below.
#pragma once

#include <embree3/rtcore.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "core/scene/error.h"
#include "core/trace/packets.h"
#include "core/trace/ray.h"

namespace encore::embree {

struct Release {
  void operator()(RTCDevice handle) const { rtcReleaseDevice(handle); }
  void operator()(RTCScene handle) const { rtcReleaseScene(handle); }
  void operator()(RTCGeometry handle) const { rtcReleaseGeometry(handle); }
};
using Scene = std::unique_ptr<RTCSceneTy, Release>;
using Geometry = std::unique_ptr<RTCGeometryTy, Release>;

// A device that remembers the first error since the last check() and counts the bytes Embree holds.
// Its number of threads is that of the TBB arena in which scenes are committed.
class Device {
 public:
  Device() : state_(std::make_unique<State>()), handle_(rtcNewDevice(nullptr)) {
    if (!handle_) throw Error(ErrorKind::Internal, "Embree cannot start on this processor");
    rtcSetDeviceErrorFunction(handle_.get(), &State::onError, state_.get());
    rtcSetDeviceMemoryMonitorFunction(handle_.get(), &State::onMemory, state_.get());
  }

  // Throws what Embree reported since the last call: Error(Memory) or Error(Internal).
  void check(const std::string& where) {
    const std::lock_guard lock(state_->mutex);
    const RTCError code = std::exchange(state_->code, RTC_ERROR_NONE);
    if (code == RTC_ERROR_OUT_OF_MEMORY)
      throw Error(ErrorKind::Memory, "no memory for the ray tracing structure", where,
                  "Use a larger target edge length or fewer prototypes");
    if (code != RTC_ERROR_NONE) throw Error(ErrorKind::Internal, "Embree: " + state_->message, where);
  }
  void requireFilters() {
    if (!rtcGetDeviceProperty(handle_.get(), RTC_DEVICE_PROPERTY_FILTER_FUNCTION_SUPPORTED))
      throw Error(ErrorKind::Internal,
                  "Embree is built without filter functions, which points and shadows of what is not opaque need");
  }
  uint64_t bytes() const { return uint64_t(std::max<int64_t>(0, state_->bytes)); }

  Scene newScene() {
    Scene scene(rtcNewScene(handle_.get()));
    // Robust: watertight along shared edges. Medium: the result of HIGH depends on the number of threads.
    if (scene) {
      rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
      rtcSetSceneBuildQuality(scene.get(), RTC_BUILD_QUALITY_MEDIUM);
    }
    return scene;
  }
  // Packets of 16 are slower than two of 8 here: Embree would take them for a stream.
  bool prefersHalfPackets() const {
    return !rtcGetDeviceProperty(handle_.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) &&
           rtcGetDeviceProperty(handle_.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED);
  }
  Geometry newGeometry(RTCGeometryType type) { return Geometry(rtcNewGeometry(handle_.get(), type)); }

 private:
  struct State {
    std::mutex mutex;
    RTCError code = RTC_ERROR_NONE;
    std::string message;
    std::atomic<int64_t> bytes = 0;

    // Called by Embree from any thread; must not throw.
    static void onError(void* self, RTCError code, const char* message) {
      State& state = *static_cast<State*>(self);
      const std::lock_guard lock(state.mutex);
      if (state.code != RTC_ERROR_NONE) return;
      state.code = code;
      state.message = message ? message : "unknown error";
    }
    static bool onMemory(void* self, ssize_t bytes, bool) {
      static_cast<State*>(self)->bytes += bytes;
      return true;
    }
  };
  std::unique_ptr<State> state_;  // outlives the device, which calls back while it is released
  std::unique_ptr<RTCDeviceTy, Release> handle_;
};

// Embree takes no coordinate beyond this; Debian's build stops the program at one, in unused lanes too.
inline constexpr float kLargestCoordinate = 1e18f;

// Coordinates within the triangle: the robust test accepts some outside of it by a rounding error.
struct Barycentric {
  float b1, b2;
  Barycentric(float u, float v) : b1(std::clamp(u, 0.0f, 1.0f)), b2(std::clamp(v, 0.0f, 1.0f - b1)) {}
};

// What filter functions get to see of a query. Embree's part comes first: they are given its address.
struct Context {
  RTCIntersectContext embree;
  void* recorder = nullptr;  // null: every hit counts
};

// Up to 16 rays in Embree's layout, and the queries on them.
class Query {
 public:
  // largest_origin: what every instance's space still holds (see kLargestCoordinate).
  // half_packets: trace coherent rays as two packets of 8.
  Query(Coherence coherence, float largest_origin, bool half_packets)
      : largest_origin_(largest_origin), half_packets_(half_packets && coherence == Coherence::Coherent) {
    fillConstants();
    rtcInitIntersectContext(&context_.embree);
    context_.embree.flags =
        coherence == Coherence::Coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  }

  // Rays that are not finite, end before they start or are outside of the shutter are inactive: they hit nothing.
  void setRay(uint32_t lane, const Ray& ray) {
    const Vec3f o = absolute(ray.origin), d = absolute(ray.direction);
    const bool usable = o.x <= largest_origin_ && o.y <= largest_origin_ && o.z <= largest_origin_ && d.x <= 2 &&
                        d.y <= 2 && d.z <= 2 && ray.tnear >= 0 && ray.tnear <= ray.tfar && ray.time >= 0 &&
                        ray.time <= 1;
    fill(lane, usable ? ray : Ray{}, usable);
  }
  void disable(uint32_t lane) { fill(lane, Ray{}, false); }

  // All lanes at once: rays from one point, which stays in the packet. setRays() does what setRay() would do.
  void setOrigin(Vec3f origin) {
    for (uint32_t lane = 0; lane < kPacketWidth; ++lane) fill(lane, {origin, 0, {}, 0}, false);
    const Vec3f o = absolute(origin);
    origin_usable_ = o.x <= largest_origin_ && o.y <= largest_origin_ && o.z <= largest_origin_;
    if (!origin_usable_)
      for (uint32_t lane = 0; lane < kPacketWidth; ++lane) disable(lane);
  }
  void setRays(const RayPacket& rays, uint32_t count) {
    RTCRay16& r = packet_.ray;
    const uint32_t end = origin_usable_ ? count : 0;
    for (uint32_t i = 0; i < kPacketWidth; ++i) {
      const float dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i], tnear = rays.tnear[i], tfar = rays.tfar[i];
      const bool usable =
          (i < end) & (std::abs(dx) <= 2) & (std::abs(dy) <= 2) & (std::abs(dz) <= 2) & (tnear >= 0) & (tnear <= tfar);
      r.dir_x[i] = usable ? dx : 0, r.dir_y[i] = usable ? dy : 0, r.dir_z[i] = usable ? dz : 0;
      r.tnear[i] = usable ? tnear : 0, r.tfar[i] = usable ? tfar : 0;
      packet_.hit.geomID[i] = packet_.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      valid_[i] = usable ? -1 : 0;
    }
  }
  // The same for rays with origins or times of their own. setOrigin() was called all the same.
  void setOwnRays(const RayPacket& rays, uint32_t count, bool own_origins, bool own_times) {
    RTCRay16& r = packet_.ray;
    setRays(rays, count);
    for (uint32_t i = 0; i < kPacketWidth; ++i) {
      bool usable = valid_[i] != 0;
      if (own_times) {
        const float time = rays.time[i];
        usable &= (time >= 0) & (time <= 1);
        r.time[i] = usable ? time : 0;
      }
      if (own_origins) {
        const float ox = rays.ox[i], oy = rays.oy[i], oz = rays.oz[i], most = largest_origin_;
        usable &= (std::abs(ox) <= most) & (std::abs(oy) <= most) & (std::abs(oz) <= most);
        r.org_x[i] = usable ? ox : 0, r.org_y[i] = usable ? oy : 0, r.org_z[i] = usable ? oz : 0;
      }
      valid_[i] = usable ? -1 : 0;
    }
  }
  // hit() of every lane.
  void hits(HitPacket& out) const {
    const RTCHit16& h = packet_.hit;
    for (uint32_t i = 0; i < kPacketWidth; ++i) {
      const bool valid = h.geomID[i] != RTC_INVALID_GEOMETRY_ID;
      const float u = h.u[i], v = h.v[i];
      const float b1 = u < 0 ? 0 : u > 1 ? 1 : u, rest = 1 - b1;
      const float b2 = v < 0 ? 0 : v > rest ? rest : v;
      out.instance[i] = valid ? h.instID[0][i] : kNoInstance;
      out.mesh[i] = valid ? h.geomID[i] : 0, out.triangle[i] = valid ? h.primID[i] : 0;
      out.b1[i] = valid ? b1 : 0, out.b2[i] = valid ? b2 : 0;
      out.t[i] = valid ? packet_.ray.tfar[i] : std::numeric_limits<float>::infinity();
      out.time[i] = valid ? packet_.ray.time[i] : 0;
    }
  }

  void intersect(RTCScene scene) {
    if (!half_packets_) return intersect16(scene);
    intersect8(scene, 0);
    intersect8(scene, 8);
  }
  void intersect16(RTCScene scene) { rtcIntersect16(valid_.data(), scene, &context_.embree, &packet_); }
  void occluded(RTCScene scene) { rtcOccluded16(valid_.data(), scene, &context_.embree, &packet_.ray); }

  // Of the geometries' filters; see shadow_hits.cpp.
  void setRecorder(void* recorder) { context_.recorder = recorder; }

  bool isOccluded(uint32_t lane) const { return valid_[lane] != 0 && packet_.ray.tfar[lane] < 0; }
  Hit hit(uint32_t lane) const {
    const RTCHit16& h = packet_.hit;
    if (h.geomID[lane] == RTC_INVALID_GEOMETRY_ID) return {};
    const Barycentric b(h.u[lane], h.v[lane]);
    return {h.instID[0][lane],      h.geomID[lane],        h.primID[lane], b.b1, b.b2,
            packet_.ray.tfar[lane], packet_.ray.time[lane]};
  }

 private:
  // Lanes first .. first + 8.
  void intersect8(RTCScene scene, uint32_t first) {
    RTCRayHit8 half;
    const auto load = [first](auto& to, const auto& from) { std::copy_n(from + first, 8, to); };
    const auto store = [first](auto& to, const auto& from) { std::copy_n(from, 8, to + first); };
    RTCRay16& r = packet_.ray;
    RTCHit16& h = packet_.hit;
    load(half.ray.org_x, r.org_x), load(half.ray.org_y, r.org_y), load(half.ray.org_z, r.org_z);
    load(half.ray.dir_x, r.dir_x), load(half.ray.dir_y, r.dir_y), load(half.ray.dir_z, r.dir_z);
    load(half.ray.tnear, r.tnear), load(half.ray.tfar, r.tfar), load(half.ray.time, r.time);
    load(half.ray.mask, r.mask), load(half.ray.id, r.id), load(half.ray.flags, r.flags);
    load(half.hit.geomID, h.geomID), load(half.hit.instID[0], h.instID[0]);
    load(half.hit.u, h.u), load(half.hit.v, h.v), load(half.hit.primID, h.primID);
    rtcIntersect8(&valid_[first], scene, &context_.embree, &half);
    store(r.tfar, half.ray.tfar), store(h.u, half.hit.u), store(h.v, half.hit.v);
    store(h.geomID, half.hit.geomID), store(h.primID, half.hit.primID), store(h.instID[0], half.hit.instID[0]);
  }
  void fill(uint32_t lane, const Ray& ray, bool active) {
    RTCRay16& r = packet_.ray;
    r.org_x[lane] = ray.origin.x, r.org_y[lane] = ray.origin.y, r.org_z[lane] = ray.origin.z;
    r.dir_x[lane] = ray.direction.x, r.dir_y[lane] = ray.direction.y, r.dir_z[lane] = ray.direction.z;
    r.tnear[lane] = ray.tnear, r.tfar[lane] = ray.tfar, r.time[lane] = ray.time;
    packet_.hit.geomID[lane] = packet_.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
    valid_[lane] = active ? -1 : 0;
  }
  // What is the same for all rays.
  void fillConstants() {
    RTCRay16& r = packet_.ray;
    for (uint32_t lane = 0; lane < kPacketWidth; ++lane) {
      r.mask[lane] = 0xffffffffu, r.id[lane] = lane, r.flags[lane] = 0;
      packet_.hit.u[lane] = packet_.hit.v[lane] = 0, packet_.hit.primID[lane] = 0;  // copied, if not used
    }
  }

  alignas(64) std::array<int, kPacketWidth> valid_;
  RTCRayHit16 packet_;  // every lane is filled by setRay() or disable()
  float largest_origin_;
  bool half_packets_;
  bool origin_usable_ = false;
  Context context_;
};

}  // namespace encore::embree
