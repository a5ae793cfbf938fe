// The film tile by tile against the film of a whole frame, to the last bit, and the memory that it takes.
#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

#include "tests/core/film_samples.h"
#include "tests/core/twins/film_twin.h"

namespace {

// Host memory of this program that is in use, and the most there was since the last reset.
struct Allocations {
  std::atomic<size_t> live{0}, peak{0};
};
Allocations& allocations() {
  static Allocations counts;
  return counts;
}

}  // namespace

#ifndef __SANITIZE_ADDRESS__  // which has operators of its own
void* operator new(size_t size) {
  void* block = std::malloc(size + alignof(std::max_align_t));
  if (!block) throw std::bad_alloc();
  *static_cast<size_t*>(block) = size;
  const size_t live = allocations().live += size;
  size_t peak = allocations().peak;
  while (live > peak && !allocations().peak.compare_exchange_weak(peak, live)) {
  }
  return static_cast<std::byte*>(block) + alignof(std::max_align_t);
}
void operator delete(void* block) noexcept {
  if (!block) return;
  void* start = static_cast<std::byte*>(block) - alignof(std::max_align_t);
  allocations().live -= *static_cast<size_t*>(start);
  std::free(start);
}
void operator delete(void* block, size_t) noexcept { operator delete(block); }
#endif

namespace encore {
namespace {

using FilmTileTest = FilmTest;

TEST_F(FilmTileTest, IsTheWholeFrameToTheLastBit) {
  struct Case {
    int32_t width, height, tile_width, tile_height;
  };
  const Case cases[] = {{1, 1, 16, 16},   {17, 1, 16, 16},  {1, 40, 16, 16},  {33, 47, 16, 16},
                        {33, 47, 32, 16}, {33, 47, 32, 32}, {48, 48, 16, 32}, {65, 35, 32, 32}};
  for (const auto& [kind, radius] : {std::pair{FilterKind::BlackmanHarris, 1.5f}, {FilterKind::Mitchell, 2.0f}}) {
    for (const Case& c : cases) {
      SCOPED_TRACE(testing::Message() << "filter " << int(kind) << ", " << c.width << " x " << c.height
                                      << " in tiles of " << c.tile_width << " x " << c.tile_height);
      const FrameSamples f = makeSamples(c.width, c.height, 3, 2, c.tile_width, c.tile_height);
      expectSameBits(filmImages(device(), f, kind, radius, 3), wholeFrameImages(f, kind, radius));
      if (HasFatalFailure()) return;
    }
  }
}

TEST_F(FilmTileTest, AllRadiiAndFilters) {
  const std::pair<FilterKind, float> cases[] = {{FilterKind::Box, 0.5f},      {FilterKind::Box, 8.0f},
                                                {FilterKind::Gaussian, 2.7f}, {FilterKind::BlackmanHarris, 8.0f},
                                                {FilterKind::Mitchell, 4.0f}, {FilterKind::BlackmanHarris, 0.25f}};
  const FrameSamples f = makeSamples(33, 35, 2, 1, 16, 16);  // the last column and row are narrower than the reach
  for (const auto& [kind, radius] : cases) {
    SCOPED_TRACE(testing::Message() << "filter " << int(kind) << ", radius " << radius);
    expectSameBits(filmImages(device(), f, kind, radius, 2), wholeFrameImages(f, kind, radius));
    if (HasFatalFailure()) return;
  }
}

TEST_F(FilmTileTest, OnePixelMoreThanATile) {
  const FrameSamples f = makeSamples(513, 17, 1, 1, 512, 512);
  expectSameBits(filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, 100),
                 wholeFrameImages(f, FilterKind::BlackmanHarris, 1.5f));
}

TEST_F(FilmTileTest, BatchesDoNotChangeABit) {
  const FrameSamples f = makeSamples(53, 70, 4, 2, 32, 48);
  const FrameImages whole = filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, 100);
  for (const size_t batch : {1u, 2u, 5u}) {
    SCOPED_TRACE(batch);
    expectSameBits(filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, batch), whole);
  }
}

TEST_F(FilmTileTest, EveryNumberOfSamplesPerPixel) {
  for (uint32_t samples = 1; samples <= 9; ++samples) {
    SCOPED_TRACE(samples);
    const FrameSamples f = makeSamples(20, 18, samples, 2, 16, 16);
    expectSameBits(filmImages(device(), f, FilterKind::BlackmanHarris, 1.5f, 1),
                   wholeFrameImages(f, FilterKind::BlackmanHarris, 1.5f));
  }
}

TEST_F(FilmTileTest, HostMemoryIsAsPlanned) {
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "the sanitizer's allocator does not count";
#endif
  for (const bool debug : {false, true}) {
    const FrameSamples f = makeSamples(1000, 300, 1, 3, 256, 128);
    Film film(device(), uint32_t(f.width), uint32_t(f.height), FilterKind::BlackmanHarris, 1.5f, f.layers, 1, debug);
    const size_t before = allocations().live;  // with the kernels, which are not planned
    const uint64_t planned = Film::tileBytes(f.tiles[0].rect, uint32_t(f.width), 1.5f, f.layers, debug);
    for (const FrameTile& tile : f.tiles) {
      allocations().peak = allocations().live.load();
      film.beginTile(tile.rect);
      film.addDepth(std::span(f.blocks).subspan(tile.first_block, tile.blocks),
                    std::span(f.depth).subspan(tile.first_block * kBlockArea));
      const FilmImages images = film.finishTile();
      const size_t used = allocations().peak - before;
      EXPECT_LE(used, planned + 65536) << debug;  // threads
      if (tile.rect.x0 == 256 && tile.rect.y0 == 128) {
        EXPECT_GE(used, planned * 9 / 10) << debug;
      }
    }
  }
}

TEST_F(FilmTileTest, HostMemoryDoesNotGrowWithTheHeight) {
  const PixelRect tile{0, 0, 512, 512};
  EXPECT_EQ(Film::tileBytes(tile, 16384, 1.5f, 3, false),
            Film::tileBytes({512, 4096, 1024, 4608}, 16384, 1.5f, 3, false));
  EXPECT_LT(Film::tileBytes(tile, 16384, 1.5f, 3, true), 100u << 20);
}

}  // namespace
}  // namespace encore
