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

// How shading was spent in one layer, per pixel, unfiltered.
struct DebugImages {
  std::vector<float> evaluations;  // shading evaluations that lie in the pixel, reshading included
  std::vector<float> reshaded;     // share of the samples on a surface that found no neighbour
  std::vector<float> distance;     // mean parametric distance of the others to their neighbour
  std::vector<Vec3f> id;           // mean of false colours of the shading samples in use
};

// Resolved pixels of `rect`, row-major, top row first.
struct FilmImages {
  PixelRect rect;
  std::vector<std::vector<Vec3f>> layers;  // premultiplied radiance, in the order of addLayer's index
  std::vector<Vec3f> composite;            // exactly the sum of the layers, in order, in float
  std::vector<float> alpha;
  std::vector<float> depth;  // of the closest sample, unfiltered; infinity: nothing
  std::vector<Vec3f> normal;
  std::vector<DebugImages> debug;  // per layer, empty unless asked for
};

// Film of one frame, tile by tile: tiles are whole blocks that cover the image in row order. Only a tile's
// pixels are held, and strips of twice the filter's reach along its lower and right borders (the lower one as
// wide as the image), so that neither the size of the image nor the number of samples changes what it takes.
// Sums are kept in single precision: meant for up to a few hundred samples per pixel.
class Film {
 public:
  // Throws Error(Setting) unless 0 < radius <= 8 pixels. debug: keep DebugImages.
  Film(Device& device, uint32_t width, uint32_t height, FilterKind filter, float radius, uint32_t layers,
       uint32_t samples_per_pixel, bool debug = false);
  ~Film();

  // Tiles in row order, each once: rows of tiles from the top, in a row from the left, anchored at the image's
  // origin and of one size but for the last column and row, at least twice the filter's reach wide and high
  // (kBlockPixels suffices).
  void beginTile(PixelRect tile);

  // One batch of blocks of the tile: the shared part with layer 0 once, and every other layer once.
  // blocks.size() * kBlockArea pixels' slots. Samples of pixels outside the image count nowhere. The images depend
  // on the order of blocks over the whole frame, to the last bit, but not on how that sequence is cut into batches.
  // Sample radiance = throughput * radiance[shade], or throughput where shade is kShadeNone.
  // Samples that are not finite count as 0 and are counted. Throws Error(Internal) when a sample's shade is
  // neither kShadeNone nor an index into radiance.
  void addFirstLayer(std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                     const Buffer<Vec3f>& radiance);
  void addLayer(uint32_t layer, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                const Buffer<Vec3f>& radiance);
  // Depth along -Z of the closest sample of each pixel of the blocks, in slot order of pixels; infinity: nothing.
  // Pixels outside of the image are ignored.
  void addDepth(std::span<const BlockOrigin> blocks, std::span<const float> depth);

  // For DebugImages, once per layer and batch before its failures are served and splatted: aa.shade as
  // findNearest() and limitDistance() left it. uv: of the index's samples, by id.
  void addSearch(uint32_t layer, std::span<const BlockOrigin> blocks, const AaSamples& aa, const Buffer<Vec2f>& uv);
  // One more shading evaluation in the pixel (of the current tile), unless it lies outside of the image.
  void addEvaluation(uint32_t layer, uint32_t x, uint32_t y);

  // Ends the tile, and returns the pixels that no later tile can reach. All rects together are the image.
  // Divides by the filter weights. Every sample counts once in every layer's weight. A pixel that no
  // sample reaches is 0. Normals are averages, not of unit length.
  FilmImages finishTile();
  uint64_t nonFiniteSamples() const;

  // For planning: device bytes while adding a batch of so many blocks (bounded, whatever their number),
  // and host bytes of the film while a tile of so many pixels is in work, its finished images included.
  static uint64_t partialBytes(uint64_t blocks, float radius);
  static uint64_t tileBytes(PixelRect tile, uint32_t image_width, float radius, uint32_t layers, bool debug);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
