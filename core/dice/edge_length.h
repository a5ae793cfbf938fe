// Which edge length each mesh of a scene is diced at.
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "core/scene/settings.h"

namespace encore {

// Per mesh, in prototype space: its own target edge length, else the frame's, else the default, divided by
// its largest scale over all instances and their motion. Where those scale it differently, the scale is rounded up to a
// power of two, so that one growing or shrinking instance does not change the dicing of every frame.
// Scales are rounded by less than 1e-5, and the diagonal of the scene, which the default depends on, to a quarter of an
// octave, so that lengths are the same to the last bit when things turn or move a little, or the camera does.
// 0 for meshes that no instance shows.
std::vector<float> resolvedEdgeLengths(const Scene& scene, const Settings& settings);

}  // namespace encore
