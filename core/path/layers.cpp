#include "core/path/path.h"

namespace encore {

namespace {

// Marks the materials that some face of the instance shows.
void markMaterials(const Scene& scene, const Instance& instance, std::vector<uint8_t>& used) {
  if (instance.material >= 0) {
    used[size_t(instance.material)] = 1;
    return;
  }
  for (const uint32_t index : scene.prototypes[instance.prototype].meshes) {
    const Mesh& mesh = scene.meshes[index];
    if (mesh.face_materials.empty()) used[size_t(mesh.material)] = 1;
    for (const int32_t material : mesh.face_materials) used[size_t(material >= 0 ? material : mesh.material)] = 1;
  }
}

std::vector<uint8_t> usedMaterials(const Scene& scene) {
  std::vector<uint8_t> used(scene.materials.size(), 0);
  for (const Instance& instance : scene.instances) markMaterials(scene, instance, used);
  return used;
}

}  // namespace

const char* layerName(Layer layer) {
  switch (layer) {
    case Layer::Direct:
      return "direct";
    case Layer::Reflection:
      return "reflection";
    case Layer::Refraction:
      return "refraction";
  }
  return "";
}

std::vector<Layer> sceneLayers(const Scene& scene, const Settings& settings) {
  std::vector<Layer> layers{Layer::Direct};
  if (settings.max_bounces == 0) return layers;  // the forced bounce of the others counts
  const std::vector<uint8_t> used = usedMaterials(scene);
  bool reflects = false, refracts = false;
  for (size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    reflects = reflects || feedsReflection(scene.materials[i], settings.roughness_limit);
    refracts = refracts || feedsRefraction(scene.materials[i]);
  }
  if (reflects) layers.push_back(Layer::Reflection);
  if (refracts) layers.push_back(Layer::Refraction);
  return layers;
}

bool passesThrough(const Scene& scene) {
  const std::vector<uint8_t> used = usedMaterials(scene);
  for (size_t i = 0; i < used.size(); ++i)
    if (used[i] && scene.materials[i].hasPresence()) return true;
  return false;
}

}  // namespace encore
