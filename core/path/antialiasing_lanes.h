// What antialiasing samples need done to all lanes of a packet, by vector instructions.
#pragma once

#include "core/path/antialiasing_samples.h"
#include "core/trace/packets.h"

namespace encore {

// The samples of one pixel at (x, y), whose random number key is `pixel`: their offsets, and their places on the film.
void jitterPixel(const Strata& strata, uint32_t seed, uint32_t pixel, int32_t x, int32_t y,
                 uint32_t* __restrict position, float* __restrict film_x, float* __restrict film_y);
float nearest(const PacketLanes<float>& depth);
uint32_t countSurfaces(const PacketLanes<uint32_t>& instance);
// All hits are on this material.
bool uniform(const PacketLanes<uint32_t>& instance, const PacketLanes<int32_t>& materials, int32_t material);

// Write lanes begin to end to consecutive places.
void storeHits(const PacketLanes<uint32_t>& instance, uint32_t begin, uint32_t end, float* __restrict out);
void storeKeys(const PacketLanes<uint32_t>& instance, const PacketLanes<uint32_t>& primitive_side, uint32_t begin,
               uint32_t end, SurfaceKey* __restrict out);
void storePairs(const PacketLanes<float>& u, const PacketLanes<float>& v, uint32_t begin, uint32_t end,
                Vec2f* __restrict out);
void storeNormals(const SurfacePacket& points, uint32_t begin, uint32_t end, Vec3f* __restrict out);
// All lanes: value where something was hit.
void fillThroughput(const PacketLanes<uint32_t>& instance, Vec3f value, Vec3f* __restrict out);

}  // namespace encore
