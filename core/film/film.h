// Filtering: the result of forward splatting (§3.1), computed by gathering so that it does not depend
// on the order of samples. Blocks give partial sums padded by the filter radius; they are added in order.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/reuse/reuse.h"
#include "core/scene/block.h"
#include "core/scene/settings.h"
#include "core/vulkan/device.h"

namespace encore {

// Value of the separable filter along one axis; x is the pixel's centre minus the sample's position,
// in pixels. 0 at and beyond the radius; only the box is half open, 1 over (-radius, radius], so that
// with radius 0.5 every sample counts in exactly one pixel. Not normalized.
// Twin of shaders/film/filter.glsl, to the last bit.
float filterWeight(FilterKind kind, float radius, float x);
// Pixels beyond its own that a sample can reach: ceil(radius - 0.5).
uint32_t filterPad(float radius);

// What all layers of a batch share, per slot (order: AaSamples). On the device (Buffer::toDevice()).
struct FilmSamples {
  Buffer<uint32_t> position;  // offset in the pixel, records.h
  Buffer<float> coverage;     // alpha of the sample; 0 in unused slots
  Buffer<Vec3f> normal;       // world space; 0 where nothing was hit
};

// Where a film's tiles lie in the plane of the image. Borders of columns and of rows, ascending: filters do not reach
// across them, and tiles do not either, so that what lies between two is a film of its own.
struct FilmArea {
  std::vector<int32_t> columns, rows;
  PixelRect window;  // pixels that are resolved, within the borders

  static FilmArea ofImage(uint32_t width, uint32_t height) {
    const int32_t w = int32_t(width), h = int32_t(height);
    return {{0, w}, {0, h}, {0, 0, w, h}};
  }
};

// One of Settings::aovs.
struct AovImage {
  uint32_t components = 0;
  std::vector<float> values;  // components per pixel; empty: there are ids
  std::vector<int32_t> ids;
};

// How shading was spent in one layer, per pixel, unfiltered.
struct DebugImages {
  std::vector<float> evaluations;  // shading evaluations that lie in the pixel, reshading included
  std::vector<float> reshaded;     // share of the samples on a surface that found no neighbour
  std::vector<float> distance;     // mean parametric distance of the others to their neighbour
  std::vector<Vec3f> id;           // mean of false colours of the shading samples in use
};

// Resolved pixels of `rect`, row-major, top row first. Of no size: nothing of the window became final.
struct FilmImages {
  PixelRect rect;
  std::vector<std::vector<Vec3f>> layers;  // premultiplied radiance, in the order of addLayer's index
  std::vector<Vec3f> composite;            // exactly the sum of the layers, in order, in float
  std::vector<float> alpha;
  std::vector<float> depth;  // of the closest sample, unfiltered; infinity: nothing
  std::vector<Vec3f> normal;
  std::vector<DebugImages> debug;  // per layer, empty unless asked for
  std::vector<AovImage> aovs;      // in the order of Settings::aovs
};

// Film of one frame, tile by tile: tiles are whole blocks that cover the area in row order. Only a tile's
// pixels are held, and strips of twice the filter's reach along its lower and right borders (the lower one as
// wide as the area), so that neither the size of the image nor the number of samples changes what it takes.
// Sums are kept in single precision: meant for up to a few hundred samples per pixel.
class Film {
 public:
  // Throws Error(Setting) unless 0 < radius <= 8 pixels. debug: keep DebugImages.
  Film(Device& device, FilmArea area, FilterKind filter, float radius, uint32_t layers, uint32_t samples_per_pixel,
       bool debug = false, std::span<const Aov> aovs = {});
  Film(Device& device, uint32_t width, uint32_t height, FilterKind filter, float radius, uint32_t layers,
       uint32_t samples_per_pixel, bool debug = false)
      : Film(device, FilmArea::ofImage(width, height), filter, radius, layers, samples_per_pixel, debug) {}
  ~Film();

  // Tiles in row order, each once: rows of tiles from the top, in a row from the left; between two borders of the
  // area anchored at its upper left corner and of one size but for the last column and row, at least twice the
  // filter's reach wide and high (kBlockPixels suffices).
  void beginTile(PixelRect tile);

  // One batch of blocks of the tile: the shared part with layer 0 once, and every other layer once.
  // blocks.size() * kBlockArea pixels' slots. Samples of pixels beyond the borders around the tile count nowhere. A
  // tile's blocks may be left out where none of their samples reaches the window. The images depend on the order of
  // blocks over the whole frame, to the last bit, but not on how that sequence is cut into batches. Sample radiance =
  // throughput * radiance[shade], or throughput where shade is kShadeNone. Samples that are not finite count as 0 and
  // are counted. Throws Error(Internal) when a sample's shade is neither kShadeNone nor an index into radiance.
  void addFirstLayer(std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                     const Buffer<Vec3f>& radiance);
  void addLayer(uint32_t layer, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                const Buffer<Vec3f>& radiance);
  // Depth along -Z of the closest sample of each pixel of the blocks, in slot order of pixels; infinity: nothing.
  // Pixels beyond the borders around the tile are ignored.
  void addDepth(std::span<const BlockOrigin> blocks, std::span<const float> depth);

  // One of the aovs, once per batch. Filtered (Kind::Primvar): values per slot, weighted like the normals. Unfiltered:
  // of each pixel of the blocks, in slot order of pixels. Values that are not finite count as 0 and are counted.
  void addAov(size_t aov, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const Buffer<float>& values);
  void setAov(size_t aov, std::span<const BlockOrigin> blocks, std::span<const float> values);
  void setAov(size_t aov, std::span<const BlockOrigin> blocks, std::span<const int32_t> ids);

  // For DebugImages, once per layer and batch before its failures are served and splatted: aa.shade as
  // findNearest() and limitDistance() left it. uv: of the index's samples, by id.
  void addSearch(uint32_t layer, std::span<const BlockOrigin> blocks, const AaSamples& aa, const Buffer<Vec2f>& uv);
  // One more shading evaluation in the pixel (of the current tile), unless it lies beyond the borders around it.
  void addEvaluation(uint32_t layer, int32_t x, int32_t y);

  // Ends the tile, and returns the window's pixels that no later tile can reach. All rects together are the window.
  // Divides by the filter weights. Every sample counts once in every layer's weight. A pixel that no
  // sample reaches is 0. Normals are averages, not of unit length. Kind::EyeNormal comes empty: it follows from them.
  FilmImages finishTile();
  uint64_t nonFiniteSamples() const;

  // For planning: device bytes while adding a batch of so many blocks (bounded, whatever their number),
  // and host bytes of the film while a tile of so many pixels is in work, its finished images included, and of
  // areas whose tiles are no larger than that.
  static uint64_t partialBytes(uint64_t blocks, float radius);
  static uint64_t tileBytes(PixelRect tile, uint32_t image_width, float radius, uint32_t layers, bool debug);
  static uint64_t areaBytes(const FilmArea& area, PixelRect tile, float radius, uint32_t layers, bool debug,
                            std::span<const Aov> aovs);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
