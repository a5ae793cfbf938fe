// _core.devices, create_device and render.
#include <embree3/rtcore.h>
#include <opensubdiv/version.h>

#include <array>
#include <exception>
#include <functional>
#include <memory>
#include <type_traits>

#include "core/python/arrays.h"
#include "core/python/bindings.h"
#include "core/python/names.h"
#include "core/render/render_cache.h"
#include "core/render/render_loop.h"

namespace encore::python {
namespace {

// OpenSubdiv's 30500 is 3.5.0.
std::string versionText(int number) {
  return std::to_string(number / 10000) + "." + std::to_string(number / 100 % 100) + "." + std::to_string(number % 100);
}

nb::dict readInfo(const DeviceInfo& info) {
  nb::dict d;
  d["name"] = info.name;
  d["driver"] = info.driver;
  d["cpu"] = info.cpu;
  d["shared_memory"] = info.shared_memory;
  d["subgroup_size"] = info.subgroup_size;
  d["memory_bytes"] = info.memory_bytes;
  return d;
}

// Reads the value of one settings key into the field. Throws Error(Setting).
template <class T>
  requires std::is_enum_v<T>
void convert(const std::string& key, nb::handle value, T& field) {
  field = fromName(namesOf(field), nb::cast<std::string>(nb::str(value)), key, ErrorKind::Setting);
}
template <class T>
  requires(!std::is_enum_v<T>)
void convert(const std::string& key, nb::handle value, T& field) {
  bool valid = true;
  if constexpr (std::is_same_v<T, bool>)
    valid = PyBool_Check(value.ptr());
  else if constexpr (std::is_integral_v<T>)
    valid = PyLong_Check(value.ptr()) && !PyBool_Check(value.ptr());
  if (!valid || !nb::try_cast<T>(value, field, true)) {
    const char* expected = std::is_same_v<T, std::string> ? "text"
                           : std::is_same_v<T, bool>      ? "True or False"
                           : std::is_integral_v<T>        ? "a whole number, from 0"
                                                          : "a number";
    throw Error(ErrorKind::Setting, "value " + nb::cast<std::string>(nb::repr(value)) + " cannot be used", key,
                std::string("Give ") + expected);
  }
}

// Calls visit(name, field) for every field of the settings.
template <class S, class Visit>
void forEachField(S& s, const Visit& visit) {
  visit("method", s.method);
  visit("width", s.width);
  visit("height", s.height);
  visit("samples", s.samples);
  visit("shading_rate", s.shading_rate);
  visit("shading_rate_reflection", s.shading_rate_reflection);
  visit("shading_rate_refraction", s.shading_rate_refraction);
  visit("max_bounces", s.max_bounces);
  visit("filter", s.filter);
  visit("filter_radius_pixels", s.filter_radius_pixels);
  visit("target_edge_length_world", s.target_edge_length_world);
  visit("edge_length_scale", s.edge_length_scale);
  visit("max_micropolygons", s.max_micropolygons);
  visit("light_samples", s.light_samples);
  visit("occlusion_samples", s.occlusion_samples);
  visit("most_light_samples", s.most_light_samples);
  visit("occlusion_distance_world", s.occlusion_distance_world);
  visit("glass_shadows", s.glass_shadows);
  visit("energy_compensation", s.energy_compensation);
  visit("texture_budget_bytes", s.texture_budget_bytes);
  visit("shader_cache", s.shader_cache);
  visit("seed", s.seed);
  visit("reuse_tile_pixels", s.reuse_tile_pixels);
  visit("search", s.search);
  visit("footprint_reuse", s.footprint_reuse);
  visit("footprint_weight", s.footprint_weight);
  visit("reuse_time_weight", s.reuse_time_weight);
  visit("reuse_direction_weight", s.reuse_direction_weight);
  visit("max_reuse_distance", s.max_reuse_distance);
  visit("world_space_parameters", s.world_space_parameters);
  visit("debug_aovs", s.debug_aovs);
  visit("memory_budget_bytes", s.memory_budget_bytes);
  visit("threads", s.threads);
  visit("dome_light_visible", s.dome_light_visible);
  visit("lights_visible", s.lights_visible);
  visit("roughness_limit", s.roughness_limit);
}

// None: the image.
Window toWindow(nb::handle value) {
  if (value.is_none()) return {};
  std::array<int32_t, 4> w{};
  if (!nb::try_cast(value, w) || w[2] <= w[0] || w[3] <= w[1])
    throw Error(ErrorKind::Setting, "value " + nb::cast<std::string>(nb::repr(value)) + " cannot be used", "window",
                "Give pixels (x0, y0, x1, y1) with x0 < x1 and y0 < y1, or None");
  return {w[0], w[1], w[2], w[3]};
}

Aov toAov(nb::handle value) {
  if (!nb::isinstance<nb::dict>(value))
    throw Error(ErrorKind::Setting, "value " + nb::cast<std::string>(nb::repr(value)) + " cannot be used", "aovs",
                "Give dictionaries with 'kind' and 'name'");
  Aov aov;
  for (const auto& [key, field] : nb::cast<nb::dict>(value)) {
    const std::string name = nb::cast<std::string>(nb::str(key));
    const std::string where = "aovs." + name;
    if (name == "kind")
      convert(where, field, aov.kind);
    else if (name == "name")
      convert(where, field, aov.name);
    else if (name == "primvar")
      convert(where, field, aov.primvar);
    else if (name == "components")
      convert(where, field, aov.components);
    else
      throw Error(ErrorKind::Setting, "there is no such field", where, "Give kind, name, primvar or components");
  }
  return aov;
}

// What is not a number, a text or a choice. False: there is no such setting.
bool convertList(const std::string& name, nb::handle value, Settings& settings) {
  if (name == "window") {
    settings.window = toWindow(value);
    return true;
  }
  if (name != "aovs") return false;
  if (value.is_none()) return true;
  for (const nb::handle aov : value) settings.aovs.push_back(toAov(aov));
  return true;
}

Settings toSettings(const nb::dict& given) {
  Settings settings;
  for (const auto& [key, value] : given) {
    const std::string name = nb::cast<std::string>(nb::str(key));
    bool found = convertList(name, value, settings);
    forEachField(settings, [&](const char* field_name, auto& field) {
      if (name != field_name) return;
      found = true;
      convert(name, value, field);
    });
    if (!found) throw Error(ErrorKind::Setting, "there is no such setting", name, "See core/scene/settings.h");
  }
  return settings;
}

nb::dict readSettings(const Settings& settings) {
  nb::dict d;
  forEachField(settings, [&](const char* name, const auto& field) {
    if constexpr (std::is_enum_v<std::decay_t<decltype(field)>>)
      d[name] = toName(namesOf(field), field);
    else
      d[name] = field;
  });
  return d;
}

nb::dict readStatistics(const Statistics& statistics) {
  nb::dict d, layers, kernels;
  d["device"] = statistics.device;
  d["driver"] = statistics.driver;
  d["threads"] = statistics.threads;
  d["primitives"] = statistics.primitives;
  d["micropolygons"] = statistics.micropolygons;
  d["pixels"] = statistics.pixels;
  d["antialiasing_samples"] = statistics.antialiasing_samples;
  d["rays_traced"] = statistics.rays_traced;
  d["non_finite_samples"] = statistics.non_finite_samples;
  d["peak_memory_bytes"] = statistics.peak_memory_bytes;
  d["device_peak_bytes"] = statistics.device_peak_bytes;
  d["geometry_bytes"] = statistics.geometry_bytes;
  d["texture_bytes"] = statistics.texture_bytes;
  d["time_s"] = statistics.time_s;
  for (const auto& [name, layer] : statistics.layers) {
    nb::dict l;
    l["shading_evaluations"] = layer.shading_evaluations;
    l["reshading_evaluations"] = layer.reshading_evaluations;
    l["failed_samples"] = layer.failed_samples;
    l["antialiasing_samples"] = layer.antialiasing_samples;
    l["trace_s"] = layer.trace_s;
    l["shade_s"] = layer.shade_s;
    l["reuse_s"] = layer.reuse_s;
    l["film_s"] = layer.film_s;
    l["search"] = toName(kSearches, layer.search);
    layers[name.c_str()] = l;
  }
  d["layers"] = layers;
  for (const auto& [name, timing] : statistics.kernels) {
    nb::dict k;
    k["dispatches"] = timing.dispatches;
    k["seconds"] = timing.seconds;
    kernels[name.c_str()] = k;
  }
  d["kernels"] = kernels;
  d["warnings"] = statistics.warnings;
  return d;
}

nb::object readAov(AovImage&& image, size_t height, size_t width) {
  if (image.values.empty()) return toNumpy(std::move(image.ids), {height, width});
  return toNumpy(std::move(image.values), {height, width, size_t{image.components}});
}

// How the images of a frame are called.
struct ImageNames {
  std::vector<Layer> layers;
  std::vector<Aov> aovs;
};

// The arrays take over the images' memory.
nb::dict readImages(FilmImages&& images, const ImageNames& names) {
  const size_t height = images.rect.height(), width = images.rect.width();
  nb::dict layers, debug, aovs, d;
  for (size_t i = 0; i < images.layers.size(); ++i)
    layers[layerName(names.layers[i])] = toNumpy(std::move(images.layers[i]), {height, width});
  d["layers"] = layers;
  d["composite"] = toNumpy(std::move(images.composite), {height, width});
  d["alpha"] = toNumpy(std::move(images.alpha), {height, width});
  d["depth"] = toNumpy(std::move(images.depth), {height, width});
  d["normal"] = toNumpy(std::move(images.normal), {height, width});
  for (size_t i = 0; i < images.debug.size(); ++i) {
    DebugImages& from = images.debug[i];
    nb::dict l;
    l["evaluations"] = toNumpy(std::move(from.evaluations), {height, width});
    l["reshaded"] = toNumpy(std::move(from.reshaded), {height, width});
    l["distance"] = toNumpy(std::move(from.distance), {height, width});
    l["id"] = toNumpy(std::move(from.id), {height, width});
    debug[layerName(names.layers[i])] = l;
  }
  for (size_t i = 0; i < images.aovs.size(); ++i)
    aovs[nb::str(names.aovs[i].name.data(), names.aovs[i].name.size())] =
        readAov(std::move(images.aovs[i]), height, width);
  if (!images.aovs.empty()) d["aovs"] = aovs;
  if (!images.debug.empty()) d["debug"] = debug;
  return d;
}

// Calls back into Python, and looks for signals. An exception is kept until render() has unwound.
class PythonCallbacks {
 public:
  PythonCallbacks(nb::object progress, nb::object tile) : progress_(std::move(progress)), tile_(std::move(tile)) {}

  bool operator()(double done, const char* stage) {
    const nb::gil_scoped_acquire gil;
    try {
      if (PyErr_CheckSignals() != 0) throw nb::python_error();
      return progress_.is_none() || nb::cast<bool>(nb::bool_(progress_(done, stage)));
    } catch (...) {
      raised_ = std::current_exception();
      return false;
    }
  }
  void operator()(FilmImages&& images, const ImageNames& names) {
    const nb::gil_scoped_acquire gil;
    try {
      const int32_t x0 = images.rect.x0, y0 = images.rect.y0;
      tile_(x0, y0, readImages(std::move(images), names));
    } catch (...) {
      raised_ = std::current_exception();
      throw Error(ErrorKind::Cancelled, "the receiver of tiles failed");
    }
  }
  bool takesTiles() const { return !tile_.is_none(); }
  void rethrow() const {
    if (raised_) std::rethrow_exception(raised_);
  }

 private:
  nb::object progress_, tile_;
  std::exception_ptr raised_;
};

nb::dict renderScene(Scene& scene, const nb::dict& given, std::shared_ptr<Device> device, nb::object progress,
                     nb::object tile, std::shared_ptr<RenderCache> cache) {
  const Settings settings = toSettings(given);
  PythonCallbacks callbacks(std::move(progress), std::move(tile));
  Frame frame;
  try {
    const nb::gil_scoped_release release;
    settings.validate();
    if (!device && cache) device = cache->device();
    if (!device) device = Device::create();
    TileSink sink;
    if (callbacks.takesTiles()) {
      const ImageNames names{sceneLayers(scene, settings), settings.aovs};
      sink = [&callbacks, names](FilmImages&& images) { callbacks(std::move(images), names); };
    }
    frame = render(scene, settings, *device, std::ref(callbacks), sink, cache.get());
  } catch (const Error&) {
    callbacks.rethrow();  // what stopped the frame, rather than that it was stopped
    throw;
  }
  nb::dict result;
  if (!callbacks.takesTiles()) result = readImages(std::move(frame.images), {frame.layers, settings.aovs});
  result["statistics"] = readStatistics(frame.statistics);
  return result;
}

nb::dict readCounts(const RenderCache::Counts& counts) {
  nb::dict d;
  d["meshes"] = counts.meshes;
  d["prototypes"] = counts.prototypes;
  d["programs"] = counts.programs;
  d["kernels"] = counts.kernels;
  d["textures"] = counts.textures;
  d["light_images"] = counts.light_images;
  return d;
}

void bindCache(nb::module_& module) {
  // A frame that holds the cache may be waiting for the interpreter.
  const auto read = [](auto counts) {
    return [counts](const RenderCache& cache) {
      const nb::gil_scoped_release release;
      return std::invoke(counts, cache);
    };
  };
  nb::class_<RenderCache>(module, "RenderCache",
                          "What frames leave behind for those that follow: a frame after an edit makes anew only what\n"
                          "was edited, and is the same to the last bit. Frames share what their scenes' Mesh and\n"
                          "Texture objects share; what a frame does not use leaves the cache.")
      .def(nb::init<>())
      .def_prop_ro(
          "made", [read](const RenderCache& cache) { return readCounts(read(&RenderCache::made)(cache)); },
          "What the last frame made anew: 'meshes' diced, 'prototypes' built, 'programs' of materials and 'kernels'\n"
          "compiled, 'textures' read and 'light_images' decoded.")
      .def_prop_ro(
          "held", [read](const RenderCache& cache) { return readCounts(read(&RenderCache::held)(cache)); },
          "The same of all that it holds.");
}

nb::dict traceRaw(Scene& scene, const nb::dict& given) {
  const Settings settings = toSettings(given);
  RawTrace raw;
  {
    const nb::gil_scoped_release release;
    raw = timeRawRays(scene, settings);
  }
  nb::dict d;
  d["rays"] = raw.rays;
  d["seconds"] = raw.seconds;
  return d;
}

}  // namespace

void bindRender(nb::module_& module) {
  nb::class_<Device>(module, "Device", "A Vulkan device that frames are rendered on, one at a time.")
      .def_prop_ro("info", [](const Device& d) { return readInfo(d.info()); });
  module.def(
      "devices",
      [] {
        nb::list devices;
        for (const DeviceInfo& info : Device::list()) devices.append(readInfo(info));
        return devices;
      },
      "Dictionaries that describe the Vulkan devices of this machine, in the order of their indices.");
  module.def(
      "create_device", [](const std::string& select, bool validation) { return Device::create({select, validation}); },
      nb::arg("select") = "", nb::arg("validation") = false,
      "A device by name (part of it) or index; '': $ENCORE_DEVICE, else the best. Raises Error (kind 'device').");
  module.def(
      "versions",
      [] {
        nb::dict d;
        d["embree"] = RTC_VERSION_STRING;
        d["opensubdiv"] = versionText(OPENSUBDIV_VERSION_NUMBER);
        return d;
      },
      "Versions of the libraries that decide what an image looks like.");
  module.def(
      "default_settings", [] { return readSettings(Settings{}); },
      "Every setting and its default; the keys that render() knows, besides 'window' and 'aovs'.");
  bindCache(module);
  module.def(
      "render", &renderScene, nb::arg("scene"), nb::arg("settings"), nb::arg("device") = nb::none(),
      nb::arg("progress") = nb::none(), nb::arg("tile") = nb::none(), nb::arg("cache") = nb::none(),
      "Renders one frame.\n\n"
      "settings: see default_settings(), and 'window': the pixels (x0, y0, x1, y1) to be rendered of the plane\n"
      "of the image, which is width × height; beyond it is overscan; None: the image. 'aovs': dictionaries of\n"
      "'kind' (position, eyePosition, eyeNormal, primvar, primId, instanceId or elementId), 'name' and, of\n"
      "primvars, 'primvar' and 'components' (1 to 4). progress(done, stage): called now and then with done in [0, 1];\n"
      "returning False cancels, and what it raises is raised here. The scene must not change meanwhile.\n"
      "Result, of the window: 'layers' (name → (height, width, 3)), 'composite' and 'normal' (height, width, 3), "
      "'alpha'\n"
      "and 'depth' (height, width), with debug_aovs 'debug' (layer → 'evaluations', 'reshaded', 'distance'\n"
      "(height, width) and 'id' (height, width, 3)), with aovs 'aovs' (name → (height, width, components),\n"
      "ids int32 (height, width)), all others float32, and 'statistics'. Raises Error.\n"
      "tile(x0, y0, images): takes these arrays rectangle by rectangle as they become final, in rows of one\n"
      "height, each pixel once, counted from the window's upper left one; the result then holds only\n"
      "'statistics'.\n"
      "cache: of frames before, for frames that follow. With one and no device, the device is that of the last.");
  module.def("trace_raw", &traceRaw, nb::arg("scene"), nb::arg("settings"),
             "Rays of a frame's antialiasing samples and the seconds in which Embree alone traces them, in packets of\n"
             "16 that are ready before the clock runs: what a frame is compared with. Result: 'rays', 'seconds'.");
}

}  // namespace encore::python
