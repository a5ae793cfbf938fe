// Listing 2 as a wavefront per bounce: follow rays until absorbed, return throughput and hit.
#pragma once

#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "core/shade/shade.h"
#include "core/trace/trace_scene.h"

namespace encore {

enum class Layer : uint32_t { Direct = 0, Reflection = 1, Refraction = 2 };
inline constexpr uint32_t kMaxLayers = 3;
const char* layerName(Layer layer);
// The layers that some material of the scene can feed; Direct always exists.
std::vector<Layer> sceneLayers(const Scene& scene, const Settings& settings);

// A camera ray and what it hit first: traced once, shared by all layers.
struct FirstHit {
  Vec3f origin, direction;
  Hit hit;
  float film_x = 0, film_y = 0;    // pixels, y down
  uint32_t pixel = 0, sample = 0;  // random number key
  bool active = false;             // false: outside of the image; such slots give zero
};

// Camera rays of the image. film coordinates: pixels from the upper left corner of the image, y down.
class CameraRays {
 public:
  CameraRays(const Camera& camera, const Settings& settings);
  Ray ray(float film_x, float film_y) const;
  // d(direction)/dx and /dy for a step of one pixel (Igehy 1999, eq. 8); the origin does not move.
  void differential(float film_x, float film_y, Vec3f& dddx, Vec3f& dddy) const;
  float depth(Vec3f point) const;  // along -Z of the camera, world units

 private:
  Vec3f filmDirection(float film_x, float film_y) const;  // not normalized; affine in the film coordinates

  Vec3f origin_;
  Vec3f centre_, step_x_, step_y_;  // filmDirection at the middle of the film, and its change over a pixel
  Vec3f forward_;                   // unit normal of the clipping planes
  float half_width_, half_height_;  // pixels
  float near_, far_;
};

// Fills active slots' origin and direction from film_x, film_y and traces them, block by block.
// ends: as in shade(). rays are counted into context.rays_traced.
void traceFirstHits(const ShadeContext& context, const CameraRays& camera, std::span<FirstHit> first,
                    std::span<const uint32_t> ends);

// Follows every first hit in one layer (§2.4): the first bounce is forced and weighted by its exact
// share; later ones are chosen by chance and divided by the probability; after max_bounces only
// absorption remains. Paths that carry nothing end with throughput 0 and an invalid hit.
// vertices.size() == first.size().
void tracePaths(const ShadeContext& context, const CameraRays& camera, Layer layer, std::span<const FirstHit> first,
                std::span<const uint32_t> ends, std::span<PathVertex> vertices);

}  // namespace encore
