// encore._core: the renderer as Python sees it.
#include "core/python/bindings.h"
#include "core/python/names.h"
#include "core/python/nanobind.h"
#include "core/scene/error.h"

namespace encore::python {

namespace nb = nanobind;

namespace {

void setAttribute(PyObject* object, const char* name, const std::string& value) {
  PyObject* text = PyUnicode_DecodeUTF8(value.data(), Py_ssize_t(value.size()), "replace");
  if (!text || PyObject_SetAttrString(object, name, text) != 0) PyErr_Clear();
  Py_XDECREF(text);
}

// encore::Error → _core.Error with the attributes kind, where and remedy.
void translate(const std::exception_ptr& pointer, void* type) {
  try {
    std::rethrow_exception(pointer);
  } catch (const Error& error) {
    const std::string what = error.what();
    PyObject* message = PyUnicode_DecodeUTF8(what.data(), Py_ssize_t(what.size()), "replace");
    PyObject* object = message ? PyObject_CallOneArg(static_cast<PyObject*>(type), message) : nullptr;
    Py_XDECREF(message);
    if (!object) return;
    setAttribute(object, "kind", toName(kErrorKinds, error.kind()));
    setAttribute(object, "where", error.where());
    setAttribute(object, "remedy", error.remedy());
    PyErr_SetObject(static_cast<PyObject*>(type), object);
    Py_DECREF(object);
  }
}

}  // namespace

void bindErrors(nb::module_& module) {
  PyObject* type = PyErr_NewExceptionWithDoc(
      "encore._core.Error",
      "What went wrong, where, and what to do about it.\n\n"
      "kind: 'scene', 'setting', 'device', 'memory', 'cancelled' or 'internal'. where: a prim path (and attribute)\n"
      "or the name of a setting. remedy: what to do. Both may be empty. str(): all of it in one line.",
      nullptr, nullptr);
  if (!type) throw nb::python_error();
  // The module keeps the type alive as long as the translator can be called.
  module.attr("Error") = nb::steal(type);
  nb::register_exception_translator(translate, type);
}

}  // namespace encore::python

NB_MODULE(_core, module) {
  module.doc() = "The renderer: scenes as plain validated descriptions, devices, and render().";
  encore::python::bindErrors(module);
  encore::python::bindScene(module);
  encore::python::bindRender(module);
}
