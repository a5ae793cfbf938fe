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

TilePlanes::TilePlanes(PixelRect area, uint32_t pad, std::vector<float> initial)
    : area_(area), pad_(int32_t(pad)), initial_(std::move(initial)) {}

void TilePlanes::requireNext(PixelRect tile) const {
  const bool first = tile_.area() == 0, row_done = tile_.x1 == area_.x1;
  const int32_t x0 = first || row_done ? area_.x0 : tile_.x1, y0 = first ? area_.y0 : row_done ? tile_.y1 : tile_.y0;
  const bool in_place = tile.x0 == x0 && tile.y0 == y0 && (x0 == area_.x0 || tile.y1 == tile_.y1);
  const bool inside = tile.x0 < tile.x1 && tile.y0 < tile.y1 && tile.x1 <= area_.x1 && tile.y1 <= area_.y1;
  const bool wide = tile.x1 == area_.x1 || tile.x1 - tile.x0 >= 2 * pad_;
  const bool high = tile.y1 == area_.y1 || tile.y1 - tile.y0 >= 2 * pad_;
  if (!active_ && in_place && inside && wide && high) return;
  throw Error(ErrorKind::Internal, "Film: tile " + text(tile) + " cannot follow " + text(tile_) + " in " + text(area_) +
                                       (active_ ? ", which is not finished" : ""));
}

// Once, for the first tile: none is larger. What is carried over comes first, so that nothing is copied.
void TilePlanes::allocate() {
  const auto size = [&](uint64_t columns, uint64_t rows) { return size_t(initial_.size() * columns * rows); };
  const uint32_t strip = 2 * uint32_t(pad_);
  const uint64_t columns = std::min(tile_.width() + strip, area_.width());
  const uint64_t rows = std::min(tile_.height() + strip, area_.height());
  values_.reserve(size(columns, rows));
  if (tile_.x1 < area_.x1) right_values_.reserve(size(strip, rows));
  if (tile_.y1 < area_.y1) below_values_.resize(size(area_.width(), strip));
}

void TilePlanes::begin(PixelRect tile) {
  requireNext(tile);
  const bool first = tile_.area() == 0;
  if (tile.x0 == area_.x0) below_y0_ = below_next_y0_;
  tile_ = tile;
  if (first) allocate();
  reach_ = {std::max(tile.x0 - pad_, area_.x0), std::max(tile.y0 - pad_, area_.y0), std::min(tile.x1 + pad_, area_.x1),
            std::min(tile.y1 + pad_, area_.y1)};
  values_.resize(initial_.size() * reach_.area());
  for (size_t plane = 0; plane < initial_.size(); ++plane) {
    std::fill_n(values_.begin() + ptrdiff_t(plane * reach_.area()), reach_.area(), initial_[plane]);
  }
  restore();
  active_ = true;
}

void TilePlanes::restore() {
  // Of the tiles above: the columns that the tile before has not taken over yet.
  if (tile_.y0 > area_.y0) {
    const int32_t x0 = tile_.x0 > area_.x0 ? right_.x1 : area_.x0, x1 = reach_.x1;
    const int32_t rows = std::min(2 * pad_, area_.y1 - below_y0_);
    for (size_t plane = 0; plane < initial_.size() && x0 < x1; ++plane) {
      for (int32_t y = 0; y < rows; ++y) {
        const float* from = below_values_.data() + (plane * 2 * size_t(pad_) + size_t(y)) * area_.width();
        std::copy(from + (x0 - area_.x0), from + (x1 - area_.x0), row(plane, below_y0_ + y).begin() + (x0 - reach_.x0));
      }
    }
  }
  if (tile_.x0 > area_.x0) {
    const float* from = right_values_.data();
    for (size_t plane = 0; plane < initial_.size(); ++plane) {
      for (int32_t y = right_.y0; y < right_.y1; ++y, from += right_.width()) {
        std::copy_n(from, right_.width(), row(plane, y).begin() + (right_.x0 - reach_.x0));
      }
    }
  }
}

void TilePlanes::saveRight() {
  right_ = {std::max(tile_.x1 - pad_, area_.x0), reach_.y0, reach_.x1, reach_.y1};
  right_values_.resize(initial_.size() * right_.area());
  float* to = right_values_.data();
  for (size_t plane = 0; plane < initial_.size(); ++plane) {
    for (int32_t y = right_.y0; y < right_.y1; ++y, to += right_.width()) {
      std::copy_n(row(plane, y).begin() + (right_.x0 - reach_.x0), right_.width(), to);
    }
  }
}

// Over what the tile has taken from the strip above: later tiles of the row read only further right.
void TilePlanes::saveBelow() {
  below_next_y0_ = std::max(tile_.y1 - pad_, area_.y0);
  const int32_t x1 = tile_.x1 == area_.x1 ? area_.x1 : std::max(tile_.x1 - pad_, area_.x0);
  const int32_t rows = reach_.y1 - below_next_y0_;
  for (size_t plane = 0; plane < initial_.size(); ++plane) {
    for (int32_t y = 0; y < rows; ++y) {
      const std::span<const float> from = row(plane, below_next_y0_ + y);
      const size_t to = (plane * 2 * size_t(pad_) + size_t(y)) * area_.width() + size_t(reach_.x0 - area_.x0);
      std::copy(from.begin(), from.begin() + (x1 - reach_.x0), below_values_.begin() + ptrdiff_t(to));
    }
  }
}

PixelRect TilePlanes::finish() {
  if (!active_) throw Error(ErrorKind::Internal, "Film: there is no tile to finish");
  const bool last_column = tile_.x1 == area_.x1, last_row = tile_.y1 == area_.y1;
  if (!last_column) saveRight();
  if (!last_row) saveBelow();
  active_ = false;
  return {reach_.x0, reach_.y0, last_column ? area_.x1 : tile_.x1 - pad_, last_row ? area_.y1 : tile_.y1 - pad_};
}

uint64_t TilePlanes::bytes(PixelRect tile, uint32_t area_width, uint32_t pad, uint64_t planes) {
  const uint64_t strip = 2 * uint64_t(pad), rows = tile.height() + strip;
  const uint64_t columns = std::min<uint64_t>(tile.width() + strip, area_width);
  return sizeof(float) * planes * (columns * rows + strip * rows + strip * area_width);
}

}  // namespace encore
