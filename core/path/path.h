// Listing 2 as a wavefront per bounce: follow rays until absorbed, return throughput and hit.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene/block.h"
#include "core/scene/scene.h"
#include "core/shade/shade.h"
#include "core/trace/packets.h"
#include "core/trace/trace_scene.h"

namespace encore {

enum class Layer : uint32_t { Direct = 0, Reflection = 1, Refraction = 2 };
inline constexpr uint32_t kMaxLayers = 3;
const char* layerName(Layer layer);
// The layers that some material of the scene can feed; Direct always exists.
std::vector<Layer> sceneLayers(const Scene& scene, const Settings& settings);

// A camera ray and what it hit first: traced once, shared by all layers. The ray itself is a function of the film
// position (CameraRays), and is computed again where it is needed.
inline constexpr uint32_t kNoPixel = 0xffffffffu;
struct FirstHit {
  Hit hit;
  float film_x = 0, film_y = 0;                      // pixels, y down
  uint32_t pixel = kNoPixel, sample = 0;             // random number key
  bool active() const { return pixel != kNoPixel; }  // false: outside of the image; such slots give zero
};

// Camera rays of the image. film coordinates: pixels from the upper left corner of the image, y down.
class CameraRays {
 public:
  CameraRays(const Camera& camera, const Settings& settings);
  Ray ray(float film_x, float film_y) const;
  // d(direction)/dx and /dy for a step of one pixel (Igehy 1999, eq. 8); the origin does not move.
  void differential(float film_x, float film_y, Vec3f& dddx, Vec3f& dddy) const;
  float depth(Vec3f point) const;  // along -Z of the camera, world units

  Vec3f origin() const { return origin_; }

  // ray() and depth() of kPacketWidth rays, the same to the last bit. Depths of misses are infinite.
  void rays(const float* film_x, const float* film_y, RayPacket& rays) const;
  void depths(const RayPacket& rays, const HitPacket& hits, PacketLanes<float>& depth) const;

 private:
  Vec3f filmDirection(float film_x, float film_y) const;  // not normalized; affine in the film coordinates

  Vec3f origin_;
  Vec3f centre_, step_x_, step_y_;  // filmDirection at the middle of the film, and its change over a pixel
  Vec3f forward_;                   // unit normal of the clipping planes
  float half_width_, half_height_;  // pixels
  float near_, far_;
};

// Where the values of a batch's samples in one layer go, in slot order (core/reuse): the host's view of memory that
// the device reads. What is empty is not needed; the rest is as long as the batch.
struct SampleOutputs {
  std::span<SurfaceKey> key;  // kNoInstance: throughput holds the radiance
  std::span<Vec2f> uv;        // 0 without a surface
  std::span<Vec3f> throughput;
  std::span<float> footprint;  // r of §2.4 in the units of uv; 0 without a surface
};

// What all layers of a batch share, in slot order. Empty: not needed.
struct SharedOutputs {
  std::span<uint32_t> position;  // offset in the pixel, records.h; 0 in slots outside of the image
  std::span<float> coverage;     // 1: a surface, or a light that the camera sees; else 0
  std::span<Vec3f> normal;       // shading normal on the side of the camera; 0 where nothing was hit
  std::span<float> depth;        // per pixel: of its closest sample, along -Z; infinity: nothing
};

// Generates, traces and resolves the antialiasing samples of whole blocks in one pass: samples × samples jittered
// strata in every pixel, the camera's first hits, what the film needs of them, and the direct layer. The result
// depends on nothing but the block. Returns the number of samples of the direct layer that lie on a surface.
// first: blocks.size() * kBlockArea * samples² slots, or empty where nobody needs them: a batch without other
// layers, whose few failures retraceFirstHits() brings back. direct: all empty where the layer is not needed.
uint64_t traceAntialiasing(const ShadeContext& context, const CameraRays& camera, std::span<const BlockOrigin> blocks,
                           std::span<FirstHit> first, const SharedOutputs& shared, const SampleOutputs& direct);

// The first hits of some slots of traceAntialiasing(), the same to the last bit: traces the packets again that they
// were in. slots: ascending. tracePaths(Layer::Direct) makes vertices for shade() of them.
void retraceFirstHits(const ShadeContext& context, const CameraRays& camera, std::span<const BlockOrigin> blocks,
                      std::span<const uint32_t> slots, std::span<FirstHit> first);

// Traces active slots from their film positions, block by block.
// ends: as in shade(). rays are counted into context.rays_traced.
void traceFirstHits(const ShadeContext& context, const CameraRays& camera, std::span<FirstHit> first,
                    std::span<const uint32_t> ends);

// Follows every first hit in one layer (§2.4): the first bounce is forced and weighted by its exact
// share; later ones are chosen by chance and divided by the probability; after max_bounces only
// absorption remains. Paths that carry nothing end with throughput 0 and an invalid hit.
// vertices.size() == first.size(). out: the same values once more, where asked for. With its key or throughput,
// vertices are only filled where a path ends on a surface, and dpdx and dpdy only if some setting or texture of
// the scene can read them.
// Returns the number of paths that end on a surface.
uint64_t tracePaths(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
                    std::span<const uint32_t> ends, std::span<PathVertex> vertices, const SampleOutputs& out = {});

// How fast Embree alone is: all antialiasing rays of the image in prefilled packets, of which only rtcIntersect16 is
// timed, on all threads of the arena. seconds: processor time of all threads together, over their number.
struct RawTrace {
  uint64_t rays = 0;
  double seconds = 0;
};
RawTrace timeRawPrimaryRays(const TraceScene& trace, const CameraRays& camera, const Settings& settings);

}  // namespace encore
