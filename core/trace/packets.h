// Packets of coherent rays, mostly from one point, as structures of arrays: the fast way to first hits.
//
// Gives what TraceScene::intersect(..., Coherent) and surface() give, to the last bit.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "core/trace/trace_scene.h"

namespace encore {

inline constexpr uint32_t kPacketWidth = 16;

template <class T>
using PacketLanes = T[kPacketWidth];

struct alignas(64) RayPacket {
  PacketLanes<float> ox, oy, oz;  // only read where rays of the packet differ in origin; else that of the tracer
  PacketLanes<float> time;        // only read where the scene moves
  PacketLanes<float> dx, dy, dz;  // unit
  PacketLanes<float> tnear, tfar;
};

// Fields as in Hit; those of a miss are a default Hit's.
struct alignas(64) HitPacket {
  PacketLanes<uint32_t> instance, mesh, triangle;
  PacketLanes<float> b1, b2, t;
  PacketLanes<float> time;

  Hit hit(uint32_t lane) const {
    return {instance[lane], mesh[lane], triangle[lane], b1[lane], b2[lane], t[lane], time[lane]};
  }
};

// What SurfacePoint holds of it, all zero where nothing was hit.
struct alignas(64) SurfacePacket {
  PacketLanes<uint32_t> primitive_side;  // as in SurfaceKey
  PacketLanes<int32_t> material;
  PacketLanes<float> u, v;
  PacketLanes<float> nx, ny, nz;  // shading normal, on the side that the ray came from
};

// How (u, v) change over a triangle: their gradients in its plane, world space.
struct ParameterGradients {
  Vec3f u, v;

  // Average length of the change of (u, v) over two steps in world space.
  float footprint(Vec3f dpdx, Vec3f dpdy) const {
    const auto change = [&](Vec3f dp) {
      const float du = dot(u, dp), dv = dot(v, dp);
      return std::sqrt(du * du + dv * dv);
    };
    return 0.5f * (change(dpdx) + change(dpdy));
  }
};

class PacketTracer {
 public:
  // Keeps a reference to trace. All rays start at origin, unless `own_origins`: then at their own.
  // Not thread-safe: one for each thread.
  PacketTracer(const TraceScene& trace, Vec3f origin, bool own_origins = false);
  ~PacketTracer();
  PacketTracer(const PacketTracer&) = delete;
  PacketTracer& operator=(const PacketTracer&) = delete;

  // count: lanes in use, from the first one; the others hit nothing.
  void intersect(const RayPacket& rays, uint32_t count, HitPacket& hits);
  void surface(const RayPacket& rays, const HitPacket& hits, SurfacePacket& points);
  // Of the triangle that was hit: ng of SurfacePoint, and how parameters change.
  Vec3f geometricNormal(const RayPacket& rays, const HitPacket& hits, uint32_t lane);
  ParameterGradients gradients(const HitPacket& hits, uint32_t lane);

  // Seconds of processor time that rtcIntersect16 alone takes for the packets, filled before.
  double rawSeconds(std::span<const RayPacket> packets);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
