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
#include <optional>

#include "core/dice/dice.h"
#include "core/path/footprint.h"
#include "core/pattern/patterns.h"
#include "core/render/aov_film.h"
#include "core/render/layer_search.h"
#include "core/render/memory_plan.h"
#include "core/render/rebased.h"
#include "core/render/render_cache.h"
#include "core/render/samples.h"
#include "core/render/seeds.h"
#include "core/render/shading_rates.h"
#include "core/render/vertex_shading.h"
#include "core/render/whole_frame.h"
#include "core/reuse/reuse.h"
#include "core/scene/error.h"
#include "core/scene/text.h"
#include "core/trace/trace_scene.h"

namespace encore {
namespace {

// Share of a tile's progress that its shading rays count for: about half of the time where shading dominates.
constexpr double kSeedShare = 0.5;

uint64_t peakProcessBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return uint64_t(usage.ru_maxrss) * 1024;
}

// The camera's exposure. The composite stays the exact sum of the layers.
void expose(FilmImages& images, float scale) {
  if (scale == 1) return;
  std::fill(images.composite.begin(), images.composite.end(), Vec3f{});
  for (std::vector<Vec3f>& layer : images.layers)
    for (size_t i = 0; i < layer.size(); ++i) {
      layer[i] *= scale;
      images.composite[i] += layer[i];
    }
}

class FrameRenderer {
 public:
  FrameRenderer(const Scene& scene, const Settings& settings, Device& device, const Progress& progress,
                const TileSink& sink, const RenderCache::Use* cache)
      : scene_(scene), settings_(settings), device_(device), progress_(progress), sink_(sink), cache_(cache) {}

  Frame render() {
    StageTimer timer(statistics_.time_s["total"]);
    prepare();
    const PixelRect window = windowOf(settings_);
    WholeFrame whole(window.width(), window.height());
    const std::vector<ReuseTile> tiles = reuseTiles(settings_);
    for (const ReuseTile& tile : tiles) total_blocks_ += tile.rendered.size();
    for (const ReuseTile& tile : tiles) {
      FilmImages images = renderTile(tile);
      if (images.rect.area() == 0) continue;
      expose(images, scene_.camera.exposure_scale);
      images.rect = {images.rect.x0 - window.x0, images.rect.y0 - window.y0, images.rect.x1 - window.x0,
                     images.rect.y1 - window.y0};
      if (sink_)
        sink_(std::move(images));
      else
        whole.add(images);
    }
    Frame frame;
    frame.layers = layers_;
    frame.images = whole.take();
    finishStatistics();
    frame.statistics = std::move(statistics_);
    return frame;
  }

 private:
  void prepare() {
    report(0, "dice");
    {
      StageTimer timer(statistics_.time_s["dice"]);
      patterns_.emplace(device_, scene_, settings_, cache_ ? cache_->patterns() : nullptr);
      diced_ = diceScene(scene_, settings_, &*patterns_, cache_ ? cache_->dice() : nullptr);
    }
    report(0, "build");
    {
      StageTimer timer(statistics_.time_s["build"]);
      std::vector<uint8_t> passes;
      for (const Material& material : scene_.materials) passes.push_back(passesShadows(material, settings_));
      trace_.emplace(scene_, diced_, settings_.world_space_parameters, passes, cache_ ? cache_->trace() : nullptr);
    }
    layers_ = sceneLayers(scene_, settings_);
    rates_.emplace(scene_, settings_);
    camera_.emplace(scene_.camera, settings_, scene_.moves());
    kernels_.emplace(device_);
    search_.emplace(scene_, settings_, *trace_, *rates_, *kernels_);
    plan();
    const uint32_t per_pixel = settings_.samples * settings_.samples;
    film_.emplace(device_, filmArea(settings_), settings_.filter, settings_.filter_radius_pixels,
                  uint32_t(layers_.size()), per_pixel, settings_.debug_aovs, settings_.aovs);
    shading_.resize(layers_.size());
    context_.emplace(ShadeContext{scene_, settings_, *trace_, *patterns_, rays_traced_,
                                  LightSet(scene_, settings_, *trace_, cache_ ? cache_->lights() : nullptr)});
    seeds_.emplace(*context_, *camera_, *rates_, device_, layers_);
    if (!settings_.aovs.empty()) aovs_.emplace(*context_, *camera_, device_);
    if (settings_.method == Method::Vertex) checkVertexMethod();
    if (settings_.method == Method::Vertex) vertex_shading_.emplace(*context_, *camera_, diced_);
    aa_.samples_per_pixel = per_pixel;
    reserveBatch(size_t(plan_.blocks_per_batch) * kBlockArea * per_pixel);
  }

  // Grids are laid for one view and one pose.
  void checkVertexMethod() const {
    if (scene_.camera.projection == Camera::Projection::Perspective && !scene_.moves()) return;
    throw Error(ErrorKind::Setting, "the vertex method is for still scenes and perspective cameras", "method",
                "Choose another method, or disable motion blur");
  }

  void plan() {
    if (settings_.footprint_reuse == FootprintReuse::Octaves && scene_.instances.size() > kOctaveInstances)
      throw Error(ErrorKind::Setting, "'octaves' has room for " + text(kOctaveInstances) + " instances",
                  "footprint_reuse", "Choose metric or ignore for this scene");
    PlanInput input;
    for (const Layer layer : layers_) {
      statistics_.layers[layerName(layer)].search = search_->kindOf(layer);
      input.layers.push_back({rates_->highest(layer), search_->kindOf(layer)});
    }
    // Interiors of solids and the state of what passes a surface, twice while blocks are joined (core/path).
    if (layers_.back() == Layer::Refraction) input.path_state_bytes += 512;
    if (passesThrough(scene_)) input.path_state_bytes += 768;
    const uint64_t budget = settings_.memory_budget_bytes
                                ? settings_.memory_budget_bytes
                                : defaultMemoryBudget(device_.info().cpu, device_.info().memory_bytes);
    plan_ = planMemory(settings_, input, budget);
  }

  void reserveBatch(size_t slots) {
    aa_.key.reserve(device_, slots, "aa key");
    aa_.uv.reserve(device_, slots, "aa uv");
    aa_.throughput.reserve(device_, slots, "aa throughput");
    aa_.shade.reserve(device_, slots, "aa shade");
    if (search_->needsFootprints()) aa_.footprint.reserve(device_, slots, "aa footprint");
    if (needsAspect(settings_)) aa_.aspect.reserve(device_, slots, "aa aspect");
    if (search_->needsCells()) aa_.cell.reserve(device_, slots, "aa cell");
    film_samples_.position.reserve(device_, slots, "film position");
    film_samples_.coverage.reserve(device_, slots, "film coverage");
    film_samples_.normal.reserve(device_, slots, "film normal");
    // Without other layers, first hits are only needed by failures, which can be traced again, unless what they
    // passed on their way would have to be asked again too.
    if (layers_.size() > 1 || search_->needsFirstHits() || passesThrough(scene_) || AovFilm::needsFirstHits(settings_))
      first_.resize(slots);
    if (layers_.size() > 1) vertices_.resize(slots);
    depth_.resize(slots / aa_.samples_per_pixel);
  }

  FilmImages renderTile(const ReuseTile& tile) {
    film_->beginTile(tile.rect);
    // Generate and shade seeding rays (Listing 3, lines 3-7).
    if (settings_.method == Method::Reuse)
      seeds_->shade(tile, plan_.blocks_per_seed_batch, aa_.key.size(), shading_, *film_, statistics_,
                    [&](double share) { reportTile(tile, kSeedShare * share); });
    buildIndices();
    // Trace antialiasing rays and reuse shading (lines 8-39), in batches of whole blocks.
    for (size_t b = 0; b < tile.rendered.size(); b += plan_.blocks_per_batch) {
      const size_t count = std::min<size_t>(plan_.blocks_per_batch, tile.rendered.size() - b);
      renderBatch(std::span(tile.rendered).subspan(b, count));
      reportTile(tile, kSeedShare + (1 - kSeedShare) * double(b + count) / double(tile.rendered.size()));
    }
    finished_blocks_ += tile.rendered.size();
    StageTimer timer(statistics_.time_s["film"]);
    FilmImages images = film_->finishTile();
    if (aovs_) aovs_->finish(images);
    return images;
  }

  // Line 7 of Listing 3. Without seeds everything fails, and methods differ in what failures share.
  void buildIndices() {
    for (size_t layer = 0; layer < layers_.size(); ++layer) {
      StageTimer timer(statistics_.layers[layerName(layers_[layer])].reuse_s);
      LayerShading& shading = shading_[layer];
      const size_t count = shading.samples.count;
      shading.radiance.reserve(device_, aa_.key.size(), "radiance");
      shading.samples.key.toDevice(0, count);
      shading.samples.uv.toDevice(0, count);
      if (!shading.samples.footprint.empty()) shading.samples.footprint.toDevice(0, count);
      if (!shading.samples.aspect.empty()) shading.samples.aspect.toDevice(0, count);
      shading.radiance.toDevice(0, count);
      search_->buildIndex(layers_[layer], shading);
    }
  }

  void renderBatch(std::span<const BlockOrigin> blocks) {
    const size_t pixels = blocks.size() * kBlockArea, count = pixels * aa_.samples_per_pixel;
    aa_.count = uint32_t(count);
    for (const BlockOrigin block : blocks) antialiasing_samples_ += blockSamples(settings_, block);
    ends_.clear();
    for (size_t b = 1; b <= blocks.size(); ++b) ends_.push_back(uint32_t(b * (count / blocks.size())));
    const auto part = [&](auto& buffer) { return buffer.host().first(std::min(buffer.size(), count)); };
    {
      StageTimer timer(statistics_.time_s["trace"]);
      traceAntialiasing(*context_, *camera_, blocks, std::span(first_).first(std::min(first_.size(), count)),
                        {part(film_samples_.position), part(film_samples_.coverage), part(film_samples_.normal),
                         std::span(depth_).first(pixels)},
                        outputs());
    }
    StageTimer timer(statistics_.time_s["film"]);
    film_samples_.position.toDevice(0, count);
    film_samples_.coverage.toDevice(0, count);
    film_samples_.normal.toDevice(0, count);
    film_->addDepth(blocks, std::span(depth_).first(pixels));
    if (AovFilm::needsFirstHits(settings_))
      aovs_->addBatch(blocks, std::span(first_).first(count), film_samples_, *film_);
    timer.stop();
    for (size_t layer = 0; layer < layers_.size(); ++layer) renderLayer(layer, blocks);
  }

  // Where a layer's samples go.
  SampleOutputs outputs() {
    const size_t count = aa_.count;
    return {aa_.key.host().first(count), aa_.uv.host().first(count), aa_.throughput.host().first(count),
            aa_.footprint.host().first(std::min(count, aa_.footprint.size())),
            aa_.aspect.host().first(std::min(count, aa_.aspect.size()))};
  }

  void renderLayer(size_t layer, std::span<const BlockOrigin> blocks) {
    LayerStatistics& layer_statistics = statistics_.layers[layerName(layers_[layer])];
    LayerShading& shading = shading_[layer];
    if (vertex_shading_) {
      shadeVertices(layers_[layer], layer_statistics);
    } else if (layers_[layer] != Layer::Direct) {
      StageTimer timer(layer_statistics.trace_s);
      tracePaths(*context_, *camera_, layers_[layer], std::span(first_).first(aa_.count), ends_,
                 std::span(vertices_).first(aa_.count), outputs());
    }
    std::vector<uint32_t> heads;
    {
      StageTimer timer(layer_statistics.reuse_s);
      search(layer, blocks);
      // Lines 19-35: sort failures, shade the heads, give followers their head's shading.
      heads = kernels_->serveFailures(aa_, shading.samples.count, search_->sharing());
    }
    shadeHeads(layer, blocks, heads);
    layer_statistics.shading_evaluations += heads.size();
    layer_statistics.reshading_evaluations += settings_.method == Method::Reuse ? heads.size() : 0;
    // Lines 36-39: splat, once, failures and all.
    StageTimer timer(layer_statistics.film_s);
    if (layer == 0)
      film_->addFirstLayer(blocks, film_samples_, aa_, shading.radiance);
    else
      film_->addLayer(uint32_t(layer), blocks, film_samples_, aa_, shading.radiance);
  }

  // Method::Vertex, instead of lines 13-35: samples carry their radiance.
  void shadeVertices(Layer layer, LayerStatistics& layer_statistics) {
    StageTimer timer(layer_statistics.shade_s);
    const auto first = std::span(first_).first(aa_.count);
    vertex_shading_->shadeLayer(layer, first, ends_, aa_.throughput.host().first(aa_.count));
    std::fill_n(aa_.key.host().begin(), aa_.count, SurfaceKey{kNoInstance, 0});
    layer_statistics.antialiasing_samples +=
        uint64_t(std::count_if(first.begin(), first.end(), [](const FirstHit& f) { return f.hit.valid(); }));
  }

  // Lines 13-18: the nearest shading sample of every antialiasing sample, or its failure.
  void search(size_t layer, std::span<const BlockOrigin> blocks) {
    const size_t count = aa_.count;
    aa_.key.toDevice(0, count);
    aa_.uv.toDevice(0, count);
    aa_.throughput.toDevice(0, count);
    if (!aa_.footprint.empty()) aa_.footprint.toDevice(0, count);
    if (!aa_.aspect.empty()) aa_.aspect.toDevice(0, count);
    search_->find(shading_[layer], {layers_[layer], first_, vertices_}, aa_,
                  statistics_.layers[layerName(layers_[layer])]);
    if (settings_.debug_aovs) film_->addSearch(uint32_t(layer), blocks, aa_, shading_[layer].samples.uv);
  }

  // heads: ascending slots, so that those of a block stand together.
  void shadeHeads(size_t layer, std::span<const BlockOrigin> blocks, std::span<const uint32_t> heads) {
    if (heads.empty()) return;
    LayerShading& shading = shading_[layer];
    LayerStatistics& layer_statistics = statistics_.layers[layerName(layers_[layer])];
    const size_t slots_per_block = aa_.count / blocks.size();
    std::vector<uint32_t> ends(blocks.size());
    for (size_t b = 0; b < blocks.size(); ++b)
      ends[b] = uint32_t(std::lower_bound(heads.begin(), heads.end(), (b + 1) * slots_per_block) - heads.begin());
    std::vector<PathVertex> vertices(heads.size());
    {
      StageTimer timer(layer_statistics.trace_s);
      if (layers_[layer] == Layer::Direct)
        tracePaths(*context_, *camera_, Layer::Direct, firstHitsOf(blocks, heads), ends, vertices);
      else
        for (size_t i = 0; i < heads.size(); ++i) vertices[i] = vertices_[heads[i]];
    }
    StageTimer timer(layer_statistics.shade_s);
    const size_t first = shading.samples.count;
    shade(*context_, vertices, ends, shading.radiance.host().subspan(first, heads.size()));
    shading.radiance.toDevice(first, heads.size());
    if (settings_.debug_aovs)
      for (const uint32_t slot : heads) {
        const uint32_t pixel = slot / aa_.samples_per_pixel % kBlockArea;
        const BlockOrigin block = blocks[slot / slots_per_block];
        film_->addEvaluation(uint32_t(layer), block.x + int32_t(pixel % kBlockPixels),
                             block.y + int32_t(pixel / kBlockPixels));
      }
  }

  std::vector<FirstHit> firstHitsOf(std::span<const BlockOrigin> blocks, std::span<const uint32_t> slots) const {
    std::vector<FirstHit> first(slots.size());
    if (first_.empty())
      retraceFirstHits(*context_, *camera_, blocks, slots, first);
    else
      for (size_t i = 0; i < slots.size(); ++i) first[i] = first_[slots[i]];
    return first;
  }

  void finishStatistics() {
    Statistics& s = statistics_;
    s.device = device_.info().name;
    s.driver = device_.info().driver;
    s.primitives = trace_->primitiveCount();
    s.micropolygons = trace_->micropolygonCount();
    s.pixels = windowOf(settings_).area();
    s.antialiasing_samples = antialiasing_samples_;
    s.rays_traced = rays_traced_;
    s.non_finite_samples = film_->nonFiniteSamples();
    s.peak_memory_bytes = peakProcessBytes();
    s.device_peak_bytes = device_.peakAllocatedBytes();
    s.geometry_bytes = trace_->memoryBytes();
    s.texture_bytes = patterns_->peakTextureBytes() + context_->lights.bytes();
    s.kernels = device_.timings();
    if (vertex_shading_)
      for (const Layer layer : layers_)
        s.layers[layerName(layer)].shading_evaluations = vertex_shading_->evaluations(layer);
    for (const auto& [name, layer] : s.layers) {
      s.time_s["trace"] += layer.trace_s;
      s.time_s["shade"] += layer.shade_s;
      s.time_s["reuse"] += layer.reuse_s;
      s.time_s["film"] += layer.film_s;
    }
    if (s.non_finite_samples) s.warnings["samples that were not finite count as black"] = s.non_finite_samples;
    for (const DicedMesh& mesh : diced_)
      if (mesh.lost_displacements)
        s.warnings["displacements that were not finite count as 0"] += mesh.lost_displacements;
    const std::vector<uint32_t> untraceable = trace_->untraceable();
    if (!untraceable.empty())
      s.warnings["instances are too small to be traced and were left out, such as " +
                 scene_.instances[untraceable.front()].path] = untraceable.size();
  }

  void reportTile(const ReuseTile& tile, double share) {
    report((double(finished_blocks_) + share * double(tile.rendered.size())) / double(total_blocks_), "render");
  }

  void report(double done, const char* stage) {
    if (progress_ && !progress_(done, stage)) throw Error(ErrorKind::Cancelled, "the render was cancelled");
  }

  const Scene& scene_;
  const Settings& settings_;
  Device& device_;
  const Progress& progress_;
  const TileSink& sink_;
  const RenderCache::Use* cache_;  // null: none
  Statistics statistics_;
  std::atomic<uint64_t> rays_traced_{0};

  DicedMeshes diced_;
  std::optional<TraceScene> trace_;
  std::optional<Patterns> patterns_;
  std::optional<ShadingRates> rates_;
  std::optional<CameraRays> camera_;
  std::optional<ReuseKernels> kernels_;
  std::optional<LayerSearch> search_;
  std::optional<Film> film_;
  std::optional<ShadeContext> context_;
  std::optional<Seeds> seeds_;
  std::optional<AovFilm> aovs_;                  // where any are asked for
  std::optional<VertexShading> vertex_shading_;  // only of Method::Vertex
  std::vector<Layer> layers_;
  MemoryPlan plan_;

  std::vector<LayerShading> shading_;  // per layer
  AaSamples aa_;
  FilmSamples film_samples_;
  std::vector<FirstHit> first_;       // of the batch in flight
  std::vector<PathVertex> vertices_;  // of its samples in a layer other than direct
  std::vector<float> depth_;          // of its pixels
  std::vector<uint32_t> ends_;        // of its blocks
  size_t total_blocks_ = 0, finished_blocks_ = 0;
  uint64_t antialiasing_samples_ = 0;
};

// Runs `work` with the threads that the settings ask for; returns how many those are.
template <class Work>
uint32_t inArena(const Settings& settings, const Work& work) {
  const int threads = settings.threads ? int(settings.threads) : tbb::this_task_arena::max_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
  tbb::task_arena arena(threads);
  arena.execute(work);
  return uint32_t(threads);
}

}  // namespace

Frame render(Scene& scene, const Settings& settings, Device& device, const Progress& progress, const TileSink& sink,
             RenderCache* cache) {
  settings.validate();
  scene.validate();
  std::optional<RenderCache::Use> use;
  if (cache) use.emplace(*cache, device);
  device.resetTimings();
  const Rebased rebased(scene);
  Frame frame;
  const uint32_t threads = inArena(settings, [&] {
    frame = FrameRenderer(scene, settings, device, progress, sink, use ? &*use : nullptr).render();
  });
  frame.statistics.threads = threads;
  return frame;
}

RawTrace timeRawRays(Scene& scene, const Settings& settings) {
  settings.validate();
  scene.validate();
  const Rebased rebased(scene);
  RawTrace raw;
  inArena(settings, [&] {
    const DicedMeshes diced = diceScene(scene, settings);  // displacement is left out
    const TraceScene trace(scene, diced);
    raw = timeRawPrimaryRays(trace, CameraRays(scene.camera, settings, scene.moves()), settings);
  });
  return raw;
}

}  // namespace encore
