// Meshes that are not subdivided: polygons stay as they are (§4: "does not dice non-displaced polygons").
#pragma once

#include "core/dice/dice.h"
#include "core/scene/mesh.h"

namespace encore {

// Primitive i is face i, cut by triangulate() as the frame's pose asks for; keys of motion keep the cut.
// holeIndices belong to subdivision and mean nothing here (UsdGeomMesh).
DicedMesh undicedMesh(const Mesh& mesh);

}  // namespace encore
