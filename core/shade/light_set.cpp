#include "core/shade/light_set.h"

#include <algorithm>
#include <cmath>

#include "core/shade/light_image_cache.h"

namespace encore {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Bounds are a little larger than the light, so that rounding cuts nothing off.
constexpr float kSlack = 1.0001f;

bool hasImage(const Light& light) {
  return light.texture >= 0 && (light.kind == Light::Kind::Rect || light.kind == Light::Kind::Dome);
}

// Pixels that a texture holds itself cannot be told from others.
LightImageCache::Key keyOf(const Scene& scene, const Light& light) {
  const Texture& texture = scene.textures[size_t(light.texture)];
  const bool dome = light.kind == Light::Kind::Dome;
  return {texture.rgba.empty() ? texture.source.get() : nullptr, dome, dome ? light.format : DomeFormat::LatLong};
}

ShadowRule shadowRule(const Light& light, const Settings& settings) {
  ShadowRule rule;
  rule.enable = light.shadow_enable;
  rule.color = light.shadow_color;
  if (light.shadow_distance >= 0) {
    rule.distance = light.shadow_distance;
    if (light.shadow_falloff > 0) rule.falloff = std::min(light.shadow_falloff, light.shadow_distance);
    rule.gamma = light.shadow_falloff_gamma;
  }
  if (light.kind == Light::Kind::Dome && settings.occlusion_distance_world > 0)
    rule.distance = std::min(rule.distance, settings.occlusion_distance_world);
  if (!light.shadow_groups.empty()) rule.groups = &light.shadow_groups;
  return rule;
}

// Largest area that can be seen of a light at finite distance.
float visibleArea(const PreparedLight& prepared) {
  const Light& light = *prepared.light;
  switch (light.kind) {
    case Light::Kind::Rect:
      return 4 * length(cross(light.half_u, light.half_v));
    case Light::Kind::Disk:
      return kPi * length(cross(light.half_u, light.half_v));
    case Light::Kind::Sphere:
      return kPi * light.radius * light.radius;
    case Light::Kind::Cylinder:
      return 4 * light.radius * length(light.half_u);
    case Light::Kind::Mesh:
      return 0.5f * prepared.parts.mesh->area();
    default:
      return 0;
  }
}

void addBounds(PreparedLight& prepared) {
  const Light& light = *prepared.light;
  prepared.centre = toFloat(light.centre);
  const float u = length(light.half_u), v = length(light.half_v);
  switch (light.kind) {
    case Light::Kind::Rect:
      prepared.radius = u + v;
      break;
    case Light::Kind::Disk:
      prepared.radius = std::sqrt(u * u + v * v);
      break;
    case Light::Kind::Sphere:
      prepared.radius = light.radius;
      break;
    case Light::Kind::Cylinder:
      prepared.radius = std::sqrt(u * u + light.radius * light.radius);
      break;
    case Light::Kind::Mesh:
      prepared.centre = prepared.parts.mesh->centre(), prepared.radius = prepared.parts.mesh->radius();
      break;
    default:
      return;
  }
  prepared.radius *= kSlack;
  if (light.kind == Light::Kind::Rect || light.kind == Light::Kind::Disk)
    prepared.facing = -normalize(cross(light.half_u, light.half_v));
}

float brightness(const PreparedLight& prepared) {
  const Light& light = *prepared.light;
  Vec3f radiance = light.radiance;
  if (prepared.parts.image) radiance *= prepared.parts.image->average();
  return maxComponent(absolute(radiance)) * std::max(std::abs(light.diffuse), std::abs(light.specular));
}

}  // namespace

float ShadowRule::strength(float occluder_distance) const {
  if (!(occluder_distance < distance)) return 0;
  if (!(falloff > 0)) return 1;
  const float left = std::min((distance - occluder_distance) / falloff, 1.0f);
  return gamma == 1 ? left : std::pow(left, gamma);
}

bool PreparedLight::mayMeet(Vec3f p, Vec3f direction) const {
  if (radius == kInfinity) return true;
  const Vec3f to = centre - p;
  const float along = dot(to, direction), d2 = dot(to, to), r2 = radius * radius;
  if (d2 <= r2) return true;
  const Vec3f miss = cross(to, direction);
  return along > 0 && dot(miss, miss) <= r2 * kSlack + d2 * 1e-6f;
}

const LightImage* LightSet::image(const Light& light) const {
  if (!hasImage(light)) return nullptr;
  for (const auto& i : data_->images)
    if (i->texture == light.texture && i->kind == light.kind && i->format == light.format) return i->image.get();
  return nullptr;
}

const LightImage* LightSet::decode(const Scene& scene, const Light& light, Data& data) {
  if (!hasImage(light)) return nullptr;
  for (const auto& i : data.images)
    if (i->texture == light.texture && i->kind == light.kind && i->format == light.format) return i->image.get();
  const Texture& texture = scene.textures[size_t(light.texture)];
  const LightImageCache::Key key = keyOf(scene, light);
  std::shared_ptr<const LightImage> image = data.cache ? data.cache->find(key) : nullptr;
  if (image) {
    texture.source->reused();
  } else {
    image = std::make_shared<const LightImage>(key.dome ? LightImage(texture, light.format) : LightImage(texture));
    if (data.cache) data.cache->add(key, texture.source, image);
  }
  data.images.push_back(std::make_unique<Image>(Image{light.texture, light.kind, light.format, image}));
  data.bytes += image->bytes();
  return image.get();
}

PreparedLight LightSet::prepare(const Scene& scene, const Settings& settings, const TraceScene& trace,
                                const Light& light, Data& data) {
  PreparedLight prepared;
  prepared.light = &light;
  prepared.parts.image = decode(scene, light, data);
  if (light.kind == Light::Kind::Mesh && light.instance >= 0) {
    const bool flipped = scene.instances[size_t(light.instance)].to_world.determinant() < 0;
    data.meshes.push_back(std::make_unique<MeshLight>(trace, uint32_t(light.instance), flipped, scene.moves()));
    data.bytes += data.meshes.back()->bytes();
    data.emitting.push_back(uint32_t(data.lights.size()));
    prepared.parts.mesh = data.meshes.back().get(), prepared.parts.trace = &trace;
  }
  prepared.shadow = shadowRule(light, settings);
  prepared.delta = isDelta(light);
  const bool dome = light.kind == Light::Kind::Dome;
  prepared.rays = light.samples > 0 ? light.samples : dome ? settings.occlusion_samples : settings.light_samples;
  if (prepared.delta) prepared.rays = 1;
  const bool nothing = light.kind == Light::Kind::Mesh && !prepared.parts.mesh;
  prepared.chosen = !prepared.delta && !dome && light.samples == 0 && !nothing;
  if (!nothing) addBounds(prepared);
  if (!prepared.chosen) return prepared;
  if (light.kind == Light::Kind::Distant) {
    const float s = std::sin(0.25f * std::min(light.angle_radians, 2 * kPi));
    prepared.weight = brightness(prepared) * 4 * kPi * s * s;
  } else {
    prepared.weight = brightness(prepared) * visibleArea(prepared);
  }
  return prepared;
}

LightSet::LightSet(const Scene& scene, const Settings& settings, const TraceScene& trace, LightImageCache* cache) {
  const auto data = std::make_shared<Data>();
  data->cache = cache;
  if (cache) {
    std::vector<LightImageCache::Key> keys;
    for (const Light& light : scene.lights)
      if (hasImage(light)) keys.push_back(keyOf(scene, light));
    cache->retain(keys);
  }
  uint64_t pool = 0;
  for (const Light& light : scene.lights) {
    data->lights.push_back(prepare(scene, settings, trace, light, *data));
    const PreparedLight& prepared = data->lights.back();
    data->rays_per_shade += prepared.rays;
    if (prepared.chosen) pool += prepared.rays;
  }
  data->chooses = pool > settings.most_light_samples;
  if (data->chooses) data->rays_per_shade += settings.most_light_samples - pool;
  data->cache = nullptr;
  data_ = data;
}

Vec3f LightSet::meshRadiance(uint32_t instance, Vec3f emitted) const {
  Vec3f sum;
  for (const uint32_t k : data_->emitting) {
    const Light& light = *data_->lights[k].light;
    if (uint32_t(light.instance) == instance) sum += lightRadiance(light, nullptr, {0, {}}, -emitted);
  }
  return sum;
}

}  // namespace encore
