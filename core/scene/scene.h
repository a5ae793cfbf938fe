// What is to be rendered, as plain validated descriptions. No USD, no Embree, no Vulkan.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/light.h"
#include "core/scene/material.h"
#include "core/scene/math.h"
#include "core/scene/mesh.h"
#include "core/scene/settings.h"

namespace encore {

// Meshes that are placed together; all of their points are in the prototype's space.
struct Prototype {
  std::string path;
  std::vector<uint32_t> meshes;  // indices into Scene::meshes
};

// A primvar that an instance gives to what is placed. name: index into Scene::instance_primvars.
struct InstancePrimvar {
  uint32_t name = 0;
  bool wins = false;  // over the meshes' own of this name (a PointInstancer's), and not the other way round
  Vec4f value{0, 0, 0, 0};
};

struct Instance {
  std::string path;
  uint32_t prototype = 0;
  Affine3d to_world;  // at the frame's time
  // Transforms at uniform times from shutter open to close, two or more; between them matrices are interpolated
  // linearly, so that keys of a turning thing must be dense. Empty: it does not move.
  std::vector<Affine3d> motion;
  int32_t material = -1;                    // overrides the meshes' materials when not negative
  LayerRates shading_rate{};                // overrides the meshes' where above 0
  int32_t link_group = -1;                  // overrides the meshes' when not negative
  std::vector<InstancePrimvar> primvars{};  // read as display_color, texture coordinates and primvars are, by name
};

// Keys of motion, at most: Embree's time steps.
inline constexpr size_t kMaxMotionKeys = 129;

struct Scene {
  std::vector<Mesh> meshes;
  std::vector<Prototype> prototypes;
  std::vector<Instance> instances;
  std::vector<std::string> instance_primvars;  // names, each once; "displayColor" is display_color
  std::vector<Texture> textures;
  std::vector<Material> materials;  // material 0 exists
  std::vector<Light> lights;
  Camera camera;
  Vec3d origin{0, 0, 0};  // of these coordinates in the world: what rebase() has taken off

  // Something moves while the shutter is open: rays have times.
  bool moves() const;

  // Throws Error(Scene) that names the prim path, the attribute, what was found and what to do.
  // After it, indices are in range, arrays have the sizes their interpolation asks for, all numbers
  // are finite, transforms are invertible, and there is at least one face to render.
  void validate() const;
};

// One mesh's part of validate(), so that callers can drop and report a single bad mesh. Of meshes with an identity only
// what it does not stand for is looked at.
void validateMesh(const Mesh& mesh, size_t material_count);
// Validates what does not depend on the scene, as validateMesh() does, and gives the mesh an identity of its own.
void identify(Mesh& mesh);

// The same scene with `origin` moved to (0, 0, 0): keeps float32 world coordinates accurate near the
// camera however far from the world's origin the shot takes place. origin must be representable exactly
// enough for subtraction in double; instances, lights and camera move, prototypes do not.
void rebase(Scene& scene, Vec3d origin);

}  // namespace encore
