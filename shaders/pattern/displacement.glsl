// What a displacement shader of the user's own is given: docs/glsl.md. Included before its source.

struct DisplacementPoint {
  vec3 position;      // the mesh's space
  vec3 normal;        // unit, the mesh's space
  vec2 uv;            // within the face, [0, 1]²
  vec2 st;            // primvar st
  vec2 dstdx;         // its change to the next vertex of the micropolygon grid
  vec2 dstdy;         // and across
  vec3 displayColor;  // primvar displayColor
};
