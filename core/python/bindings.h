// The parts of the Python module encore._core. Thin: arrays in, arrays out, errors translated.
#pragma once

#include "core/python/nanobind.h"
#include "core/scene/scene.h"

namespace encore::python {

void bindErrors(nanobind::module_& module);
void bindScene(nanobind::module_& module);
// Parts of bindScene().
void bindMeshes(nanobind::module_& module, nanobind::class_<Scene>& scene);
void bindMaterials(nanobind::module_& module, nanobind::class_<Scene>& scene);
void bindLights(nanobind::class_<Scene>& scene);
void bindRender(nanobind::module_& module);

}  // namespace encore::python
