// Meshes that are not subdivided: polygons stay as they are (§4: "does not dice non-displaced polygons").
#pragma once

#include "core/dice/dice.h"
#include "core/scene/mesh.h"

namespace encore {

// Primitive i is face i. Triangles: (u, v) = (0,0) (1,0) (0,1). Quads: (0,0) (1,0) (1,1) (0,1), cut from
// corner 0 to corner 2 unless that would fold a concave quad, which is cut from 1 to 3. More corners: ear
// clipping; (u, v) are coordinates in the best-fit plane, the longer side of their bounds scaled to 1.
// holeIndices belong to subdivision and mean nothing here (UsdGeomMesh).
DicedMesh undicedMesh(const Mesh& mesh);

}  // namespace encore
