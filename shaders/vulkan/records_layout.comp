#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require

// Writes the records of records.h field by field, so that tests/core/records_test.cpp can compare the
// bytes with what C++ lays out. Field f of element i of an array holds 100 * i + f (as a float: exactly).

#include "records.h"

layout(local_size_x = 1) in;

const uint kElements = 3;  // more than one: strides show

layout(buffer_reference, scalar) buffer Keys { SurfaceKey at[]; };
layout(buffer_reference, scalar) buffer Points { PatternPoint at[]; };
layout(buffer_reference, scalar) buffer Shadings { ShadingInputs at[]; };
layout(buffer_reference, scalar) buffer Paths { PathInputs at[]; };
layout(buffer_reference, scalar) buffer Opacities { OpacityInputs at[]; };
layout(buffer_reference, scalar) buffer Displacements { DisplacementInputs at[]; };
layout(buffer_reference, scalar) buffer Vectors2 { vec2 at[]; };
layout(buffer_reference, scalar) buffer Vectors3 { vec3 at[]; };
layout(buffer_reference, scalar) buffer Constants { uint at[]; };

layout(push_constant, scalar) uniform Arguments {
  Keys keys;
  Points points;
  Shadings shadings;
  Paths paths;
  Opacities opacities;
  Displacements displacements;
  Vectors2 vectors2;
  Vectors3 vectors3;
  Constants constants;
};

void main() {
  for (uint i = 0; i < kElements; ++i) {
    const uint n = 100 * i;
    const float f = float(n);
    keys.at[i].instance = n;
    keys.at[i].primitive_side = n + 1;
    points.at[i].material = n;
    points.at[i].first = n + 1;
    shadings.at[i].diffuse_color = vec3(f, f + 1, f + 2);
    shadings.at[i].emissive_color = vec3(f + 3, f + 4, f + 5);
    paths.at[i].base_color = vec3(f, f + 1, f + 2);
    paths.at[i].specular_color = vec3(f + 3, f + 4, f + 5);
    paths.at[i].metallic = f + 6;
    paths.at[i].roughness = f + 7;
    paths.at[i].clearcoat = f + 8;
    paths.at[i].clearcoat_roughness = f + 9;
    paths.at[i].opacity = f + 10;
    paths.at[i].ior = f + 11;
    paths.at[i].normal = vec3(f + 12, f + 13, f + 14);
    opacities.at[i].opacity = f;
    displacements.at[i].offset = vec3(f, f + 1, f + 2);
    displacements.at[i].along_normal = f + 3;
    vectors2.at[i] = vec2(f, f + 1);
    vectors3.at[i] = vec3(f, f + 1, f + 2);
  }
  constants.at[0] = kBlockPixels;
  constants.at[1] = kBlockArea;
  constants.at[2] = kNoInstance;
  constants.at[3] = kShadeNotFound;
  constants.at[4] = kShadeNone;
}
