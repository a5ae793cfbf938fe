// What a surface shader of the user's own is given and what it sets: docs/glsl.md. Included before its source.

struct SurfacePoint {
  vec3 position;        // world space
  vec3 objectPosition;  // the mesh's space
  vec3 normal;          // unit shading normal, world space, on the side that the ray arrives from
  vec2 uv;              // within the primitive, [0, 1]²
  vec2 st;              // primvar st
  vec2 dstdx;           // its change over a pixel in x
  vec2 dstdy;           // and in y
  vec3 displayColor;    // primvar displayColor
};

// The inputs of UsdPreviewSurface, in the order of kSurfaceMembers (core/pattern/network.h).
struct Surface {
  vec3 diffuseColor;
  vec3 emissiveColor;
  vec3 specularColor;
  float metallic;
  float roughness;
  float clearcoat;
  float clearcoatRoughness;
  float opacity;
  float ior;
  vec3 normal;  // in the tangent frame of st
};
