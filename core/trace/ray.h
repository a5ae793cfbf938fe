// Rays and hits.
#pragma once

#include <cstdint>
#include <limits>

#include "core/scene/math.h"
#include "shaders/records.h"

namespace encore {

struct Ray {
  Vec3f origin;
  float tnear = 0;
  Vec3f direction;  // unit
  float tfar = std::numeric_limits<float>::infinity();
  float time = 0;  // 0: shutter open, 1: shutter close
};

// The closest surface along a ray; instance == kNoInstance: none.
struct Hit {
  uint32_t instance = kNoInstance;  // index into Scene::instances
  uint32_t mesh = 0;                // index into Prototype::meshes of the instance's prototype
  uint32_t triangle = 0;            // of that mesh's DicedMesh
  float b1 = 0, b2 = 0;             // barycentric coordinates of the triangle's second and third vertex
  float t = std::numeric_limits<float>::infinity();
  float time = 0;  // of the ray

  bool valid() const { return instance != kNoInstance; }
};

// How alike the rays of a packet are. It changes speed, and in rare ties the answer: it must depend
// on nothing but the block that the rays belong to.
enum class Coherence { Coherent, Incoherent };

}  // namespace encore
