// Puts the pixels of finished tiles together, for callers that want whole images.
#pragma once

#include "core/film/film.h"

namespace encore {

class WholeFrame {
 public:
  WholeFrame(uint32_t width, uint32_t height);
  // Rects that together are the image; each in the same layers.
  void add(const FilmImages& part);
  FilmImages take() { return std::move(images_); }

 private:
  FilmImages images_;
};

}  // namespace encore
