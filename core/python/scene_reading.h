// The scene as Python dictionaries: what the delegate's canonical text is made from. Arrays are copies.
#pragma once

#include "core/python/nanobind.h"
#include "core/scene/scene.h"

namespace encore::python {

nanobind::dict readMesh(const Mesh& mesh);
nanobind::dict readInstance(const Scene& scene, const Instance& instance);
nanobind::dict readTexture(const Texture& texture);
nanobind::dict readMaterial(const Material& material);
nanobind::dict readLight(const Light& light);
nanobind::dict readCamera(const Camera& camera);

}  // namespace encore::python
