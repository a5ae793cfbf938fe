// Blocks: fixed squares of kBlockPixels pixels, the unit of packets, batches and film partials.
#pragma once

#include <cstdint>

namespace encore {

struct BlockOrigin {
  int32_t x = 0, y = 0;  // of its upper left pixel, in the plane of the image
};

// Pixels [x0, x1) × [y0, y1) of the plane of the image, x0 <= x1 and y0 <= y1.
struct PixelRect {
  int32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  uint32_t width() const { return uint32_t(x1 - x0); }
  uint32_t height() const { return uint32_t(y1 - y0); }
  uint64_t area() const { return uint64_t(width()) * height(); }
};

}  // namespace encore
