#include "core/render/whole_frame.h"

#include <algorithm>

namespace encore {
namespace {

// Copies `part`, of `rect`, some values per pixel, into the image, which is made when it is not there yet.
template <class T>
void place(std::vector<T>& image, PixelRect frame, const std::vector<T>& part, PixelRect rect) {
  if (part.empty()) return;
  const size_t values = part.size() / rect.area();
  image.resize(frame.area() * values);
  const size_t row = rect.width() * values;
  for (size_t y = 0; y < rect.height(); ++y)
    std::copy_n(part.begin() + ptrdiff_t(y * row), row,
                image.begin() + ptrdiff_t(((y + size_t(rect.y0)) * frame.width() + size_t(rect.x0)) * values));
}

}  // namespace

WholeFrame::WholeFrame(uint32_t width, uint32_t height) { images_.rect = {0, 0, int32_t(width), int32_t(height)}; }

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
  images_.aovs.resize(part.aovs.size());
  for (size_t i = 0; i < part.aovs.size(); ++i) {
    images_.aovs[i].components = part.aovs[i].components;
    add(images_.aovs[i].values, part.aovs[i].values);
    add(images_.aovs[i].ids, part.aovs[i].ids);
  }
  add(images_.composite, part.composite);
  add(images_.alpha, part.alpha);
  add(images_.depth, part.depth);
  add(images_.normal, part.normal);
}

}  // namespace encore
