#include "core/film/tile_planes.h"

#include <algorithm>
#include <string>

#include "core/scene/error.h"

namespace encore {
namespace {

std::string text(PixelRect r) {
  return "[" + std::to_string(r.x0) + ", " + std::to_string(r.x1) + ") x [" + std::to_string(r.y0) + ", " +
         std::to_string(r.y1) + ")";
}

}  // namespace

TilePlanes::TilePlanes(uint32_t width, uint32_t height, uint32_t pad, std::vector<float> initial)
    : width_(width), height_(height), pad_(pad), initial_(std::move(initial)) {}

void TilePlanes::requireNext(PixelRect tile) const {
  const bool first = tile_.area() == 0, row_done = tile_.x1 == width_;
  const uint32_t x0 = first || row_done ? 0 : tile_.x1, y0 = first ? 0 : row_done ? tile_.y1 : tile_.y0;
  const bool in_place = tile.x0 == x0 && tile.y0 == y0 && (x0 == 0 || tile.y1 == tile_.y1);
  const bool inside = tile.x0 < tile.x1 && tile.y0 < tile.y1 && tile.x1 <= width_ && tile.y1 <= height_;
  const bool wide = tile.x1 == width_ || tile.width() >= 2 * pad_;
  const bool high = tile.y1 == height_ || tile.height() >= 2 * pad_;
  if (!active_ && in_place && inside && wide && high) return;
  throw Error(ErrorKind::Internal, "Film: tile " + text(tile) + " cannot follow " + text(tile_) + " in an image of " +
                                       std::to_string(width_) + " x " + std::to_string(height_) +
                                       (active_ ? ", which is not finished" : ""));
}

// Once, for the first tile: none is larger. What is carried over comes first, so that nothing is copied.
void TilePlanes::allocate() {
  const auto size = [&](uint64_t columns, uint64_t rows) { return size_t(initial_.size() * columns * rows); };
  const uint64_t columns = std::min<uint64_t>(tile_.width() + 2 * pad_, width_);
  const uint64_t rows = std::min<uint64_t>(tile_.height() + 2 * pad_, height_);
  values_.reserve(size(columns, rows));
  if (tile_.x1 < width_) right_values_.reserve(size(2 * pad_, rows));
  if (tile_.y1 < height_) below_values_.resize(size(width_, 2 * pad_));
}

void TilePlanes::begin(PixelRect tile) {
  requireNext(tile);
  const bool first = tile_.area() == 0;
  if (tile.x0 == 0) below_y0_ = below_next_y0_;
  tile_ = tile;
  if (first) allocate();
  reach_ = {tile.x0 - std::min(tile.x0, pad_), tile.y0 - std::min(tile.y0, pad_), std::min(tile.x1 + pad_, width_),
            std::min(tile.y1 + pad_, height_)};
  values_.resize(initial_.size() * reach_.area());
  for (size_t plane = 0; plane < initial_.size(); ++plane) {
    std::fill_n(values_.begin() + ptrdiff_t(plane * reach_.area()), reach_.area(), initial_[plane]);
  }
  restore();
  active_ = true;
}

void TilePlanes::restore() {
  // Of the tiles above: the columns that the tile before has not taken over yet.
  if (tile_.y0 > 0) {
    const uint32_t x0 = tile_.x0 > 0 ? right_.x1 : 0, x1 = reach_.x1;
    const uint32_t rows = std::min(2 * pad_, height_ - below_y0_);
    for (size_t plane = 0; plane < initial_.size() && x0 < x1; ++plane) {
      for (uint32_t y = 0; y < rows; ++y) {
        const float* from = below_values_.data() + (plane * 2 * pad_ + y) * width_;
        std::copy(from + x0, from + x1, row(plane, below_y0_ + y).begin() + (x0 - reach_.x0));
      }
    }
  }
  if (tile_.x0 > 0) {
    const float* from = right_values_.data();
    for (size_t plane = 0; plane < initial_.size(); ++plane) {
      for (uint32_t y = right_.y0; y < right_.y1; ++y, from += right_.width()) {
        std::copy_n(from, right_.width(), row(plane, y).begin() + (right_.x0 - reach_.x0));
      }
    }
  }
}

void TilePlanes::saveRight() {
  right_ = {tile_.x1 - std::min(tile_.x1, pad_), reach_.y0, reach_.x1, reach_.y1};
  right_values_.resize(initial_.size() * right_.area());
  float* to = right_values_.data();
  for (size_t plane = 0; plane < initial_.size(); ++plane) {
    for (uint32_t y = right_.y0; y < right_.y1; ++y, to += right_.width()) {
      std::copy_n(row(plane, y).begin() + (right_.x0 - reach_.x0), right_.width(), to);
    }
  }
}

// Over what the tile has taken from the strip above: later tiles of the row read only further right.
void TilePlanes::saveBelow() {
  below_next_y0_ = tile_.y1 - std::min(tile_.y1, pad_);
  const uint32_t x1 = tile_.x1 == width_ ? width_ : tile_.x1 - std::min(tile_.x1, pad_);
  const uint32_t rows = reach_.y1 - below_next_y0_;
  for (size_t plane = 0; plane < initial_.size(); ++plane) {
    for (uint32_t y = 0; y < rows; ++y) {
      const std::span<const float> from = row(plane, below_next_y0_ + y);
      std::copy(from.begin(), from.begin() + (x1 - reach_.x0),
                below_values_.begin() + ptrdiff_t((plane * 2 * pad_ + y) * width_ + reach_.x0));
    }
  }
}

PixelRect TilePlanes::finish() {
  if (!active_) throw Error(ErrorKind::Internal, "Film: there is no tile to finish");
  const bool last_column = tile_.x1 == width_, last_row = tile_.y1 == height_;
  if (!last_column) saveRight();
  if (!last_row) saveBelow();
  active_ = false;
  return {reach_.x0, reach_.y0, last_column ? width_ : tile_.x1 - pad_, last_row ? height_ : tile_.y1 - pad_};
}

uint64_t TilePlanes::bytes(PixelRect tile, uint32_t image_width, uint32_t pad, uint64_t planes) {
  const uint64_t strip = 2 * uint64_t(pad), rows = tile.height() + strip;
  const uint64_t columns = std::min<uint64_t>(tile.width() + strip, image_width);
  return sizeof(float) * planes * (columns * rows + strip * rows + strip * image_width);
}

}  // namespace encore
