#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

// How the search for shading samples went in each pixel: sums over its slots, for DebugImages.

#include "records.h"

layout(local_size_x = 64) in;

struct SearchSums {
  float surface;   // samples on a surface
  float failed;    // of them, those without a neighbour
  float distance;  // parametric, of the others to their neighbour
  vec3 id;         // false colours of neighbours; black where there is none
};

layout(buffer_reference, scalar) readonly buffer Origins { uvec2 at[]; };
layout(buffer_reference, scalar) readonly buffer Shades { uint at[]; };
layout(buffer_reference, scalar) readonly buffer Points { vec2 at[]; };
layout(buffer_reference, scalar) writeonly buffer Sums { SearchSums at[]; };
layout(buffer_reference, scalar) buffer Counters {
  uint non_finite;
  uint bad_shade;  // samples whose shade index is out of range
};

layout(push_constant, scalar) uniform Arguments {
  Origins origins;  // of the blocks, in pixels of the image
  Shades shade;     // per slot
  Points aa_uv;     // per slot
  Points uv;        // per shading sample
  Sums sums;        // per pixel of the blocks
  Counters counters;
  uint blocks;
  uint width;  // of the image
  uint height;
  uint samples_per_pixel;
  uint uv_count;
};

// Neighbouring ids get colours that have nothing in common: the 32-bit finalizer of MurmurHash3 (Appleby, public
// domain), eight bits per component in (0, 1].
vec3 falseColor(uint id) {
  uint h = id + 1u;
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  h ^= h >> 16;
  return vec3((h & 0xffu) + 1u, (h >> 8 & 0xffu) + 1u, (h >> 16 & 0xffu) + 1u) * (1.0 / 256.0);
}

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint pixel = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
  if (pixel / kBlockArea >= blocks) return;
  const uvec2 at = origins.at[pixel / kBlockArea] + uvec2(pixel % kBlockPixels, pixel % kBlockArea / kBlockPixels);
  const uint end = at.x < width && at.y < height ? samples_per_pixel : 0;
  SearchSums result = SearchSums(0, 0, 0, vec3(0));
  uint bad = 0;
  for (uint i = 0; i < end; ++i) {
    const uint slot = pixel * samples_per_pixel + i;
    const uint index = shade.at[slot];
    if (index == kShadeNone) continue;
    result.surface += 1;
    if (index == kShadeNotFound) {
      result.failed += 1;
    } else if (index >= uv_count) {
      bad += 1;
    } else {
      precise vec2 d = aa_uv.at[slot] - uv.at[index];
      precise float squared = d.x * d.x + d.y * d.y;
      const bool finite = (floatBitsToUint(squared) & 0x7f800000u) != 0x7f800000u;
      precise float distance = result.distance + (finite ? sqrt(squared) : 0);
      result.distance = distance;
      result.id += falseColor(index);
    }
  }
  sums.at[pixel] = result;
  if (bad > 0) atomicAdd(counters.bad_shade, bad);
}
