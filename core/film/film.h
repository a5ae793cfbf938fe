// Filtering: the result of forward splatting (§3.1), computed by gathering so that it does not depend
// on the order of samples. Blocks give partial sums padded by the filter radius; they are added in order.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/reuse/reuse.h"
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

struct BlockOrigin {
  uint32_t x = 0, y = 0;  // of its upper left pixel in the image
};

// What all layers of a batch share, per slot (order: AaSamples). On the device (Buffer::toDevice()).
struct FilmSamples {
  Buffer<uint32_t> position;  // offset in the pixel, records.h
  Buffer<float> coverage;     // alpha of the sample; 0 in unused slots
  Buffer<Vec3f> normal;       // world space; 0 where nothing was hit
};

// Resolved images, row-major, top row first, width * height.
struct FilmImages {
  std::vector<std::vector<Vec3f>> layers;  // premultiplied radiance, in the order of addLayer's index
  std::vector<Vec3f> composite;            // exactly the sum of the layers, in order, in float
  std::vector<float> alpha;
  std::vector<float> depth;  // of the closest sample, unfiltered; infinity: nothing
  std::vector<Vec3f> normal;
};

// Sums are kept in single precision: meant for up to a few hundred samples per pixel.
class Film {
 public:
  // Throws Error(Setting) unless 0 < radius <= 8 pixels.
  Film(Device& device, uint32_t width, uint32_t height, FilterKind filter, float radius, uint32_t layers,
       uint32_t samples_per_pixel);
  ~Film();

  // One batch: the shared part once, and every layer once. blocks.size() * kBlockArea pixels' slots.
  // Samples of pixels outside the image count nowhere. The images depend on the order of blocks over the
  // whole frame, to the last bit, but not on how that sequence is cut into batches.
  void addShared(std::span<const BlockOrigin> blocks, const FilmSamples& shared);
  // Sample radiance = throughput * radiance[shade], or throughput where shade is kShadeNone.
  // Samples that are not finite count as 0 and are counted. Throws Error(Internal) when a sample's shade is
  // neither kShadeNone nor an index into radiance.
  void addLayer(uint32_t layer, std::span<const BlockOrigin> blocks, const FilmSamples& shared, const AaSamples& aa,
                const Buffer<Vec3f>& radiance);
  // Depth along -Z of the closest sample of each pixel: the host keeps the minimum.
  void addDepth(uint32_t x, uint32_t y, float depth);

  // Divides by the filter weights. Every sample counts once in every layer's weight. A pixel that no
  // sample reaches is 0. Normals are averages, not of unit length.
  FilmImages resolve() const;
  uint64_t nonFiniteSamples() const;
  // For planning: device bytes while adding a batch of so many blocks (bounded, whatever their number),
  // and host bytes of a frame.
  static uint64_t partialBytes(uint64_t blocks, float radius);
  static uint64_t frameBytes(uint64_t pixels, uint32_t layers);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace encore
