// The parts of the Python module encore._core. Thin: arrays in, arrays out, errors translated.
#pragma once

#include "core/python/nanobind.h"

namespace encore::python {

void bindErrors(nanobind::module_& module);
void bindScene(nanobind::module_& module);
void bindRender(nanobind::module_& module);

}  // namespace encore::python
