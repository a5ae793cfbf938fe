// Listing 3: layers × buckets × batches, with progress, cancellation and statistics.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/film/film.h"
#include "core/path/path.h"
#include "core/render/statistics.h"
#include "core/scene/scene.h"
#include "core/vulkan/device.h"

namespace encore {

struct Frame {
  std::vector<Layer> layers;
  FilmImages images;  // of the whole window; empty where a TileSink took them
  Statistics statistics;
};

// Called from the rendering thread with pixels that are final, in the order of reuse tiles: a row of rects has
// one y0 and one height, and all of them together are the window, from whose upper left pixel they are counted.
// What it throws ends the frame.
using TileSink = std::function<void(FilmImages&&)>;

// Called from the rendering thread with the share of the frame that is done, in [0, 1], never falling.
// Returning false cancels: render() throws Error(Cancelled).
using Progress = std::function<bool(double done, const char* stage)>;

// What frames leave behind for those that follow (core/render/render_cache.h).
class RenderCache;

// Renders one frame on `device`. The scene is moved to the camera's origin while it renders and put back
// after it (see rebase()). cache: makes a frame faster by what it shares with frames before it, and changes nothing
// else; one frame at a time. Throws Error.
Frame render(Scene& scene, const Settings& settings, Device& device, const Progress& progress = {},
             const TileSink& sink = {}, RenderCache* cache = nullptr);

// How long Embree alone takes for the camera rays of a frame (see timeRawPrimaryRays()), scene built for it.
RawTrace timeRawRays(Scene& scene, const Settings& settings);

}  // namespace encore
