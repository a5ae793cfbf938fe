// Directional albedo of rough interfaces: the share of the light from all around that one bounce off the
// microfacets sends to the viewer. What lies below gets the rest, so that energy neither grows nor fades
// with roughness. The Fresnel reflectance at the macroscopic normal would not do: at roughness 0.5 and
// ior 1.5 it takes 0.57 from a view cosine of 0.1, where the interface gives back 0.17.
// Tables are integrated when first asked for (some 40 ms): scenes without rough interfaces never do.
#pragma once

#include "core/scene/math.h"

namespace encore {

// Exact dielectric, seen from the rarer side. cos_theta in (0, 1], alpha in [0, 1], eta: far over near, in [1, 100].
float dielectricAlbedo(float cos_theta, float alpha, float eta);
// Schlick's formula with f90 = 1.
Vec3f schlickAlbedo(float cos_theta, float alpha, Vec3f f0);
// Microfacets that reflect all: 1 minus it is what is lost among them.
float microfacetAlbedo(float cos_theta, float alpha);

}  // namespace encore
