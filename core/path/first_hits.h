// First hits that are more than one ray: behind what has presence or cut-outs.
#pragma once

#include "core/path/pass_through.h"
#include "core/path/path.h"

namespace encore {

// The ray of a first hit on its way. spreads: its differentials will be asked for.
Passage cameraPassage(const CameraRays& camera, const FirstHit& first, bool spreads);

}  // namespace encore
