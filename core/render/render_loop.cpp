// Reads like Listing 3 of the paper. Where it leaves the listing as printed:
//  - Buckets (here reuse tiles, §3.1) are outside of layers: first hits are traced once for all layers.
//  - Failures are served within their batch: a group lies within one pixel, hence within one block.
//  - Followers copy from the head of their run, not from their neighbour while it is being written.
//  - A failed sample is splatted once, with its batch, from its own slot.
#include "core/render/render_loop.h"

#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <limits>
#include <optional>

#include "core/dice/dice.h"
#include "core/pattern/patterns.h"
#include "core/render/memory_plan.h"
#include "core/render/samples.h"
#include "core/reuse/reuse.h"
#include "core/scene/error.h"
#include "core/shade/lights.h"
#include "core/trace/trace_scene.h"

namespace encore {
namespace {

// Adds the time until the end of its scope.
class StageTimer {
 public:
  explicit StageTimer(double& seconds) : seconds_(seconds) {}
  ~StageTimer() { seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  double& seconds_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// Moves the scene to the camera's origin, and back. Copies what moves, which is small beside meshes.
class Rebased {
 public:
  explicit Rebased(Scene& scene)
      : scene_(scene), instances_(scene.instances), lights_(scene.lights), camera_(scene.camera) {
    rebase(scene, scene.camera.to_world.origin);
  }
  ~Rebased() {
    scene_.instances = std::move(instances_);
    scene_.lights = std::move(lights_);
    scene_.camera = std::move(camera_);
  }
  Rebased(const Rebased&) = delete;
  Rebased& operator=(const Rebased&) = delete;

 private:
  Scene& scene_;
  std::vector<Instance> instances_;
  std::vector<Light> lights_;
  Camera camera_;
};

using TreesPointer = std::unique_ptr<Trees, void (*)(Trees*)>;

// What the seeds of one layer of one reuse tile leave behind.
struct LayerShading {
  ShadingSamples samples;
  Buffer<Vec3f> radiance;  // of the seeds; behind them, of the failures of the batch in flight
  TreesPointer trees{nullptr, nullptr};
};

// Just short of infinity, where domes and distant lights would count.
constexpr float kBeyondLights = std::numeric_limits<float>::max();

// Share of a tile's progress that its shading rays count for: about half of the time where shading dominates.
constexpr double kSeedShare = 0.5;

uint64_t peakProcessBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return uint64_t(usage.ru_maxrss) * 1024;
}

class FrameRenderer {
 public:
  FrameRenderer(const Scene& scene, const Settings& settings, Device& device, const Progress& progress)
      : scene_(scene), settings_(settings), device_(device), progress_(progress) {}

  Frame render() {
    StageTimer timer(statistics_.time_s["total"]);
    prepare();
    const std::vector<ReuseTile> tiles = reuseTiles(settings_);
    for (const ReuseTile& tile : tiles) total_blocks_ += tile.blocks.size();
    for (const ReuseTile& tile : tiles) renderTile(tile);
    Frame frame;
    frame.layers = layers_;
    {
      StageTimer film_timer(statistics_.time_s["film"]);
      frame.images = film_->resolve();
    }
    finishStatistics();
    frame.statistics = std::move(statistics_);
    return frame;
  }

 private:
  void prepare() {
    report(0, "dice");
    {
      StageTimer timer(statistics_.time_s["dice"]);
      diced_ = diceScene(scene_, settings_);
    }
    report(0, "build");
    {
      StageTimer timer(statistics_.time_s["build"]);
      trace_.emplace(scene_, diced_);
      patterns_.emplace(device_, scene_);
    }
    layers_ = sceneLayers(scene_, settings_);
    camera_.emplace(scene_.camera, settings_);
    kernels_.emplace(device_);
    const uint64_t budget = settings_.memory_budget_bytes
                                ? settings_.memory_budget_bytes
                                : defaultMemoryBudget(device_.info().cpu, device_.info().memory_bytes);
    plan_ = planMemory(settings_, uint32_t(layers_.size()), budget);
    const uint32_t per_pixel = settings_.samples * settings_.samples;
    film_.emplace(device_, settings_.width, settings_.height, settings_.filter, settings_.filter_radius_pixels,
                  uint32_t(layers_.size()), per_pixel);
    shading_.resize(layers_.size());
    context_.emplace(ShadeContext{scene_, settings_, *trace_, *patterns_, rays_traced_});
    aa_.samples_per_pixel = per_pixel;
    reserveBatch(size_t(plan_.blocks_per_batch) * kBlockArea * per_pixel);
  }

  void reserveBatch(size_t slots) {
    aa_.key.reserve(device_, slots, "aa key");
    aa_.uv.reserve(device_, slots, "aa uv");
    aa_.throughput.reserve(device_, slots, "aa throughput");
    aa_.shade.reserve(device_, slots, "aa shade");
    film_samples_.position.reserve(device_, slots, "film position");
    film_samples_.coverage.reserve(device_, slots, "film coverage");
    film_samples_.normal.reserve(device_, slots, "film normal");
    vertices_.resize(slots);
  }

  void renderTile(const ReuseTile& tile) {
    // Generate and shade seeding rays (Listing 3, lines 3-7); first hits are shared by the layers.
    BlockRays seeds;
    if (settings_.method == Method::Reuse) {
      seeds = generateShadingRays(settings_, tile.blocks);
      StageTimer timer(statistics_.time_s["trace"]);
      traceFirstHits(*context_, *camera_, seeds.first, seeds.ends);
    }
    for (size_t layer = 0; layer < layers_.size(); ++layer) {
      shadeSeeds(layer, seeds);
      reportTile(tile, kSeedShare * double(layer + 1) / double(layers_.size()));
    }
    seeds = {};

    // Trace antialiasing rays and reuse shading (lines 8-18), in batches of whole blocks.
    for (size_t b = 0; b < tile.blocks.size(); b += plan_.blocks_per_batch) {
      const size_t count = std::min<size_t>(plan_.blocks_per_batch, tile.blocks.size() - b);
      renderBatch(std::span(tile.blocks).subspan(b, count));
      reportTile(tile, kSeedShare + (1 - kSeedShare) * double(b + count) / double(tile.blocks.size()));
    }
    finished_blocks_ += tile.blocks.size();
  }

  // Lines 5-7 of Listing 3: paths of one layer, their shading, and the trees over it.
  void shadeSeeds(size_t layer, const BlockRays& seeds) {
    LayerStatistics& layer_statistics = statistics_.layers[layerName(layers_[layer])];
    std::vector<PathVertex> vertices(seeds.first.size());
    std::vector<uint32_t> ends;
    {
      StageTimer timer(layer_statistics.trace_s);
      tracePaths(*context_, *camera_, layers_[layer], seeds.first, seeds.ends, vertices);
      ends = keepSurfaceHits(vertices, seeds.ends);
    }
    std::vector<Vec3f> radiance(vertices.size());
    {
      StageTimer timer(layer_statistics.shade_s);
      shade(*context_, vertices, ends, radiance);
    }
    StageTimer timer(layer_statistics.reuse_s);
    LayerShading& shading = shading_[layer];
    storeSeeds(shading, vertices, radiance);
    shading.trees = kernels_->buildTrees(shading.samples);
    layer_statistics.shading_evaluations += vertices.size();
  }

  // Drops paths that ended on nothing; returns the blocks' new ends.
  static std::vector<uint32_t> keepSurfaceHits(std::vector<PathVertex>& vertices, std::span<const uint32_t> ends) {
    std::vector<uint32_t> kept_ends;
    size_t kept = 0, i = 0;
    for (const uint32_t end : ends) {
      for (; i < end; ++i)
        if (vertices[i].hit.valid()) vertices[kept++] = vertices[i];
      kept_ends.push_back(uint32_t(kept));
    }
    vertices.resize(kept);
    return kept_ends;
  }

  void storeSeeds(LayerShading& shading, std::span<const PathVertex> vertices, std::span<const Vec3f> radiance) {
    const size_t count = vertices.size();
    ShadingSamples& samples = shading.samples;
    samples.count = uint32_t(count);
    samples.key.reserve(device_, count, "seed key");
    samples.uv.reserve(device_, count, "seed uv");
    shading.radiance.reserve(device_, count + aa_.key.size(), "radiance");
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
      samples.key.host()[i] = vertices[i].key;
      samples.uv.host()[i] = vertices[i].uv;
      shading.radiance.host()[i] = radiance[i];
    });
    samples.key.toDevice(0, count);
    samples.uv.toDevice(0, count);
    shading.radiance.toDevice(0, count);
  }

  void renderBatch(std::span<const BlockOrigin> blocks) {
    BlockRays rays;
    {
      StageTimer timer(statistics_.time_s["trace"]);
      rays = generateAntialiasRays(settings_, blocks, film_samples_.position.host());
      traceFirstHits(*context_, *camera_, rays.first, rays.ends);
    }
    {
      StageTimer timer(statistics_.time_s["film"]);
      addShared(blocks, rays);
    }
    aa_.count = uint32_t(rays.first.size());
    for (size_t layer = 0; layer < layers_.size(); ++layer) renderLayer(layer, blocks, rays);
  }

  // Position, alpha, normal and depth: the same in every layer.
  void addShared(std::span<const BlockOrigin> blocks, const BlockRays& rays) {
    const size_t count = rays.first.size(), per_pixel = aa_.samples_per_pixel;
    tbb::parallel_for(size_t{0}, count / per_pixel, [&](size_t pixel) {
      for (size_t i = pixel * per_pixel; i < (pixel + 1) * per_pixel; ++i) {
        const FirstHit& first = rays.first[i];
        film_samples_.coverage.host()[i] = covers(first) ? 1.0f : 0.0f;
        Vec3f normal{};
        if (first.hit.valid()) {
          const SurfacePoint point = trace_->surface(first.hit, first.direction, false);
          normal = point.side ? -point.ns : point.ns;
        }
        film_samples_.normal.host()[i] = normal;
      }
    });
    for (const FirstHit& first : rays.first)
      if (first.hit.valid())
        film_->addDepth(uint32_t(first.film_x), uint32_t(first.film_y),
                        camera_->depth(first.origin + first.direction * first.hit.t));
    film_samples_.position.toDevice(0, count);
    film_samples_.coverage.toDevice(0, count);
    film_samples_.normal.toDevice(0, count);
    film_->addShared(blocks, film_samples_);
  }

  // Alpha of a sample: surfaces, and lights where the camera may see them.
  bool covers(const FirstHit& first) const {
    if (!first.active || first.hit.valid()) return first.active;
    if (settings_.dome_light_visible) return true;
    if (!settings_.lights_visible) return false;
    const LightHit light = intersectLights(scene_.lights, first.origin, first.direction, kBeyondLights);
    return light.valid;
  }

  void renderLayer(size_t layer, std::span<const BlockOrigin> blocks, const BlockRays& rays) {
    LayerStatistics& layer_statistics = statistics_.layers[layerName(layers_[layer])];
    LayerShading& shading = shading_[layer];
    const std::span<PathVertex> vertices = std::span(vertices_).first(rays.first.size());
    {
      StageTimer timer(layer_statistics.trace_s);
      tracePaths(*context_, *camera_, layers_[layer], rays.first, rays.ends, vertices);
    }
    std::vector<uint32_t> heads;
    {
      StageTimer timer(layer_statistics.reuse_s);
      layer_statistics.antialiasing_samples += storeSamples(vertices);
      kernels_->findNearest(*shading.trees, aa_);
      layer_statistics.failed_samples += countFailures();
      // Lines 19-35: sort failures, shade the heads, give followers their head's shading.
      heads = kernels_->serveFailures(aa_, shading.samples.count, settings_.method == Method::Reuse);
    }
    {
      StageTimer timer(layer_statistics.shade_s);
      shadeHeads(shading, vertices, heads, uint32_t(rays.first.size() / blocks.size()));
    }
    layer_statistics.shading_evaluations += heads.size();
    layer_statistics.reshading_evaluations += settings_.method == Method::Reuse ? heads.size() : 0;
    // Lines 36-39: splat, once, failures and all.
    StageTimer timer(layer_statistics.film_s);
    film_->addLayer(uint32_t(layer), blocks, film_samples_, aa_, shading.radiance);
  }

  // Returns the number of samples that lie on a surface.
  uint64_t storeSamples(std::span<const PathVertex> vertices) {
    std::atomic<uint64_t> on_surface{0};
    tbb::parallel_for(tbb::blocked_range<size_t>(0, vertices.size(), 1024), [&](const auto& range) {
      uint64_t valid = 0;
      for (size_t i = range.begin(); i < range.end(); ++i) {
        const PathVertex& vertex = vertices[i];
        valid += vertex.hit.valid();
        aa_.key.host()[i] = vertex.key;
        aa_.uv.host()[i] = vertex.uv;
        aa_.throughput.host()[i] = vertex.throughput;
      }
      on_surface += valid;
    });
    aa_.key.toDevice(0, vertices.size());
    aa_.uv.toDevice(0, vertices.size());
    aa_.throughput.toDevice(0, vertices.size());
    return on_surface;
  }

  uint64_t countFailures() {
    aa_.shade.toHost(0, aa_.count);
    const auto shade_index = aa_.shade.host().first(aa_.count);
    return uint64_t(std::count(shade_index.begin(), shade_index.end(), kShadeNotFound));
  }

  // heads: ascending slots, so that those of a block stand together.
  void shadeHeads(LayerShading& shading, std::span<const PathVertex> vertices, std::span<const uint32_t> heads,
                  uint32_t slots_per_block) {
    if (heads.empty()) return;
    std::vector<PathVertex> head_vertices;
    std::vector<uint32_t> ends;
    head_vertices.reserve(heads.size());
    for (const uint32_t slot : heads) {
      while (ends.size() < slot / slots_per_block) ends.push_back(uint32_t(head_vertices.size()));
      head_vertices.push_back(vertices[slot]);
    }
    ends.push_back(uint32_t(head_vertices.size()));
    const size_t first = shading.samples.count;
    shade(*context_, head_vertices, ends, shading.radiance.host().subspan(first, heads.size()));
    shading.radiance.toDevice(first, heads.size());
  }

  void finishStatistics() {
    Statistics& s = statistics_;
    s.device = device_.info().name;
    s.driver = device_.info().driver;
    s.primitives = trace_->primitiveCount();
    s.micropolygons = trace_->micropolygonCount();
    s.pixels = uint64_t(settings_.width) * settings_.height;
    s.antialiasing_samples = s.pixels * settings_.samples * settings_.samples;
    s.rays_traced = rays_traced_;
    s.non_finite_samples = film_->nonFiniteSamples();
    s.peak_memory_bytes = peakProcessBytes();
    s.device_peak_bytes = device_.peakAllocatedBytes();
    s.geometry_bytes = trace_->memoryBytes();
    s.texture_bytes = patterns_->textureBytes();
    s.kernels = device_.timings();
    for (const auto& [name, layer] : s.layers) {
      s.time_s["trace"] += layer.trace_s;
      s.time_s["shade"] += layer.shade_s;
      s.time_s["reuse"] += layer.reuse_s;
      s.time_s["film"] += layer.film_s;
    }
    if (s.non_finite_samples) s.warnings["samples that were not finite count as black"] = s.non_finite_samples;
    const std::vector<uint32_t> untraceable = trace_->untraceable();
    if (!untraceable.empty())
      s.warnings["instances are too small to be traced and were left out, such as " +
                 scene_.instances[untraceable.front()].path] = untraceable.size();
  }

  void reportTile(const ReuseTile& tile, double share) {
    report((double(finished_blocks_) + share * double(tile.blocks.size())) / double(total_blocks_), "render");
  }

  void report(double done, const char* stage) {
    if (progress_ && !progress_(done, stage)) throw Error(ErrorKind::Cancelled, "the render was cancelled");
  }

  const Scene& scene_;
  const Settings& settings_;
  Device& device_;
  const Progress& progress_;
  Statistics statistics_;
  std::atomic<uint64_t> rays_traced_{0};

  std::vector<DicedMesh> diced_;
  std::optional<TraceScene> trace_;
  std::optional<Patterns> patterns_;
  std::optional<CameraRays> camera_;
  std::optional<ReuseKernels> kernels_;
  std::optional<Film> film_;
  std::optional<ShadeContext> context_;
  std::vector<Layer> layers_;
  MemoryPlan plan_;

  std::vector<LayerShading> shading_;  // per layer
  AaSamples aa_;
  FilmSamples film_samples_;
  std::vector<PathVertex> vertices_;
  size_t total_blocks_ = 0, finished_blocks_ = 0;
};

}  // namespace

Frame render(Scene& scene, const Settings& settings, Device& device, const Progress& progress) {
  settings.validate();
  scene.validate();
  device.resetTimings();
  const Rebased rebased(scene);
  const int threads = settings.threads ? int(settings.threads) : tbb::this_task_arena::max_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
  tbb::task_arena arena(threads);
  Frame frame = arena.execute([&] { return FrameRenderer(scene, settings, device, progress).render(); });
  frame.statistics.threads = uint32_t(threads);
  return frame;
}

}  // namespace encore
