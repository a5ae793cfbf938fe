// UsdUVTexture lookups from mip pyramids of half floats in buffers: anisotropic along the longer axis of the
// footprint, trilinear across levels, wrap modes honoured at every level.
// C++ twin: tests/core/twins/texture_twin.h. Included by generated pattern shaders.

// One level: rgba as two words of half floats per texel (packHalf2x16), bottom row first.
// Writer: core/pattern/texture_pyramid.cpp.
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer Texels { uvec2 texel[]; };
struct MipLevel {
  Texels texels;
  uint width;
  uint height;
};
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer MipLevels { MipLevel level[]; };

// Values of encore::WrapMode.
const uint kWrapBlack = 0u;
const uint kWrapClamp = 1u;
const uint kWrapRepeat = 2u;
const uint kWrapMirror = 3u;

// The constants of one node: core/scene/material.h.
struct TextureNode {
  uint first_level;  // of the texture's pyramid; finest first
  uint level_count;  // 0: there is no texture
  uint wrap_s;
  uint wrap_t;
  vec3 row_s;  // st' = (dot(row_s, (s, t, 1)), dot(row_t, (s, t, 1)))
  vec3 row_t;
  vec4 scale;
  vec4 bias;
  vec4 fallback;
};

TextureNode noTexture() {
  return TextureNode(0u, 0u, kWrapBlack, kWrapBlack, vec3(0.0), vec3(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
}

const float kMaxAnisotropy = 8.0;
// Texels per pixel beyond which footprints make no difference: every pyramid has ended.
const float kMaxFootprint = 16777216.0;

// Exponent bits tell infinities and NaNs whatever the device makes of comparisons with them.
bool finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u; }

// The largest texture is coarser than any footprint that is not a number.
float clampFootprint(float x) { return finite(x) ? clamp(x, -kMaxFootprint, kMaxFootprint) : kMaxFootprint; }

// Brings a coordinate near [0, 1] before it is scaled to texels, so that large ones lose no more precision than
// they have lost already. Black stays outside if it was: from one unit on, no tap can reach the texture.
float foldCoordinate(float s, uint wrap) {
  if (wrap == kWrapRepeat) return s - floor(s);
  if (wrap == kWrapMirror) {
    const float m = s - 2.0 * floor(0.5 * s);
    return m > 1.0 ? 2.0 - m : m;
  }
  return wrap == kWrapClamp ? clamp(s, 0.0, 1.0) : clamp(s, -1.0, 2.0);
}

// Texel i in [-size - 1, 2 size] of a folded coordinate → index of a texel; inside: false where it is black.
int wrapTexel(int i, int size, uint wrap, inout bool inside) {
  if (wrap == kWrapRepeat) return i < 0 ? i + size : i >= size ? i - size : i;
  if (wrap == kWrapBlack) inside = inside && i >= 0 && i < size;
  return clamp(i, 0, size - 1);
}

vec4 fetchTexel(MipLevel level, int x, int y, bool inside) {
  if (!inside) return vec4(0.0);
  const uvec2 packed = level.texels.texel[uint(y) * level.width + uint(x)];
  return vec4(unpackHalf2x16(packed.x), unpackHalf2x16(packed.y));
}

// Bilinear lookup. st: folded.
vec4 sampleLevel(MipLevel level, vec2 st, uint wrap_s, uint wrap_t) {
  const ivec2 size = ivec2(level.width, level.height);
  const vec2 p = st * vec2(size) - 0.5;
  const vec2 corner = floor(p);
  const vec2 f = p - corner;
  bool in_x0 = true, in_x1 = true, in_y0 = true, in_y1 = true;
  const int x0 = wrapTexel(int(corner.x), size.x, wrap_s, in_x0);
  const int x1 = wrapTexel(int(corner.x) + 1, size.x, wrap_s, in_x1);
  const int y0 = wrapTexel(int(corner.y), size.y, wrap_t, in_y0);
  const int y1 = wrapTexel(int(corner.y) + 1, size.y, wrap_t, in_y1);
  const vec4 lower = mix(fetchTexel(level, x0, y0, in_x0 && in_y0), fetchTexel(level, x1, y0, in_x1 && in_y0), f.x);
  const vec4 upper = mix(fetchTexel(level, x0, y1, in_x0 && in_y1), fetchTexel(level, x1, y1, in_x1 && in_y1), f.x);
  return mix(lower, upper, f.y);
}

// The ellipse onto which a footprint with the sides a and b (in texels) maps a circle as wide as a pixel.
struct Footprint {
  vec2 major;  // the longer axis from end to end
  float major_length;
  float minor_length;
};

Footprint makeFootprint(vec2 a, vec2 b) {
  // Eigenvalues of J Jᵀ with J = (a b); the smaller singular value from the determinant, which does not cancel.
  const float p = a.x * a.x + b.x * b.x, q = a.x * a.y + b.x * b.y, r = a.y * a.y + b.y * b.y;
  const float mean = 0.5 * (p + r), spread = length(vec2(0.5 * (p - r), q));
  const float larger = mean + spread;
  Footprint footprint;
  footprint.major_length = sqrt(larger);
  footprint.minor_length = footprint.major_length > 0.0 ? abs(a.x * b.y - a.y * b.x) / footprint.major_length : 0.0;
  // Of the two forms of the eigenvector, the one without cancellation.
  vec2 direction = p >= r ? vec2(larger - r, q) : vec2(q, larger - p);
  const float l = length(direction);
  footprint.major = l > 0.0 ? direction * (footprint.major_length / l) : vec2(0.0);
  return footprint;
}

// The texture at st, averaged over the parallelogram of dstdx and dstdy, before scale and bias.
vec4 sampleTexture(MipLevels levels, TextureNode node, vec2 st, vec2 dstdx, vec2 dstdy) {
  MipLevel finest = levels.level[node.first_level];
  const vec2 size = vec2(finest.width, finest.height);
  const vec2 a = dstdx * size, b = dstdy * size;
  const Footprint footprint = makeFootprint(vec2(clampFootprint(a.x), clampFootprint(a.y)),
                                            vec2(clampFootprint(b.x), clampFootprint(b.y)));

  // The level's texels are as wide as the minor axis, unless that would take too many of them along the major one.
  const float texel = max(max(footprint.minor_length, footprint.major_length / kMaxAnisotropy), 1.0);
  const float level = clamp(log2(texel), 0.0, float(node.level_count - 1u));
  const uint level0 = uint(level), level1 = min(level0 + 1u, node.level_count - 1u);
  const float blend = level - float(level0);
  // A tap per texel along the major axis; the small slack keeps whole ratios from rounding upwards.
  const float taps = clamp(ceil(footprint.major_length / texel - 1e-3), 1.0, kMaxAnisotropy);

  MipLevel fine = levels.level[node.first_level + level0], coarse = levels.level[node.first_level + level1];
  const vec2 step = footprint.major / size;
  vec4 sum = vec4(0.0);
  for (float tap = 0.0; tap < taps; tap += 1.0) {
    const vec2 at = st + step * ((tap + 0.5) / taps - 0.5);
    const vec2 folded = vec2(foldCoordinate(at.x, node.wrap_s), foldCoordinate(at.y, node.wrap_t));
    vec4 value = sampleLevel(fine, folded, node.wrap_s, node.wrap_t);
    if (blend > 0.0) value = mix(value, sampleLevel(coarse, folded, node.wrap_s, node.wrap_t), blend);
    sum += value;
  }
  return sum / taps;
}

// A UsdUVTexture: the fallback, as it is, where there is no texture or no finite coordinate.
vec4 evaluateTexture(MipLevels levels, TextureNode node, PatternPoint point) {
  const vec2 st = vec2(dot(node.row_s, vec3(point.st, 1.0)), dot(node.row_t, vec3(point.st, 1.0)));
  if (node.level_count == 0u || !finite(st.x) || !finite(st.y)) return node.fallback;
  const vec2 dstdx = vec2(dot(node.row_s.xy, point.dstdx), dot(node.row_t.xy, point.dstdx));
  const vec2 dstdy = vec2(dot(node.row_s.xy, point.dstdy), dot(node.row_t.xy, point.dstdy));
  return sampleTexture(levels, node, st, dstdx, dstdy) * node.scale + node.bias;
}
