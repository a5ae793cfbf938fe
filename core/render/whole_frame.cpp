#include "core/render/whole_frame.h"

#include <algorithm>

namespace encore {
namespace {

// Copies `part`, of `rect`, into the image, which is made when it is not there yet.
template <class T>
void place(std::vector<T>& image, PixelRect frame, const std::vector<T>& part, PixelRect rect) {
  if (part.empty()) return;
  image.resize(frame.area());
  for (uint32_t y = rect.y0; y < rect.y1; ++y)
    std::copy_n(part.begin() + ptrdiff_t(uint64_t(y - rect.y0) * rect.width()), rect.width(),
                image.begin() + ptrdiff_t(uint64_t(y) * frame.width() + rect.x0));
}

}  // namespace

WholeFrame::WholeFrame(uint32_t width, uint32_t height) { images_.rect = {0, 0, width, height}; }

void WholeFrame::add(const FilmImages& part) {
  const auto add = [&](auto& image, const auto& pixels) { place(image, images_.rect, pixels, part.rect); };
  images_.layers.resize(part.layers.size());
  images_.debug.resize(part.debug.size());
  for (size_t i = 0; i < part.layers.size(); ++i) add(images_.layers[i], part.layers[i]);
  for (size_t i = 0; i < part.debug.size(); ++i) {
    add(images_.debug[i].evaluations, part.debug[i].evaluations);
    add(images_.debug[i].reshaded, part.debug[i].reshaded);
    add(images_.debug[i].distance, part.debug[i].distance);
    add(images_.debug[i].id, part.debug[i].id);
  }
  add(images_.composite, part.composite);
  add(images_.alpha, part.alpha);
  add(images_.depth, part.depth);
  add(images_.normal, part.normal);
}

}  // namespace encore
