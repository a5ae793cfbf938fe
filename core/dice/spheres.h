// Points (UsdGeomPoints): spheres that are traced as such, and never diced.
//
// A primitive, within which shading is reused, is one sphere. Its parameters are the octahedral map of the unit normal
// (Q. Meyer et al., "On Floating-Point Normal Vectors", EGSR 2010), from [-1, 1]² moved to [0, 1]²: it has no poles,
// and nearly keeps shapes.
#pragma once

#include <array>

#include "core/dice/dice.h"
#include "core/scene/mesh.h"

namespace encore {

inline bool isSpheres(const DicedMesh& mesh) { return !mesh.spheres.empty(); }

// The unit normal at parameters, and how it changes with them.
struct SphereNormal {
  Vec3d n, du, dv;

  SphereNormal(double u, double v);
};
// The parameters of a direction, as its inverse.
std::array<double, 2> sphereParameters(Vec3d direction);

// Points whose width is 0 are not there. max_micropolygons: every point counts as one. Errors as diceMesh.
DicedMesh spheresOf(const Mesh& mesh, uint64_t max_micropolygons);

}  // namespace encore
