// Embree 3.13 behind owning handles: the only file that includes its headers. What Embree 4 does
// differently (query arguments instead of an intersect context) is confined to Query below.
#pragma once

#include <embree3/rtcore.h>

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>

#include "core/scene/error.h"
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

inline constexpr uint32_t kPacketWidth = 16;

// Embree takes no coordinate beyond this; Debian's build stops the program at one, in unused lanes too.
inline constexpr float kLargestCoordinate = 1e18f;

// Up to 16 rays in Embree's layout, and the queries on them.
class Query {
 public:
  // largest_origin: what every instance's space still holds (see kLargestCoordinate).
  Query(Coherence coherence, float largest_origin) : largest_origin_(largest_origin) {
    rtcInitIntersectContext(&context_);
    context_.flags =
        coherence == Coherence::Coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  }

  // Rays that are not finite or end before they start are inactive: they hit nothing.
  void setRay(uint32_t lane, const Ray& ray) {
    const Vec3f o = absolute(ray.origin), d = absolute(ray.direction);
    const bool usable = o.x <= largest_origin_ && o.y <= largest_origin_ && o.z <= largest_origin_ && d.x <= 2 &&
                        d.y <= 2 && d.z <= 2 && ray.tnear >= 0 && ray.tnear <= ray.tfar;
    fill(lane, usable ? ray : Ray{}, usable);
  }
  void disable(uint32_t lane) { fill(lane, Ray{}, false); }

  void intersect(RTCScene scene) { rtcIntersect16(valid_.data(), scene, &context_, &packet_); }
  void occluded(RTCScene scene) { rtcOccluded16(valid_.data(), scene, &context_, &packet_.ray); }

  bool isOccluded(uint32_t lane) const { return valid_[lane] != 0 && packet_.ray.tfar[lane] < 0; }
  Hit hit(uint32_t lane) const {
    const RTCHit16& h = packet_.hit;
    if (h.geomID[lane] == RTC_INVALID_GEOMETRY_ID) return {};
    // The robust test accepts coordinates outside of the triangle by a rounding error.
    const float b1 = std::clamp(h.u[lane], 0.0f, 1.0f);
    const float b2 = std::clamp(h.v[lane], 0.0f, 1.0f - b1);
    return {h.instID[0][lane], h.geomID[lane], h.primID[lane], b1, b2, packet_.ray.tfar[lane]};
  }

 private:
  void fill(uint32_t lane, const Ray& ray, bool active) {
    RTCRay16& r = packet_.ray;
    r.org_x[lane] = ray.origin.x, r.org_y[lane] = ray.origin.y, r.org_z[lane] = ray.origin.z;
    r.dir_x[lane] = ray.direction.x, r.dir_y[lane] = ray.direction.y, r.dir_z[lane] = ray.direction.z;
    r.tnear[lane] = ray.tnear, r.tfar[lane] = ray.tfar;
    r.time[lane] = 0, r.mask[lane] = 0xffffffffu, r.id[lane] = lane, r.flags[lane] = 0;
    packet_.hit.geomID[lane] = packet_.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
    valid_[lane] = active ? -1 : 0;
  }

  alignas(64) std::array<int, kPacketWidth> valid_;
  RTCRayHit16 packet_;  // every lane is filled by setRay() or disable()
  float largest_origin_;
  RTCIntersectContext context_;
};

}  // namespace encore::embree
