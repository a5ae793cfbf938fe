// Choices that are visible in pictures:
// - Lights do not cast shadows and do not hide each other here. Rays of traced lobes see the nearest one.
// - Shadows pass what materials let pass straight on (passing_shadows.h).
// - Ambient occlusion is the visibility of dome lights.
// - Rough lobes meet lights that are meshes by light sampling only; traced ones meet their triangles, which shade()
//   makes emit, whatever the light's diffuse and specular multipliers and links say.
#include "core/shade/shade.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <optional>

#include "core/scene/random.h"
#include "core/shade/light_choice.h"
#include "core/shade/lights.h"
#include "core/shade/passing_shadows.h"
#include "core/shade/shadow_rays.h"
#include "core/shade/vertex_inputs.h"
#include "core/trace/pattern_points.h"

namespace encore {
namespace {

// Shading normals lean towards the viewer until its cosine is at least this.
constexpr float kMinViewCosine = 1e-3f;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// Of the rays that may wait for evaluation at the same time, at about 150 bytes each.
constexpr uint64_t kMostPassingRays = 1 << 19;

// Rules must outlive the rays that they are for.
const ShadowRule kPlainShadow;

// What is the same for every vertex of a call.
struct Frame {
  const ShadeContext& context;
  const VertexInputs& inputs;
  std::vector<uint8_t> view_weight_in_shading;  // per material
  std::vector<uint8_t> has_normal;              // per material: its network says where the normal points

  Frame(const ShadeContext& c, const VertexInputs& i)
      : context(c), inputs(i), view_weight_in_shading(viewWeightsInShading(c.scene, c.settings)) {
    for (size_t m = 0; m < c.scene.materials.size(); ++m)
      has_normal.push_back(!c.patterns.normalTexcoord(int32_t(m)).empty());
  }
};

// The points of one vertex on one light: consecutive samples of a pixel continue one sequence, so that they
// stratify together however few each takes.
class Points {
 public:
  Points(const PathVertex& vertex, RandomUse use, uint32_t index, uint32_t count, uint32_t seed)
      : Points(vertex.sample * count, pcg4d(vertex.pixel, index, uint32_t(use), seed)) {}
  Vec2f point(uint32_t i) const { return points_.point(first_ + i); }
  float third(uint32_t i) const { return third_.point(first_ + i).x; }

 private:
  Points(uint32_t first, const std::array<uint32_t, 4>& keys) : first_(first), points_(keys[0]), third_(keys[1]) {}

  uint32_t first_;
  Sobol2 points_, third_;
};

// n: on the outside.
Vec3f facingNormal(const SurfacePoint& point, Vec3f outside, Vec3f wo) {
  const Vec3f n = point.side == 0 ? outside : -outside;
  const float c = dot(n, wo);
  return c >= kMinViewCosine ? n : normalize(n + wo * (kMinViewCosine - c));
}

// What a thread keeps from vertex to vertex.
struct Scratch {
  LightChoice choice;
  std::vector<std::optional<LightSampler>> samplers;

  explicit Scratch(const ShadeContext& context)
      : choice(context.lights, context.settings), samplers(context.lights.lights().size()) {}
};

// One vertex: all of its rays, in a fixed order.
class VertexShading {
 public:
  VertexShading(const Frame& frame, const PathVertex& vertex, uint32_t index, const SurfacePoint& point,
                Scratch& scratch, ShadowRays& rays)
      : frame_(frame),
        lights_(frame.context.lights.lights()),
        vertex_(vertex),
        index_(index),
        point_(point),
        normal_(facingNormal(point, outsideNormal(), -vertex.direction)),
        view_(makeView()),
        scratch_(scratch),
        rays_(rays) {
    rays_.startVertex(point, index, vertex.hit.time);
    std::fill(scratch.samplers.begin(), scratch.samplers.end(), std::nullopt);
  }

  void addLights() {
    if (lights_.empty()) return;
    const ShadeContext& context = frame_.context;
    float u = 0;
    if (context.lights.chooses()) u = Points(vertex_, RandomUse::Light, ~0u, 1, context.settings.seed).point(0).x;
    choice_ = scratch_.choice.choose(point_.position, normal_, context.trace.linkGroup(vertex_.hit), u);
    for (uint32_t k = 0; k < lights_.size(); ++k) {
      if (choice_[k].count == 0) continue;
      if (lights_[k].delta) {
        addDelta(lights_[k]);
      } else {
        addArea(k);
      }
    }
    if (view_.hasRoughLobe()) addRoughLobe();
  }

 private:
  Vec3f outsideNormal() const {
    if (!frame_.has_normal[size_t(point_.material)]) return point_.ns;
    const ShadeContext& context = frame_.context;
    const Vec3f normal = frame_.inputs.path(index_, point_.material).normal;
    if (normal == Vec3f{0, 0, 1}) return point_.ns;
    return mappedNormal(context.trace, vertex_.hit, point_, context.patterns.normalTexcoord(point_.material), normal);
  }

  ShadedView makeView() const {
    const ShadeContext& context = frame_.context;
    const Material& material = context.scene.materials[size_t(point_.material)];
    const Lobes lobes = makeLobes(material, frame_.inputs.path(index_, point_.material),
                                  {point_.side == 1, point_.thin, 1}, context.settings);
    return {lobes, frame_.inputs.shading(index_, point_.material).diffuse_color, normal_, -vertex_.direction,
            frame_.view_weight_in_shading[size_t(point_.material)] != 0};
  }

  // Prepared when it is first needed.
  const LightSampler& sampler(uint32_t k) {
    std::optional<LightSampler>& sampler = scratch_.samplers[k];
    if (!sampler) {
      LightParts parts = lights_[k].parts;
      parts.time = vertex_.hit.time;
      sampler.emplace(*lights_[k].light, point_.position, normal_, parts);
    }
    return *sampler;
  }

  void addDelta(const PreparedLight& prepared) {
    const Light& light = *prepared.light;
    const ShadedResponse response = view_.evaluate(-light.direction, true);
    rays_.add(-light.direction, kInfinity,
              (response.diffuse * light.diffuse + response.specular * light.specular) * light.radiance,
              prepared.shadow);
  }

  // Balance heuristic: a specular contribution is divided by the density of all samples that could make it.
  float specularDensity(uint32_t k, float light_pdf, float lobe_pdf) const {
    const float by_lobe =
        lights_[k].light->kind == Light::Kind::Mesh ? 0 : float(frame_.context.settings.light_samples) * lobe_pdf;
    return choice_[k].expected * light_pdf + by_lobe;
  }

  void addArea(uint32_t k) {
    const PreparedLight& prepared = lights_[k];
    const Light& light = *prepared.light;
    const LightRays& rays = choice_[k];
    const bool dome = light.kind == Light::Kind::Dome, even_dome = dome && !prepared.parts.image;
    const Points points(vertex_, dome ? RandomUse::Occlusion : RandomUse::Light, k, rays.stride,
                        frame_.context.settings.seed);
    for (uint32_t i = 0; i < rays.count; ++i) {
      const LightSample sample = sampler(k).sample(points.point(rays.first + i));
      if (!sample.valid || !(sample.pdf > 0)) continue;
      ShadedResponse response;
      if (!even_dome || view_.hasRoughLobe()) response = view_.evaluate(sample.direction, false);
      // Under a dome cosines and densities cancel: without occlusion there is no noise.
      Vec3f factor = even_dome ? view_.diffuse() * (light.diffuse / float(rays.count))
                               : response.diffuse * (light.diffuse / (rays.expected * sample.pdf));
      if (response.specular != Vec3f{})
        factor +=
            response.specular * (light.specular / specularDensity(k, sample.pdf, view_.pdfRoughLobe(sample.direction)));
      rays_.add(sample.direction, sample.distance, factor * sample.radiance, prepared.shadow);
    }
  }

  void addRoughLobe() {
    const uint32_t count = frame_.context.settings.light_samples;
    const Points points(vertex_, RandomUse::Lobe, uint32_t(lights_.size()), count, frame_.context.settings.seed);
    for (uint32_t i = 0; i < count; ++i) {
      const Vec2f u = points.point(i);
      const float u3[3] = {u.x, u.y, points.third(i)};
      const Vec3f direction = view_.sampleRoughLobe(u3);
      const float pdf = view_.pdfRoughLobe(direction);
      if (pdf > 0) addLobeSample(direction, pdf);
    }
  }

  // Each light that the direction meets, as lights do not hide each other; those at infinity share a ray where their
  // shadows are alike.
  void addLobeSample(Vec3f direction, float lobe_pdf) {
    const Vec3f response = view_.evaluate(direction, false).specular;
    Vec3f infinite;
    for (uint32_t k = 0; k < lights_.size(); ++k) {
      const PreparedLight& prepared = lights_[k];
      if (!(choice_[k].expected > 0) || prepared.delta || !prepared.mayMeet(point_.position, direction)) continue;
      const Light& light = *prepared.light;
      const LightPoint met = meetLight(light, point_.position, direction);
      if (met.distance < 0) continue;
      const Vec3f contribution = response * lightRadiance(light, prepared.parts.image, met, direction) *
                                 (light.specular / specularDensity(k, sampler(k).pdf(direction), lobe_pdf));
      if (std::isinf(met.distance) && prepared.shadow.plain()) {
        infinite += contribution;
      } else {
        rays_.add(direction, met.distance, contribution, prepared.shadow);
      }
    }
    rays_.add(direction, kInfinity, infinite, kPlainShadow);
  }

  const Frame& frame_;
  const std::span<const PreparedLight> lights_;
  const PathVertex& vertex_;
  const uint32_t index_;
  const SurfacePoint& point_;
  const Vec3f normal_;
  const ShadedView view_;
  Scratch& scratch_;
  ShadowRays& rays_;
  std::span<const LightRays> choice_;
};

// Emission of the material: the same on both sides, never attenuated. Of a mesh that is a light: outside.
Vec3f emission(const Frame& frame, const PathVertex& vertex, uint32_t index, const SurfacePoint& point) {
  Vec3f e = frame.inputs.shading(index, point.material).emissive_color;
  e = isFinite(e) ? Vec3f{std::max(e.x, 0.0f), std::max(e.y, 0.0f), std::max(e.z, 0.0f)} : Vec3f{};
  const LightSet& lights = frame.context.lights;
  if (lights.anyMesh() && point.side == 0) e += lights.meshRadiance(vertex.hit.instance, -vertex.direction);
  return e;
}

// One call of shade().
class Shade {
 public:
  Shade(const ShadeContext& context, std::span<const PathVertex> vertices, std::span<const uint32_t> ends,
        std::span<Vec3f> radiance)
      : context_(context),
        vertices_(vertices),
        ends_(ends),
        radiance_(radiance),
        inputs_(context, vertices),
        frame_(context, inputs_) {}

  // Every ray is answered within its block.
  void run() {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, ends_.size(), 1), [&](const tbb::blocked_range<size_t>& blocks) {
      const FlushDenormals flush;
      Scratch scratch(context_);
      for (size_t block = blocks.begin(); block != blocks.end(); ++block) shadeBlock(block, scratch, nullptr);
    });
    clean();
  }

  // Some rays wait until surfaces that they passed are evaluated: a few blocks at a time, so that memory is bounded.
  void runPassing() {
    const Passages passages(context_);
    splitBlocks();
    for (size_t first = 0, last; first < ends_.size(); first = last) {
      for (last = first + 1; last < ends_.size() && raysOf(first, last + 1) <= kMostPassingRays;) ++last;
      std::vector<PassingShadows> passing(last - first, PassingShadows(passages, vertices_, radiance_));
      tbb::parallel_for(first, last, [&](size_t block) {
        const FlushDenormals flush;
        Scratch scratch(context_);
        shadeBlock(block, scratch, &passing[block - first]);
      });
      finishShadows(passages, passing);
      for (const PassingShadows& p : passing) context_.rays_traced += p.traced();
    }
    clean();
  }

 private:
  // Cuts blocks of many vertices, by a size that only the settings and lights decide, so that some are in work at
  // once and what waits stays bounded.
  void splitBlocks() {
    const uint64_t rays = std::max<uint64_t>(1, context_.lights.raysPerShade() + context_.settings.light_samples);
    const uint32_t most = uint32_t(std::max<uint64_t>(64, kMostPassingRays / 16 / rays));
    uint32_t i = 0;
    for (const uint32_t end : ends_) do {
        i = end - i > most ? i + most : end;
        parts_.push_back(i);
      } while (i < end);
    ends_ = parts_;
  }

  uint32_t begin(size_t block) const { return block == 0 ? 0 : ends_[block - 1]; }
  // Rays of the blocks from first to before last, at most.
  uint64_t raysOf(size_t first, size_t last) const {
    return (context_.lights.raysPerShade() + context_.settings.light_samples) * (ends_[last - 1] - begin(first));
  }

  void shadeBlock(size_t block, Scratch& scratch, PassingShadows* passing) {
    ShadowRays rays(context_.trace, radiance_, passing);
    for (uint32_t i = begin(block); i < ends_[block]; ++i) {
      const SurfacePoint point = context_.trace.surface(vertices_[i].hit, vertices_[i].direction);
      radiance_[i] = emission(frame_, vertices_[i], i, point);
      VertexShading(frame_, vertices_[i], i, point, scratch, rays).addLights();
    }
    rays.endBlock();
    context_.rays_traced += rays.traced();
  }

  // Sums of finite contributions may overflow.
  void clean() {
    for (Vec3f& r : radiance_)
      if (!isFinite(r)) r = {};
  }

  const ShadeContext& context_;
  std::span<const PathVertex> vertices_;
  std::span<const uint32_t> ends_;
  std::vector<uint32_t> parts_;  // of blocks, where ends_ refers to them
  std::span<Vec3f> radiance_;
  const VertexInputs inputs_;
  const Frame frame_;
};

}  // namespace

std::vector<uint8_t> viewWeightsInShading(const Scene& scene, const Settings& settings) {
  const bool delta = anyDelta(scene.lights);
  std::vector<uint8_t> weights;
  for (const Material& material : scene.materials)
    weights.push_back(viewWeightInShading(material, settings.roughness_limit, delta));
  for (const Light& light : scene.lights) {
    if (light.kind != Light::Kind::Mesh || light.instance < 0) continue;
    const Instance& instance = scene.instances[size_t(light.instance)];
    if (instance.material >= 0) {
      weights[size_t(instance.material)] = 1;
      continue;
    }
    for (const uint32_t m : scene.prototypes[instance.prototype].meshes) {
      const Mesh& mesh = scene.meshes[m];
      weights[size_t(mesh.material)] = 1;
      for (const int32_t material : mesh.face_materials)
        if (material >= 0) weights[size_t(material)] = 1;
    }
  }
  return weights;
}

void shade(const ShadeContext& context, std::span<const PathVertex> vertices, std::span<const uint32_t> ends,
           std::span<Vec3f> radiance) {
  Shade call(context, vertices, ends, radiance);
  if (anyPassingShadows(context.lights, context.trace)) {
    call.runPassing();
  } else {
    call.run();
  }
}

}  // namespace encore
