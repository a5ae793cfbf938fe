// What displacement patterns read at the vertices of a diced mesh.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/dice/dice.h"
#include "core/dice/grids.h"
#include "core/pattern/patterns.h"
#include "core/scene/mesh.h"

namespace encore {

// Whether a material's displacement depends on the mesh's pose.
bool readsPose(const PointLayout& layout);

// Writes the floats of all vertices of a primitive, layout.size each. Texture coordinates change over one spacing of
// vertices in u and in v, so that displacement maps are filtered to what the grid can show.
// pose: of core/dice/poses.h. normals: per vertex, those that displacement goes along in that pose.
void fillDisplacementPoints(const Mesh& mesh, const DicedMesh& diced, const Grids& grids, size_t pose,
                            std::span<const Vec3f> normals, size_t primitive, const PointLayout& layout, float* data);

}  // namespace encore
