// The radiance that leaves a hit towards where its path came from: emission, diffuse and rough lobes
// under all lights, with soft shadows by area sampling and ambient occlusion as dome visibility.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "core/pattern/patterns.h"
#include "core/scene/scene.h"
#include "core/shade/bsdf.h"
#include "core/shade/light_set.h"
#include "core/trace/trace_scene.h"

namespace encore {

// Where a path was absorbed (Listing 2's return value): the input of shade().
struct PathVertex {
  Hit hit;  // not valid: radiance is carried in throughput (light, background, nothing)
  Vec3f throughput;
  Vec3f direction;     // of the ray that arrived, unit
  Vec3f dpdx, dpdy;    // footprint of the pixel on the surface, world space
  uint32_t pixel = 0;  // random number key: y * image width + x, or the seed's own
  uint32_t sample = 0;
  SurfaceKey key{kNoInstance, 0};  // what shading may be reused within
  Vec2f uv;                        // within the primitive
  Vec4f aspect;                    // further coordinates of the reuse distance; only where a setting asks for them
  float footprint = 0;             // r of §2.4 in the units of uv; only where a setting asks for it
};

struct ShadeContext {
  const Scene& scene;
  const Settings& settings;
  const TraceScene& trace;
  Patterns& patterns;
  std::atomic<uint64_t>& rays_traced;
  // Prepared when the context is made, which must be after the lights are known. Contexts of one scene may share it.
  LightSet lights = LightSet(scene, settings, trace);
};

// Per material, 1 where shading multiplies its view-dependent weights itself (viewWeightInShading() in bsdf.h): also
// the materials of instances that are lights, whose emission no interface attenuates.
std::vector<uint8_t> viewWeightsInShading(const Scene& scene, const Settings& settings);

// radiance[i] = shade(vertices[i]). Precondition: all hits valid.
// ends: ascending ends of the blocks within vertices (ends.back() == vertices.size()). Shadow and
// occlusion packets are formed within a block in order, so that the result depends only on the block.
void shade(const ShadeContext& context, std::span<const PathVertex> vertices, std::span<const uint32_t> ends,
           std::span<Vec3f> radiance);

}  // namespace encore
