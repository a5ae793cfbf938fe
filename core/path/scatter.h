// What happens to a path at a hit: one effect is chosen, and followed where it is a bounce (Listing 2, 3-12).
#pragma once

#include "core/path/path.h"
#include "core/path/path_random.h"
#include "core/shade/bsdf.h"

namespace encore {

enum class Effect { Absorb, Reflect, Refract };

// A surface as an arriving path sees it: normals on the side it comes from.
struct Arrival {
  SurfacePoint point;
  Vec3f wo;           // unit, back along the ray
  Vec3f ng;           // geometric normal
  Vec3f n, dn1, dn2;  // shading normal and its change along the triangle's edges
  Lobes lobes;
  bool view_weight_in_shading = false;

  EffectWeights weights() const { return effectWeights(lobes, dot(wo, n), view_weight_in_shading); }
};
// Where the shading normal turns away from the path (as it may at silhouettes), n is ng.
// lobes: for point.side.
Arrival arrive(const SurfacePoint& point, Vec3f direction, const Lobes& lobes, bool view_weight_in_shading);

// No light but what shading evaluates: absorption is 1 and the other effects are 0, whatever the view.
bool absorbsAll(const Lobes& lobes, bool view_weight_in_shading);

// Each effect is chosen with the share of its largest channel. probability 0: nothing is left to follow.
struct ChosenEffect {
  Effect effect = Effect::Absorb;
  float probability = 0;
};
ChosenEffect chooseEffect(const EffectWeights& weights, const BounceRandom& random);

// A ray that leaves an arrival.
struct Departure {
  Vec3f direction, weight;
  Vec3f normal;  // that it was bent about, on the side of the arrival
  Vec3f dn1, dn2;
  float lobe_width = 0;  // radians; 0: the lobe is smooth
  bool valid = false;
};
// effect: Reflect or Refract. The result lies on the right side of the geometric surface: where the shading
// normal would send it to the other one, the geometric normal is used instead.
Departure depart(const Arrival& arrival, Effect effect, const BounceRandom& random);

}  // namespace encore
