// _core.Scene: textures and materials.
#include <algorithm>
#include <memory>

#include "core/python/bindings.h"
#include "core/python/dictionaries.h"
#include "core/python/fields.h"
#include "core/scene/scene.h"

namespace encore::python {
namespace {

using PixelArray = nb::ndarray<const float, nb::shape<-1, -1, 4>, nb::c_contig, nb::device::cpu>;

size_t addTexture(Scene& scene, std::string path, const PixelArray& pixels) {
  Texture texture{std::move(path), uint32_t(pixels.shape(1)), uint32_t(pixels.shape(0)), {}, {}};
  texture.rgba.assign(pixels.data(), pixels.data() + pixels.size());
  scene.textures.push_back(std::move(texture));
  return scene.textures.size() - 1;
}

// Pixels from a Python function; the interpreter's lock is taken for each call.
class PythonSource : public TextureSource {
 public:
  PythonSource(std::string path, uint32_t width, uint32_t height, nb::object read, nb::object reused)
      : path_(std::move(path)), width_(width), height_(height), read_(std::move(read)), reused_(std::move(reused)) {}
  ~PythonSource() override {
    const nb::gil_scoped_acquire lock;
    read_.reset();
    reused_.reset();
  }
  PythonSource(const PythonSource&) = delete;
  PythonSource& operator=(const PythonSource&) = delete;

  void read(std::span<uint16_t> rgba) const override {
    const nb::gil_scoped_acquire lock;
    const nb::object numpy = nb::module_::import_("numpy");
    const nb::object array = numpy.attr("ascontiguousarray")(read_(), numpy.attr("float16"));
    using Halves = nb::ndarray<const uint16_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
    const auto halves = nb::cast<Halves>(array.attr("view")(numpy.attr("uint16")));
    if (halves.shape(0) != height_ || halves.shape(1) != width_ || halves.shape(2) != 4)
      throw Error(ErrorKind::Scene, "the texture changed its size while it was read", path_, "Do not write to it");
    std::copy_n(halves.data(), std::min(halves.size(), rgba.size()), rgba.begin());
  }
  void reused() const override {
    const nb::gil_scoped_acquire lock;
    if (!reused_.is_none()) reused_();
  }

 private:
  std::string path_;
  uint32_t width_, height_;
  nb::object read_, reused_;
};

Texture makeTexture(std::string path, uint32_t width, uint32_t height, nb::object read, nb::object reused) {
  Texture texture{path, width, height, {}, {}};
  texture.source = std::make_shared<PythonSource>(std::move(path), width, height, std::move(read), std::move(reused));
  return texture;
}

size_t addTextureHandle(Scene& scene, const Texture& texture) {
  scene.textures.push_back(texture);
  return scene.textures.size() - 1;
}

size_t addTextureSource(Scene& scene, std::string path, uint32_t width, uint32_t height, nb::object read) {
  return addTextureHandle(scene, makeTexture(std::move(path), width, height, std::move(read), nb::none()));
}

PatternNode toNode(nb::handle source) {
  nb::dict d = copyOf(source);
  PatternNode node;
  take(d, "path", node.path);
  takeField(d, "kind", node.kind, node.path);
  forEachNodeField(node, [&](const char* key, auto& field) { takeField(d, key, field, node.path); });
  requireEmpty(d, node.path);
  return node;
}

void toValue(nb::handle source, float& value) { value = nb::cast<float>(source); }
void toValue(nb::handle source, Vec3f& value) { value = toVec(nb::cast<Triple>(source)); }
// A number, or up to four of them.
void toValue(nb::handle source, Vec4f& value) {
  std::vector<float> numbers;
  if (float number = 0; nb::try_cast<float>(source, number, true))
    numbers = {number};
  else
    numbers = nb::cast<std::vector<float>>(source);
  numbers.resize(4, 0.0f);
  value = {numbers[0], numbers[1], numbers[2], numbers[3]};
}

// A constant, or {'value': constant, 'node': index, 'channel': first channel}.
template <class T>
void toInput(nb::handle source, Input<T>& input) {
  if (!nb::isinstance<nb::dict>(source)) return toValue(source, input.value);
  const nb::dict d = nb::cast<nb::dict>(source);
  input.node = nb::cast<int32_t>(nb::object(d["node"]));
  input.channel = nb::cast<int32_t>(nb::object(d["channel"]));
  toValue(nb::object(d["value"]), input.value);
}
template <class T>
void takeInput(nb::dict& inputs, const char* key, Input<T>& input) {
  if (!inputs.contains(key)) return;
  const nb::object source(inputs[key]);
  nb::del(inputs[key]);
  toInput(source, input);
}

// {'path', 'file', 'source', 'parameters': [{'name', 'type', 'input'}]}
std::optional<GlslShader> toShader(const std::optional<nb::dict>& source) {
  if (!source) return {};
  nb::dict d = copyOf(*source);
  GlslShader shader;
  take(d, "path", shader.path);
  take(d, "file", shader.file);
  take(d, "source", shader.source);
  nb::list parameters;
  take(d, "parameters", parameters);
  requireEmpty(d, shader.path);
  for (nb::handle given : parameters) {
    nb::dict p = copyOf(given);
    GlslParameter& parameter = shader.parameters.emplace_back();
    take(p, "name", parameter.name);
    take(p, "type", parameter.type);
    takeInput(p, "input", parameter.input);
    requireEmpty(p, shader.path + ".inputs:" + parameter.name);
  }
  return shader;
}

size_t addMaterial(Scene& scene, std::string path, const nb::dict& inputs, const nb::list& nodes,
                   bool use_specular_workflow, float opacity_threshold, const std::string& opacity_mode,
                   int32_t dielectric_priority, const std::optional<nb::dict>& surface_shader,
                   const std::optional<nb::dict>& displacement_shader) {
  Material material;
  material.path = std::move(path);
  material.use_specular_workflow = use_specular_workflow;
  material.opacity_threshold = opacity_threshold;
  material.opacity_mode = fromName(kOpacityModes, opacity_mode, material.path + ".inputs:opacityMode");
  material.dielectric_priority = dielectric_priority;
  material.surface_shader = toShader(surface_shader);
  material.displacement_shader = toShader(displacement_shader);
  for (nb::handle node : nodes) material.nodes.push_back(toNode(node));
  nb::dict d = copyOf(inputs);
  forEachMaterialInput(material, [&](const char* key, auto& input) { takeInput(d, key, input); });
  requireEmpty(d, material.path);
  scene.materials.push_back(std::move(material));
  return scene.materials.size() - 1;
}

}  // namespace

void bindMaterials(nb::module_& module, nb::class_<Scene>& scene) {
  nb::class_<Texture>(module, "Texture",
                      "A texture that scenes can take again and again. Frames that follow one another with one\n"
                      "RenderCache read it once.")
      .def(
          "__init__",
          [](Texture* self, std::string path, uint32_t width, uint32_t height, nb::object read, nb::object reused) {
            new (self) Texture(makeTexture(std::move(path), width, height, std::move(read), std::move(reused)));
          },
          nb::arg("path"), nb::arg("width"), nb::arg("height"), nb::arg("read"), nb::arg("reused") = nb::none(),
          "read(): (height, width, 4) float16, linear, bottom row first; always the same. It may be called from\n"
          "another thread. reused(): called instead by frames that still have what it gave, so that it can report\n"
          "again what it found.")
      .def_ro("path", &Texture::path)
      .def_ro("width", &Texture::width)
      .def_ro("height", &Texture::height);
  scene.def("add_texture", &addTextureHandle, nb::arg("texture"), "Adds a texture; its index.");
  scene.def("add_texture", &addTexture, nb::arg("path"), nb::arg("pixels"),
            "Adds linear pixels (height, width, 4) float32, bottom row first; the texture's index.");
  scene.def(
      "add_texture_source", &addTextureSource, nb::arg("path"), nb::arg("width"), nb::arg("height"), nb::arg("read"),
      "Adds a texture whose pixels are read when they are wanted; its index. read(): (height, width, 4) float16,\n"
      "linear, bottom row first; always the same. It may be called from another thread.");
  scene.def("add_material", &addMaterial, nb::arg("path"), nb::arg("inputs") = nb::dict(),
            nb::arg("nodes") = nb::list(), nb::arg("use_specular_workflow") = false,
            nb::arg("opacity_threshold") = 0.0f, nb::kw_only(), nb::arg("opacity_mode") = "transparent",
            nb::arg("dielectric_priority") = 0, nb::arg("surface_shader") = nb::none(),
            nb::arg("displacement_shader") = nb::none(),
            "Adds a material; its index. inputs: fields of UsdPreviewSurface in snake case, each a constant or\n"
            "{'value', 'node', 'channel'}; nodes: dictionaries with the fields of core's PatternNode.\n"
            "Shaders: {'path', 'file', 'source', 'parameters': [{'name', 'type', 'input'}]}, GLSL of docs/glsl.md.");
}

}  // namespace encore::python
