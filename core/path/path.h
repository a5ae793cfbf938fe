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
  float film_x = 0, film_y = 0;                      // pixels of the plane of the image, y down
  uint32_t pixel = kNoPixel, sample = 0;             // random number key
  bool active() const { return pixel != kNoPixel; }  // false: outside of the image; such slots give zero
};

// A path that passes a surface with presence or a cut-out goes straight on, uses up no bounce and stays in its layer.
// First hits are what is left behind all that was passed: coverage, depth, normals and layers follow from them.

// Camera rays of the image and around it. film coordinates: pixels from the upper left corner of the image, y down.
class CameraRays {
 public:
  // moves: the scene does (Scene::moves()), so that samples have times.
  CameraRays(const Camera& camera, const Settings& settings, bool moves = false);

  // What the camera does with a sample: its place on the film, and the random number key that its place on the lens
  // and its time come from. Those of a pixel's samples stratify, together with their places on the film.
  struct Sample {
    float film_x = 0, film_y = 0;
    uint32_t pixel = 0, sample = 0;
  };
  Ray ray(const Sample& sample) const;
  Ray ray(const FirstHit& first) const { return ray(sampleOf(first)); }
  float time(const Sample& sample) const;  // 0 to 1; 0 where nothing moves
  bool moves() const { return moves_; }    // samples have times
  bool ownOrigins() const { return lens_radius_ > 0 || orthographic_ || !poses_.empty(); }  // not all in one point
  // Changes of origin and direction for a step of one pixel (Igehy 1999, eq. 8), lens and time as they are.
  void differential(const Sample& sample, Vec3f& dpdx, Vec3f& dpdy, Vec3f& dddx, Vec3f& dddy) const;
  float depth(Vec3f point) const;                 // along -Z of the camera at the frame's time, world units
  Vec3f origin() const { return still_.origin; }  // of all rays, where they have the same
  // ray() and depth() of kPacketWidth rays, the same to the last bit. Depths of misses are infinite.
  // pixel and sample are only read where the lens or time is.
  void rays(const float* film_x, const float* film_y, const uint32_t* pixel, const uint32_t* sample,
            RayPacket& rays) const;
  void depths(const RayPacket& rays, const HitPacket& hits, PacketLanes<float>& depth) const;

  static Sample sampleOf(const FirstHit& first) { return {first.film_x, first.film_y, first.pixel, first.sample}; }

 private:
  // The camera at one time, in world space.
  struct Pose {
    Vec3f origin;
    // Where the middle of the film looks (not normalized), and what a pixel adds to it; of an orthographic camera, to
    // the origin.
    Vec3f centre, step_x, step_y;
    Vec3f lens_x, lens_y;  // a local unit along the lens
    Vec3f forward;         // unit normal of planes of equal local z, away from the camera
  };
  // A ray before its direction is normalized.
  struct Aim {
    Vec3f origin, direction;
  };

  Pose poseOf(const Affine3d& to_world, const Camera& camera) const;
  Pose poseAt(float time) const;
  float sampleTime(const Sample& sample) const;
  Vec2f lensPoint(const Sample& sample) const;  // local units
  Aim aim(const Pose& pose, float film_x, float film_y, Vec2f lens) const;
  Ray finish(const Pose& pose, const Aim& aim, float film_x, float film_y, Vec2f lens, float time) const;
  void clip(float film_x, float film_y, Vec2f lens, float size, Ray& ray) const;
  void pinholeRays(const float* film_x, const float* film_y, RayPacket& rays) const;
  uint32_t rank(const Sample& sample) const;

  Pose still_;                      // at the frame's time
  std::vector<Pose> poses_;         // at uniform times from shutter open to close; empty: it does not move
  float half_width_, half_height_;  // pixels
  float near_, far_;
  bool moves_, orthographic_;
  uint32_t seed_;
  std::vector<uint32_t> ranks_;    // of the strata of a pixel, along a Z curve; only where lens or time is
  float lens_radius_, lens_step_;  // local units; lens_step_: change of the direction per unit along the lens
  std::vector<Vec2f> aperture_;    // corners on the unit circle, the first one again at the end; empty: a disk
  Vec2f local_centre_, local_step_;
  std::vector<ClippingPlane> planes_;
};

// Some surface of the scene lets paths pass (presence and cut-outs), so that first hits are not those of single rays:
// retraceFirstHits() must not be asked for them.
bool passesThrough(const Scene& scene);

// Where the values of a batch's samples in one layer go, in slot order (core/reuse): the host's view of memory that
// the device reads. What is empty is not needed; the rest is as long as the batch.
struct SampleOutputs {
  std::span<SurfaceKey> key;  // kNoInstance: throughput holds the radiance
  std::span<Vec2f> uv;        // 0 without a surface
  std::span<Vec3f> throughput;
  std::span<float> footprint;  // r of §2.4 in the units of uv; 0 without a surface
  std::span<Vec4f> aspect;     // direction of the arriving ray and time, times their weights; 0 without a surface
};

// What all layers of a batch share, in slot order. Empty: not needed.
struct SharedOutputs {
  // Offset in the pixel, records.h; 0 in slots of the image's blocks that lie outside of it, which hold nothing.
  std::span<uint32_t> position;
  std::span<float> coverage;  // 1: a surface, or a light that the camera sees; else 0
  std::span<Vec3f> normal;    // shading normal on the side of the camera; 0 where nothing was hit
  std::span<float> depth;     // per pixel: of its closest sample, along -Z; infinity: nothing
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
