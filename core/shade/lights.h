// Sampling and intersecting lights.
#pragma once

#include <span>

#include "core/scene/light.h"
#include "core/scene/math.h"
#include "core/shade/light_image.h"
#include "core/shade/mesh_light.h"

namespace encore {

class LightSet;

struct LightSample {
  Vec3f direction;     // unit, towards the light
  float distance = 0;  // infinity for distant lights and domes
  Vec3f radiance;      // textured and shaped; irradiance where pdf is 0 (a light of zero extent)
  float pdf = 0;       // per solid angle
  bool valid = false;
};

// No extent: no ray can hit it, so shading evaluates every lobe under it.
bool isDelta(const Light& light);
bool anyDelta(std::span<const Light> lights);

// Where a ray meets a light.
struct LightPoint {
  float distance = -1;  // infinity for lights at infinity, negative for a miss
  Vec2f st;             // of rectangles: in [0, 1]², where a texture is looked up
};

// Rectangles and disks are met on the side that they emit to, spheres also from inside, cylinders from outside and on
// their round side only. Lights of zero extent never are, nor are meshes: tracing finds them.
LightPoint meetLight(const Light& light, Vec3f p, Vec3f direction);
float intersectLight(const Light& light, Vec3f p, Vec3f direction);  // its distance

// What arrives from a point that meetLight() found along `direction`. image: of a textured light; null: none.
Vec3f lightRadiance(const Light& light, const LightImage* image, const LightPoint& point, Vec3f direction);

// What sampling may need beyond the light itself.
struct LightParts {
  const LightImage* image = nullptr;  // of a textured rectangle or dome
  const MeshLight* mesh = nullptr;    // of a mesh
  const TraceScene* trace = nullptr;  // where the mesh is
  float time = 0;                     // of the shutter, for meshes
};

// One light as seen from one point: prepared once, sampled many times.
// Distant disks and spheres are sampled uniformly in the cone that they fill; rectangles uniformly in solid angle
// (Urena, Fajardo & King, EGSR 2013; in area where they are small or not rectangular); disks through the rectangle
// around them where they are large, else in area; cylinders by angle around and height along their axis, which is
// nearly solid angle; meshes by MeshLight. Domes by the cosine around n; textured ones by that or by brightness.
class LightSampler {
 public:
  // Keeps references. p: world space; n: unit normal that domes are sampled around.
  LightSampler(const Light& light, Vec3f p, Vec3f n, const LightParts& parts = {});

  // u in [0, 1)². Not valid: the light shows its dark side, has no extent where it should, or the sample missed it.
  LightSample sample(Vec2f u) const;
  // Density per solid angle with which sample() chooses `direction`; 0 if it misses the light, and for meshes.
  float pdf(Vec3f direction) const;
  const Light& light() const { return light_; }

 private:
  void prepareSphere();
  void prepareRect();
  void prepareDisk();
  void prepareCylinder();
  LightSample sampleCone(Vec2f u) const;
  LightSample sampleRect(Vec2f u) const;
  LightSample sampleDisk(Vec2f u) const;
  LightSample sampleCylinder(Vec2f u) const;
  LightSample sampleMesh(Vec2f u) const;
  LightSample sampleDome(Vec2f u) const;
  Vec2f rectPoint(Vec2f u) const;
  Vec2f rectTexture(Vec2f q) const;
  float areaPdf(float distance) const;
  struct Strip;  // of a cylinder
  Strip strip(float angle) const;
  float pdfCylinder(Vec3f direction) const;
  Vec3f toDome(Vec3f direction) const;
  LightSample emitted(Vec3f direction, float distance, float pdf, Vec2f st = {}) const;

  const Light& light_;
  Vec3f p_;
  LightParts parts_;
  bool dark_ = false;
  // Cones: z is the axis; domes: n; rectangles and disks: along their edges, z towards p; cylinders: x is the axis, z
  // towards the axis from p.
  Basis basis_{{0, 0, 1}};
  // Cones: 1 - cosine of the half angle (free of cancellation), distance to a sphere's centre.
  float cap_ = 0, centre_distance_ = 0;
  // Rectangles: bounds in basis_ relative to p, and height of p over the plane. A parallelogram that is not
  // a rectangle has half_v_ skewed by shear_ along x. Disks: of the rectangle around them.
  float x0_ = 0, x1_ = 0, y0_ = 0, y1_ = 0, height_ = 0, area_ = 0, shear_ = 0;
  // Spherical rectangle; solid_angle_ 0: sampled in area. Names are the paper's.
  float solid_angle_ = 0, k_ = 0, b0_ = 0, b1_ = 0;
  // Cylinders: x0_ and x1_ are the ends, height_ is the distance of p from the axis; half of the angle that they fill
  // across it.
  float half_angle_ = 0;
};

// The same for one sample.
LightSample sampleLight(const Light& light, Vec3f p, Vec3f n, Vec2f u);
float pdfLight(const Light& light, Vec3f p, Vec3f n, Vec3f direction);

// The nearest light that a ray meets before tfar, domes and distant disks at infinity included
// (only where tfar is infinite). Radiances of those at infinity add up. Shaping and textures count; what a light is
// linked to does not: whoever looks along the ray is not known.
struct LightHit {
  Vec3f radiance;
  Vec3f specular_radiance;  // times the lights' specular multipliers: what reflections show
  float t = 0;
  bool valid = false;
};
// set: holds the textures of `lights`, which are some of the scene's (ShadeContext::lights).
LightHit intersectLights(const LightSet& set, std::span<const Light> lights, Vec3f origin, Vec3f direction, float tfar);

}  // namespace encore
