// Sampling and intersecting lights.
#pragma once

#include <span>

#include "core/scene/light.h"
#include "core/scene/math.h"

namespace encore {

struct LightSample {
  Vec3f direction;     // unit, towards the light
  float distance = 0;  // infinity for distant lights and domes
  Vec3f radiance;      // irradiance where pdf is 0 (a light of zero extent)
  float pdf = 0;       // per solid angle
  bool valid = false;
};

// No extent: no ray can hit it, so shading evaluates every lobe under it.
bool isDelta(const Light& light);
bool anyDelta(std::span<const Light> lights);

// Distance at which a ray from p meets the light: infinity for lights at infinity, negative for a miss.
// Rectangles are met on the side that they emit to, spheres also from inside; lights of zero extent never.
float intersectLight(const Light& light, Vec3f p, Vec3f direction);

// One light as seen from one point: prepared once, sampled many times.
// Distant disks and spheres are sampled uniformly in the cone that they fill, rectangles uniformly in solid
// angle (Urena, Fajardo & King, EGSR 2013; in area where they are small or not rectangular), domes by the
// cosine around n.
class LightSampler {
 public:
  // Keeps a reference to light. p: world space; n: unit normal that domes are sampled around.
  LightSampler(const Light& light, Vec3f p, Vec3f n);

  // u in [0, 1)². Not valid: the light shows its dark side, or has no extent where it should.
  LightSample sample(Vec2f u) const;
  // Density per solid angle with which sample() chooses `direction`; 0 if it misses the light.
  float pdf(Vec3f direction) const;
  const Light& light() const { return light_; }

 private:
  void prepareSphere();
  void prepareRect();
  LightSample sampleCone(Vec2f u) const;
  LightSample sampleRect(Vec2f u) const;
  Vec2f rectPoint(Vec2f u) const;

  const Light& light_;
  Vec3f p_;
  bool dark_ = false;
  Basis basis_{{0, 0, 1}};  // cones: z is the axis; domes: n; rectangles: along its edges, z towards p
  // Cones: 1 - cosine of the half angle (free of cancellation), distance to a sphere's centre.
  float cap_ = 0, centre_distance_ = 0;
  // Rectangles: bounds in basis_ relative to p, and height of p over the plane. A parallelogram that is not
  // a rectangle has half_v_ skewed by shear_ along x.
  float x0_ = 0, x1_ = 0, y0_ = 0, y1_ = 0, height_ = 0, area_ = 0, shear_ = 0;
  // Spherical rectangle; solid_angle_ 0: sampled in area. Names are the paper's.
  float solid_angle_ = 0, k_ = 0, b0_ = 0, b1_ = 0;
};

// The same for one sample.
LightSample sampleLight(const Light& light, Vec3f p, Vec3f n, Vec2f u);
float pdfLight(const Light& light, Vec3f p, Vec3f n, Vec3f direction);

// The nearest light that a ray meets before tfar, domes and distant disks at infinity included
// (only where tfar is infinite). Radiances of those at infinity add up.
struct LightHit {
  Vec3f radiance;
  Vec3f specular_radiance;  // times the lights' specular multipliers: what reflections show
  float t = 0;
  bool valid = false;
};
LightHit intersectLights(std::span<const Light> lights, Vec3f origin, Vec3f direction, float tfar);

}  // namespace encore
