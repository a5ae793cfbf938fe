// Everything that steers a frame and is not in the scene. Every field is recorded in the output's header.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/aov.h"

namespace encore {

// Reuse is the product. The others are there to be compared with: Reference shades every antialiasing sample;
// Decoupled and DecoupledPixel share shading among samples of equal hash (§4: the standard mapping projects the
// hit to the image, the modified one takes the pixel that the sample contributes to); Vertex shades the vertices
// of micropolygons (Hou et al. 2010).
enum class Method { Reuse, Reference, Decoupled, DecoupledPixel, Vertex };
enum class FilterKind { Box, Gaussian, Mitchell, BlackmanHarris };
// How nearest neighbours are found; all of them find the same. Auto chooses per layer.
enum class Search { Auto, Tree, Groups, Cells };
// What the footprints of two samples have to do with reuse between them (§2.4): nothing; the paper's metric;
// or samples whose footprints are of different octaves never share.
enum class FootprintReuse { Ignore, Metric, Octaves };
// What transparent bodies do to light on its way to a surface: it passes straight, less what their interfaces reflect
// and what is opaque in them, or it does not pass.
enum class GlassShadows { Transmit, Opaque };

struct Settings {
  Method method = Method::Reuse;
  uint32_t width = 960, height = 540;  // of the whole image, which the camera's film window fills
  // What is rendered of the plane of the image, pixels, y down; it may reach beyond the image (overscan). Pixels are
  // what they would be in any other window. Of no size: the image.
  Window window;
  std::vector<Aov> aovs;              // what is asked for besides layers, alpha, depth and normals
  uint32_t samples = 8;               // samples × samples antialiasing samples per pixel
  float shading_rate = 2;             // shading samples per pixel per layer (the paper's shading_rate)
  float shading_rate_reflection = 0;  // of that layer; 0: shading_rate
  float shading_rate_refraction = 0;
  uint32_t max_bounces = 4;  // mirror, glossy and refractive bounces after the first hit
  FilterKind filter = FilterKind::BlackmanHarris;
  float filter_radius_pixels = 1.5f;
  float target_edge_length_world = 0;  // of meshes without their own; 0: from each mesh's size
  float edge_length_scale = 1;         // of the lengths above, not of meshes' own lengths (--complexity)
  uint64_t max_micropolygons = 100'000'000;
  uint32_t light_samples = 16;         // rays per area light and shade
  uint32_t occlusion_samples = 64;     // rays per dome light and shade
  float occlusion_distance_world = 0;  // what is further away does not occlude domes; 0: everything does
  uint32_t most_light_samples = 128;   // of all area lights and shade: beyond it lights are chosen by importance
  GlassShadows glass_shadows = GlassShadows::Transmit;
  bool energy_compensation = true;    // rough lobes get back what microfacets reflect among each other
  uint64_t texture_budget_bytes = 0;  // of resident texture levels; 0: an eighth of the machine's memory
  std::string shader_cache;           // folder of compiled pattern shaders; empty: none
  uint32_t seed = 0;
  uint32_t reuse_tile_pixels = 512;  // a multiple of kBlockPixels
  Search search = Search::Auto;
  FootprintReuse footprint_reuse = FootprintReuse::Ignore;
  float footprint_weight = 1;  // c of the metric
  // Weights of time (the whole shutter is 1) and of the direction that a path arrives from (unit vectors) as further
  // coordinates of the reuse distance, beside those of (u, v); 0: not a part of it.
  float reuse_time_weight = 0;
  float reuse_direction_weight = 0;
  float max_reuse_distance = 0;         // in spacings of shading samples, beyond which a sample fails; 0: no limit
  bool world_space_parameters = false;  // (u, v) are scaled to each primitive's extents in the world
  bool debug_aovs = false;              // how shading was spent, per layer
  uint64_t memory_budget_bytes = 0;     // samples, trees and film; 0: from the device
  uint32_t threads = 0;                 // 0: all
  bool dome_light_visible = false;      // to the camera
  bool lights_visible = false;          // area lights to the camera
  float roughness_limit = 0.3f;         // lobes up to this roughness are traced, rougher ones shaded

  // Throws Error(Setting) that names the field, the value and the range.
  void validate() const;
};

}  // namespace encore
