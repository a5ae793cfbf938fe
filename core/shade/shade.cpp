// Choices that are visible in pictures:
// - Lights do not cast shadows and do not hide each other here. Rays of traced lobes see the nearest one.
// - Everything with a surface blocks shadow rays, glass too.
// - Ambient occlusion is the visibility of dome lights.
#include "core/shade/shade.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/scene/random.h"
#include "core/shade/lights.h"
#include "core/shade/shadow_rays.h"
#include "core/shade/vertex_inputs.h"

namespace encore {
namespace {

// Shading normals lean towards the viewer until its cosine is at least this.
constexpr float kMinViewCosine = 1e-3f;

// What is the same for every vertex of a call.
struct Frame {
  const ShadeContext& context;
  const VertexInputs& inputs;
  std::vector<uint8_t> view_weight_in_shading;  // per material

  Frame(const ShadeContext& c, const VertexInputs& i) : context(c), inputs(i) {
    const bool delta = anyDelta(c.scene.lights);
    for (const Material& material : c.scene.materials)
      view_weight_in_shading.push_back(viewWeightInShading(material, c.settings.roughness_limit, delta));
  }
  uint32_t raysTo(const Light& light) const {
    if (isDelta(light)) return 1;
    return light.kind == Light::Kind::Dome ? context.settings.occlusion_samples : context.settings.light_samples;
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

Vec3f facingNormal(const SurfacePoint& point, Vec3f wo) {
  const Vec3f n = point.side == 0 ? point.ns : -point.ns;
  const float c = dot(n, wo);
  return c >= kMinViewCosine ? n : normalize(n + wo * (kMinViewCosine - c));
}

// One vertex: all of its rays, in a fixed order.
class VertexShading {
 public:
  VertexShading(const Frame& frame, const PathVertex& vertex, uint32_t index, const SurfacePoint& point,
                std::vector<LightSampler>& samplers, ShadowRays& rays)
      : frame_(frame),
        vertex_(vertex),
        index_(index),
        point_(point),
        normal_(facingNormal(point, -vertex.direction)),
        view_(makeView()),
        samplers_(samplers),
        rays_(rays) {
    rays_.startVertex(point, index);
    samplers_.clear();
    for (const Light& light : frame.context.scene.lights) samplers_.emplace_back(light, point.position, normal_);
  }

  void addLights() {
    for (uint32_t k = 0; k < samplers_.size(); ++k) {
      const Light& light = samplers_[k].light();
      if (isDelta(light)) {
        addDelta(light);
      } else {
        addArea(k);
      }
    }
    if (view_.hasRoughLobe()) addRoughLobe();
  }

 private:
  ShadedView makeView() const {
    const ShadeContext& context = frame_.context;
    const Material& material = context.scene.materials[size_t(point_.material)];
    const Lobes lobes = makeLobes(material, frame_.inputs.path(index_, point_.material), point_.side == 1,
                                  context.settings.roughness_limit);
    return {lobes, frame_.inputs.shading(index_, point_.material).diffuse_color, normal_, -vertex_.direction,
            frame_.view_weight_in_shading[size_t(point_.material)] != 0};
  }

  void addDelta(const Light& light) {
    const ShadedResponse response = view_.evaluate(-light.direction, true);
    rays_.add(-light.direction, std::numeric_limits<float>::infinity(),
              (response.diffuse * light.diffuse + response.specular * light.specular) * light.radiance);
  }

  // Balance heuristic: a specular contribution is divided by the density of all samples that could make it.
  float specularDensity(const Light& light, float light_pdf, float lobe_pdf) const {
    return float(frame_.raysTo(light)) * light_pdf + float(frame_.context.settings.light_samples) * lobe_pdf;
  }

  void addArea(uint32_t k) {
    const Light& light = samplers_[k].light();
    const uint32_t count = frame_.raysTo(light);
    const bool dome = light.kind == Light::Kind::Dome;
    const Points points(vertex_, dome ? RandomUse::Occlusion : RandomUse::Light, k, count,
                        frame_.context.settings.seed);
    for (uint32_t i = 0; i < count; ++i) {
      const LightSample sample = samplers_[k].sample(points.point(i));
      if (!sample.valid) continue;
      ShadedResponse response;
      if (!dome || view_.hasRoughLobe()) response = view_.evaluate(sample.direction, false);
      // Under a dome cosines and densities cancel: without occlusion there is no noise.
      Vec3f factor = dome ? view_.diffuse() * (light.diffuse / float(count))
                          : response.diffuse * (light.diffuse / (float(count) * sample.pdf));
      if (response.specular != Vec3f{})
        factor += response.specular *
                  (light.specular / specularDensity(light, sample.pdf, view_.pdfRoughLobe(sample.direction)));
      rays_.add(sample.direction, sample.distance, factor * sample.radiance);
    }
  }

  void addRoughLobe() {
    const uint32_t count = frame_.context.settings.light_samples;
    const Points points(vertex_, RandomUse::Lobe, uint32_t(samplers_.size()), count, frame_.context.settings.seed);
    for (uint32_t i = 0; i < count; ++i) {
      const Vec2f u = points.point(i);
      const float u3[3] = {u.x, u.y, points.third(i)};
      const Vec3f direction = view_.sampleRoughLobe(u3);
      const float pdf = view_.pdfRoughLobe(direction);
      if (pdf > 0) addLobeSample(direction, pdf);
    }
  }

  // Each light that the direction meets, as lights do not hide each other; those at infinity share a ray.
  void addLobeSample(Vec3f direction, float lobe_pdf) {
    const Vec3f response = view_.evaluate(direction, false).specular;
    Vec3f infinite;
    for (const LightSampler& sampler : samplers_) {
      const Light& light = sampler.light();
      const float distance = intersectLight(light, point_.position, direction);
      if (distance < 0) continue;
      const Vec3f contribution =
          response * light.radiance * (light.specular / specularDensity(light, sampler.pdf(direction), lobe_pdf));
      if (std::isinf(distance)) {
        infinite += contribution;
      } else {
        rays_.add(direction, distance, contribution);
      }
    }
    rays_.add(direction, std::numeric_limits<float>::infinity(), infinite);
  }

  const Frame& frame_;
  const PathVertex& vertex_;
  const uint32_t index_;
  const SurfacePoint& point_;
  const Vec3f normal_;
  const ShadedView view_;
  std::vector<LightSampler>& samplers_;
  ShadowRays& rays_;
};

// Emission: the same on both sides, never attenuated.
Vec3f emission(const Frame& frame, uint32_t index, int32_t material) {
  const Vec3f e = frame.inputs.shading(index, material).emissive_color;
  return isFinite(e) ? Vec3f{std::max(e.x, 0.0f), std::max(e.y, 0.0f), std::max(e.z, 0.0f)} : Vec3f{};
}

}  // namespace

void shade(const ShadeContext& context, std::span<const PathVertex> vertices, std::span<const uint32_t> ends,
           std::span<Vec3f> radiance) {
  const VertexInputs inputs(context, vertices);
  const Frame frame(context, inputs);
  tbb::parallel_for(tbb::blocked_range<size_t>(0, ends.size(), 1), [&](const tbb::blocked_range<size_t>& blocks) {
    const FlushDenormals flush;
    ShadowRays rays(context.trace, radiance);
    std::vector<LightSampler> samplers;
    for (size_t block = blocks.begin(); block != blocks.end(); ++block) {
      const uint32_t begin = block == 0 ? 0 : ends[block - 1];
      for (uint32_t i = begin; i < ends[block]; ++i) {
        const SurfacePoint point = context.trace.surface(vertices[i].hit, vertices[i].direction);
        radiance[i] = emission(frame, i, point.material);
        VertexShading(frame, vertices[i], i, point, samplers, rays).addLights();
      }
      rays.endBlock();
      for (uint32_t i = begin; i < ends[block]; ++i)
        if (!isFinite(radiance[i])) radiance[i] = {};
    }
    context.rays_traced += rays.traced();
  });
}

}  // namespace encore
