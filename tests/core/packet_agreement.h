// Packets against single rays: the same hits and surfaces, to the last bit.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "core/trace/packets.h"
#include "shapes.h"

namespace encore::test {

inline bool same(const Hit& a, const Hit& b) { return std::memcmp(&a, &b, sizeof(Hit)) == 0; }

inline RayPacket packed(std::span<const Ray> rays) {
  RayPacket packet{};
  for (size_t i = 0; i < rays.size(); ++i) {
    const Ray& ray = rays[i];
    packet.ox[i] = ray.origin.x, packet.oy[i] = ray.origin.y, packet.oz[i] = ray.origin.z;
    packet.time[i] = ray.time;
    packet.dx[i] = ray.direction.x, packet.dy[i] = ray.direction.y, packet.dz[i] = ray.direction.z;
    packet.tnear[i] = ray.tnear, packet.tfar[i] = ray.tfar;
  }
  return packet;
}

struct PacketCounts {
  uint32_t hit = 0, missed = 0;  // lanes
};

// Up to sixteen rays, traced as a packet and one by one. round: for messages.
inline void expectAgreement(const TraceScene& trace, PacketTracer& tracer, std::span<const Ray> rays, uint32_t round,
                            PacketCounts& counts) {
  const RayPacket packet = packed(rays);
  std::vector<Hit> expected(rays.size());
  trace.intersect(rays, expected, Coherence::Coherent);
  HitPacket hits;
  SurfacePacket points;
  tracer.intersect(packet, uint32_t(rays.size()), hits);
  tracer.surface(packet, hits, points);
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    const Hit hit = hits.hit(i);
    ASSERT_TRUE(same(hit, i < rays.size() ? expected[i] : Hit{})) << round << " " << i;
    if (!hit.valid()) {
      EXPECT_EQ((Vec3f{points.nx[i], points.ny[i], points.nz[i]}), Vec3f{});
      ++counts.missed;
      continue;
    }
    ++counts.hit;
    const SurfacePoint point = trace.surface(hit, rays[i].direction);
    EXPECT_EQ(points.primitive_side[i], point.key(0).primitive_side);
    EXPECT_EQ((Vec2f{points.u[i], points.v[i]}), point.uv);
    EXPECT_EQ((Vec3f{points.nx[i], points.ny[i], points.nz[i]}), point.side ? -point.ns : point.ns);
    EXPECT_EQ(points.material[i], point.material);
    EXPECT_EQ(tracer.geometricNormal(packet, hits, i), point.ng);
    const Vec3f dpdx = point.e1 * 0.1f, dpdy = point.e2 * 0.2f + point.ng;
    EXPECT_EQ(tracer.gradients(hits, i).footprint(dpdx, dpdy), trace.parametricFootprint(hit, point, dpdx, dpdy));
  }
}

}  // namespace encore::test
