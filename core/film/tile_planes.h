// Running values of one tile's pixels and of those around it that its samples reach.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene/block.h"

namespace encore {

// Planes of float over the pixels that the current tile reaches: the tile, and `pad` pixels around it inside of the
// area. Values that later tiles go on with are carried over in strips of 2 * pad pixels, one along the right
// border of the tile and one, as wide as the area, along the lower borders of its row of tiles.
class TilePlanes {
 public:
  // area: what the tiles cover. initial: one value per plane, of pixels that no tile has reached yet.
  TilePlanes(PixelRect area, uint32_t pad, std::vector<float> initial);

  const PixelRect& area() const { return area_; }
  // The next tile in row order. Throws Error(Internal) when it is not the next, or is narrower or lower than
  // 2 * pad and not the last of its row or column.
  void begin(PixelRect tile);
  bool active() const { return active_; }
  const PixelRect& tile() const { return tile_; }
  // The pixels that are held.
  const PixelRect& reach() const { return reach_; }

  // Row y of a plane, pixel reach().x0 first. The tile must be active, or the last that was.
  std::span<float> row(size_t plane, int32_t y) {
    return {values_.data() + (plane * reach_.height() + uint32_t(y - reach_.y0)) * reach_.width(), reach_.width()};
  }
  float& at(size_t plane, int32_t x, int32_t y) { return row(plane, y)[uint32_t(x - reach_.x0)]; }

  // Ends the tile; returns the pixels that no later tile reaches. Values stay readable until begin().
  PixelRect finish();

  // Bytes held with so many planes, at most.
  static uint64_t bytes(PixelRect tile, uint32_t area_width, uint32_t pad, uint64_t planes);

 private:
  void requireNext(PixelRect tile) const;
  void allocate();
  void saveRight();
  void saveBelow();
  void restore();

  PixelRect area_;
  int32_t pad_;
  std::vector<float> initial_;
  PixelRect tile_, reach_;
  bool active_ = false;
  std::vector<float> values_;  // [plane][row][column] of reach_
  PixelRect right_;            // pixels of the strip along the right border of the tile before
  std::vector<float> right_values_;
  std::vector<float> below_values_;  // [plane][row][column]: 2 * pad rows of the whole width, once a row is done
  int32_t below_y0_ = 0, below_next_y0_ = 0;  // first row of the strip above the current tiles, and below them
};

}  // namespace encore
