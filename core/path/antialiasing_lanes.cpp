#include "core/path/antialiasing_lanes.h"

#include "core/trace/clones.h"

namespace encore {

ENCORE_AVX2_CLONES
void jitterPixel(const Strata& strata, uint32_t seed, uint32_t pixel, int32_t x, int32_t y,
                 uint32_t* __restrict position, float* __restrict film_x, float* __restrict film_y) {
  const Strata::Pattern pattern = strata.pattern(pixel, seed);
  const float *column = pattern.column, *row = pattern.row, across = strata.across();
  const uint32_t count = strata.count();
  for (uint32_t s = 0; s < count; ++s) {
    const uint32_t p = jitteredPosition(column[s], row[s], across, pixel, s, seed);
    position[s] = p;
    film_x[s] = filmX(x, p), film_y[s] = filmY(y, p);
  }
}

// Nearest of all lanes, halving in an order that vector instructions can follow.
ENCORE_AVX2_CLONES
float nearest(const PacketLanes<float>& depth) {
  PacketLanes<float> d;
  for (uint32_t i = 0; i < kPacketWidth; ++i) d[i] = depth[i];
  for (uint32_t i = 0; i < 8; ++i) d[i] = d[i] < d[i + 8] ? d[i] : d[i + 8];
  for (uint32_t i = 0; i < 4; ++i) d[i] = d[i] < d[i + 4] ? d[i] : d[i + 4];
  return std::min(std::min(d[0], d[1]), std::min(d[2], d[3]));
}
ENCORE_AVX2_CLONES
uint32_t countSurfaces(const PacketLanes<uint32_t>& instance) {
  uint32_t count = 0;
  for (uint32_t i = 0; i < kPacketWidth; ++i) count += instance[i] != kNoInstance ? 1u : 0u;
  return count;
}
ENCORE_AVX2_CLONES
void storeHits(const PacketLanes<uint32_t>& instance, uint32_t begin, uint32_t end, float* __restrict out) {
  for (uint32_t i = begin; i < end; ++i) out[i - begin] = instance[i] != kNoInstance ? 1.0f : 0.0f;
}
ENCORE_AVX2_CLONES
void fillThroughput(const PacketLanes<uint32_t>& instance, Vec3f value, Vec3f* __restrict out) {
  for (uint32_t i = 0; i < kPacketWidth; ++i) {
    const bool hit = instance[i] != kNoInstance;
    out[i] = {hit ? value.x : 0, hit ? value.y : 0, hit ? value.z : 0};
  }
}
ENCORE_AVX2_CLONES
bool uniform(const PacketLanes<uint32_t>& instance, const PacketLanes<int32_t>& materials, int32_t material) {
  uint32_t others = 0;
  for (uint32_t i = 0; i < kPacketWidth; ++i)
    others += (instance[i] != kNoInstance) & (materials[i] != material) ? 1u : 0u;
  return others == 0;
}
ENCORE_AVX2_CLONES
void storeKeys(const PacketLanes<uint32_t>& instance, const PacketLanes<uint32_t>& primitive_side, uint32_t begin,
               uint32_t end, SurfaceKey* __restrict out) {
  for (uint32_t i = begin; i < end; ++i)
    out[i - begin] = {instance[i], instance[i] == kNoInstance ? 0 : primitive_side[i]};
}
ENCORE_AVX2_CLONES
void storePairs(const PacketLanes<float>& u, const PacketLanes<float>& v, uint32_t begin, uint32_t end,
                Vec2f* __restrict out) {
  for (uint32_t i = begin; i < end; ++i) out[i - begin] = {u[i], v[i]};
}
ENCORE_AVX2_CLONES
void storeNormals(const SurfacePacket& points, uint32_t begin, uint32_t end, Vec3f* __restrict out) {
  for (uint32_t i = begin; i < end; ++i) out[i - begin] = {points.nx[i], points.ny[i], points.nz[i]};
}

}  // namespace encore
