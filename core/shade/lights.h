// Sampling and intersecting lights.
#pragma once

#include <span>

#include "core/scene/light.h"
#include "core/scene/math.h"

namespace encore {

struct LightSample {
  Vec3f direction;      // unit, towards the light
  float distance = 0;   // infinity for distant lights and domes
  Vec3f radiance;       // irradiance where pdf is 0 (a light of zero extent)
  float pdf = 0;        // per solid angle
  bool valid = false;
};

bool isDelta(const Light& light);
// A point on the light as seen from p with normal n; u in [0, 1)². Domes sample the cosine around n.
LightSample sampleLight(const Light& light, Vec3f p, Vec3f n, Vec2f u);
// Density with which sampleLight() would have chosen `direction`, if it hits the light.
float pdfLight(const Light& light, Vec3f p, Vec3f n, Vec3f direction);

// The nearest light that a ray meets before tfar, domes and distant disks at infinity included
// (only where tfar is infinite). Radiances of those at infinity add up.
struct LightHit {
  Vec3f radiance;
  float t = 0;
  bool valid = false;
};
LightHit intersectLights(std::span<const Light> lights, Vec3f origin, Vec3f direction, float tfar);

}  // namespace encore
