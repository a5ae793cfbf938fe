// Settings::validate(): one line per field.
#include <set>
#include <string>

#include "core/scene/error.h"
#include "core/scene/settings.h"
#include "core/scene/text.h"
#include "shaders/records.h"

namespace encore {
namespace {

void requireText(bool valid, const char* field, const std::string& value, const std::string& range) {
  if (!valid) throw Error(ErrorKind::Setting, "value " + value + " is out of range", field, "Choose " + range);
}

template <class T>
void require(bool valid, const char* field, T value, const std::string& range) {
  requireText(valid, field, text(value), range);
}

template <class T>
void requireRange(const char* field, T value, T lowest, T highest) {
  // Written so that NaN fails.
  require(value >= lowest && value <= highest, field, value, "a number from " + text(lowest) + " to " + text(highest));
}

// Pixels of overscan on each side, at most.
constexpr int32_t kMostOverscan = 65536;
constexpr size_t kMostAovs = 64;

void checkWindow(const Settings& s) {
  const Window& w = s.window;
  if (w == Window{}) return;
  const std::string found = parenthesized(text(w.x0) + ", " + text(w.y0) + ", " + text(w.x1) + ", " + text(w.y1));
  const auto fits = [](int64_t begin, int64_t end, uint32_t size) {
    return begin < end && end - begin <= 65536 && begin >= -kMostOverscan && end <= int64_t{size} + kMostOverscan;
  };
  requireText(fits(w.x0, w.x1, s.width) && fits(w.y0, w.y1, s.height), "window", found,
              "x0 < x1 and y0 < y1, at most 65536 pixels apart and at most " + text(kMostOverscan) +
                  " pixels beyond the image");
}

void checkAovs(const std::vector<Aov>& aovs) {
  require(aovs.size() <= kMostAovs, "aovs", aovs.size(), "up to " + text(kMostAovs) + " of them");
  std::set<std::string> names;
  for (const Aov& aov : aovs) {
    requireText(!aov.name.empty() && names.insert(aov.name).second, "aovs", "'" + aov.name + "'",
                "a name for each that no other has");
    require(aov.kind >= Aov::Kind::Position && aov.kind <= Aov::Kind::ElementId, "aovs", int(aov.kind),
            "one of the kinds there are");
    if (aov.kind != Aov::Kind::Primvar) continue;
    requireText(!aov.primvar.empty(), "aovs", "'' as the primvar of '" + aov.name + "'", "the name of a primvar");
    requireText(aov.components >= 1 && aov.components <= 4, "aovs",
                text(aov.components) + " as the components of '" + aov.name + "'", "1 to 4");
  }
}

}  // namespace

void Settings::validate() const {
  require(method >= Method::Reuse && method <= Method::Vertex, "method", int(method),
          "reuse, reference, decoupled, decoupled-pixel or vertex");
  requireRange("width", width, 1u, 65536u);
  requireRange("height", height, 1u, 65536u);
  checkWindow(*this);
  checkAovs(aovs);
  requireRange("samples", samples, 1u, 64u);
  require(shading_rate > 0 && shading_rate <= 256, "shading_rate", shading_rate,
          "a number above 0 and up to 256 shading samples per pixel and layer");
  require(shading_rate_reflection >= 0 && shading_rate_reflection <= 256, "shading_rate_reflection",
          shading_rate_reflection, "a number from 0 (shading_rate) to 256");
  require(shading_rate_refraction >= 0 && shading_rate_refraction <= 256, "shading_rate_refraction",
          shading_rate_refraction, "a number from 0 (shading_rate) to 256");
  requireRange("max_bounces", max_bounces, 0u, 256u);
  require(filter == FilterKind::Box || filter == FilterKind::Gaussian || filter == FilterKind::Mitchell ||
              filter == FilterKind::BlackmanHarris,
          "filter", int(filter), "box, gaussian, mitchell or blackmanharris");
  requireRange("filter_radius_pixels", filter_radius_pixels, 0.5f, 8.0f);
  require(std::isfinite(target_edge_length_world) && target_edge_length_world >= 0, "target_edge_length_world",
          target_edge_length_world, "a finite length in world units, or 0 for the default");
  requireRange("edge_length_scale", edge_length_scale, 1e-3f, 1e3f);
  requireRange("max_micropolygons", max_micropolygons, uint64_t{1}, uint64_t{10'000'000'000});
  requireRange("light_samples", light_samples, 1u, 65536u);
  requireRange("occlusion_samples", occlusion_samples, 1u, 65536u);
  require(reuse_tile_pixels >= kBlockPixels && reuse_tile_pixels <= 65536 && reuse_tile_pixels % kBlockPixels == 0,
          "reuse_tile_pixels", reuse_tile_pixels,
          "a multiple of " + text(kBlockPixels) + " from " + text(kBlockPixels) + " to 65536");
  require(search >= Search::Auto && search <= Search::Cells, "search", int(search), "auto, tree, groups or cells");
  require(footprint_reuse >= FootprintReuse::Ignore && footprint_reuse <= FootprintReuse::Octaves, "footprint_reuse",
          int(footprint_reuse), "ignore, metric or octaves");
  require(footprint_reuse != FootprintReuse::Metric || search == Search::Auto || search == Search::Tree, "search",
          int(search), "auto or tree, which alone know the footprint metric");
  require(footprint_weight > 0 && footprint_weight <= 1e6f, "footprint_weight", footprint_weight,
          "a number above 0 and up to 1e6");
  requireRange("max_reuse_distance", max_reuse_distance, 0.0f, 1e6f);
  requireRange("reuse_time_weight", reuse_time_weight, 0.0f, 1e6f);
  requireRange("reuse_direction_weight", reuse_direction_weight, 0.0f, 1e6f);
  require((reuse_time_weight == 0 && reuse_direction_weight == 0) || search == Search::Auto || search == Search::Tree,
          "search", int(search), "auto or tree, which alone know distances in time and direction");
  requireRange("most_light_samples", most_light_samples, 1u, 1u << 20);
  require(std::isfinite(occlusion_distance_world) && occlusion_distance_world >= 0, "occlusion_distance_world",
          occlusion_distance_world, "a finite length in world units, or 0 for no limit");
  require(glass_shadows == GlassShadows::Transmit || glass_shadows == GlassShadows::Opaque, "glass_shadows",
          int(glass_shadows), "transmit or opaque");
  requireRange("threads", threads, 0u, 1024u);
  requireRange("roughness_limit", roughness_limit, 0.0f, 1.0f);
}

}  // namespace encore
