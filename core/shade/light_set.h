// The lights of a scene, prepared once for a frame: images decoded, meshes sorted, bounds and rules of shadows.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "core/scene/scene.h"
#include "core/shade/lights.h"
#include "core/trace/trace_scene.h"

namespace encore {

class LightImageCache;

// How a light's shadows differ from black ones that reach all the way (UsdLuxShadowAPI). What is occluded gets
// `color` of the light; occluders further away than `distance` do not count, and from `distance` - `falloff` on they
// count less, by the power `gamma` of what is left of the way.
struct ShadowRule {
  bool enable = true;
  Vec3f color;
  float distance = std::numeric_limits<float>::infinity();
  float falloff = 0, gamma = 1;
  const std::vector<uint8_t>* groups = nullptr;  // null: all prims cast shadows

  // Nothing but rays that end early: what lies in between decides alone.
  bool simple() const { return enable && color == Vec3f{} && !(falloff > 0) && !groups; }
  bool plain() const { return simple() && distance == std::numeric_limits<float>::infinity(); }
  // 1 where an occluder at that distance casts a full shadow, 0 where it casts none.
  float strength(float occluder_distance) const;
};

struct PreparedLight {
  const Light* light = nullptr;
  LightParts parts;  // but for the time
  ShadowRule shadow;
  bool delta = false;
  uint32_t rays = 0;    // per shade, where it is not chosen among others
  bool chosen = false;  // it may be chosen among others (Settings::most_light_samples), if there are too many
  // A ball around it, for lights at finite distance; radius infinite: at infinity.
  Vec3f centre;
  float radius = std::numeric_limits<float>::infinity();
  Vec3f facing;      // where it emits to one side only
  float weight = 0;  // brightness times the largest area that can be seen, or times solid angle

  bool lights(uint32_t link_group) const {
    return link_group >= light->lit_groups.size() || light->lit_groups[link_group] != 0;
  }
  // A ray from p may meet it. Conservative, and cheaper than to ask.
  bool mayMeet(Vec3f p, Vec3f direction) const;
};

// Copies share what they hold. References to scene and trace are kept; lights must not change meanwhile.
class LightSet {
 public:
  // cache: images that are in it are taken from there, and it holds those of this scene afterwards. Null: none.
  // Throws what TextureSource::read() throws.
  LightSet(const Scene& scene, const Settings& settings, const TraceScene& trace, LightImageCache* cache = nullptr);

  std::span<const PreparedLight> lights() const { return data_->lights; }  // in the order of Scene::lights
  const LightImage* image(const Light& light) const;                       // null: it has none
  // All lights with their own number of rays would take more than Settings::most_light_samples.
  bool chooses() const { return data_->chooses; }
  uint64_t raysPerShade() const { return data_->rays_per_shade; }  // at most
  // What meshes that are lights emit from an instance's outside along `emitted`; 0 for other instances.
  bool anyMesh() const { return !data_->emitting.empty(); }
  Vec3f meshRadiance(uint32_t instance, Vec3f emitted) const;
  uint64_t bytes() const { return data_->bytes; }  // of images and meshes

 private:
  struct Image {
    int32_t texture;
    Light::Kind kind;
    DomeFormat format;
    std::shared_ptr<const LightImage> image;
  };
  struct Data {
    std::vector<std::unique_ptr<Image>> images;
    std::vector<std::unique_ptr<MeshLight>> meshes;
    std::vector<PreparedLight> lights;
    std::vector<uint32_t> emitting;    // lights that are meshes
    LightImageCache* cache = nullptr;  // while it is made
    bool chooses = false;
    uint64_t rays_per_shade = 0, bytes = 0;
  };
  static PreparedLight prepare(const Scene& scene, const Settings& settings, const TraceScene& trace,
                               const Light& light, Data& data);
  static const LightImage* decode(const Scene& scene, const Light& light, Data& data);

  std::shared_ptr<const Data> data_;
};

}  // namespace encore
