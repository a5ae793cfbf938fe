// UsdUVTexture lookups from mip pyramids of half floats in buffers: anisotropic along the longer axis of the
// footprint, trilinear across levels, wrap modes honoured at every level.
// C++ twin: tests/core/twins/texture_twin.h. Included by generated pattern shaders, which define before:
//   TEXELS_PER_FOOTPRINT  texels of the level across the footprint's shorter axis; below that a level is too coarse
//   TAPS_ACROSS           most taps along the shorter axis
// Bilinear taps from a level whose texels are as wide as the footprint see twice its width: fine text 2 to 8 texels
// to a pixel kept 44 to 84 % of its contrast. Two by two taps from the next finer level keep 78 to 104 %, with half
// the error against the mean over the footprint (tests/core/texture_filter_test.cpp).

// One level: rgba as two words of half floats per texel (packHalf2x16), bottom row first.
// Writer: core/pattern/texture_store.cpp.
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer Texels { uvec2 texel[]; };
struct MipLevel {
  Texels texels;
  uint width;  // 0: the level is not resident
  uint height;
};
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer MipLevels { MipLevel level[]; };

// A texture's pyramid, resident or not.
struct TextureTile {
  uint first_level;  // finest first
  uint level_count;  // 0: there is no texture
  uint width;        // of the finest level
  uint height;
};
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer TextureTiles { TextureTile tile[]; };

// Per level, 1 where a lookup wants it; after the last level, 1 where some level is wanted that is not resident.
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer LevelMarks { uint mark[]; };

// Everything about the scene's textures. Writer: core/pattern/texture_store.cpp.
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer TextureTables {
  MipLevels levels;
  TextureTiles tiles;
  LevelMarks marks;
  uint level_count;  // of all textures
  uint marking;      // 1: wanted levels are marked; 0: all levels are resident
};

// Values of encore::WrapMode.
const uint kWrapBlack = 0u;
const uint kWrapClamp = 1u;
const uint kWrapRepeat = 2u;
const uint kWrapMirror = 3u;

// The constants of one node: core/scene/material.h. Writer: core/pattern/texture_nodes.cpp.
struct TextureNode {
  uint first_tile;
  uint tile_count;  // of a UDIM, in rows of ten from the lower left; else 1
  uint udim;        // 1: it is one
  uint texcoord;    // where st, dstdx and dstdy are among the point's floats
  uint wrap_s;
  uint wrap_t;
  vec3 row_s;  // st' = (dot(row_s, (s, t, 1)), dot(row_t, (s, t, 1)))
  vec3 row_t;
  vec4 scale;
  vec4 bias;
  vec4 fallback;
};
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer TextureNodes { TextureNode node[]; };

const float kMaxAnisotropy = 8.0;
const float kMaxTapsAlong = ceil(kMaxAnisotropy * TEXELS_PER_FOOTPRINT);
// Texels per pixel beyond which footprints make no difference: every pyramid has ended.
const float kMaxFootprint = 16777216.0;

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
  // Of the two forms of the eigenvector, the one without cancellation; of a circle, the first side.
  vec2 direction = p >= r ? vec2(larger - r, q) : vec2(q, larger - p);
  if (spread <= 1e-3 * mean) direction = a;
  const float l = length(direction);
  footprint.major = l > 0.0 ? direction * (footprint.major_length / l) : vec2(0.0);
  return footprint;
}

// The level, which is marked as wanted where that is of interest.
MipLevel wantedLevel(TextureTables tables, uint index) {
  MipLevel level = tables.levels.level[index];
  if (tables.marking != 0u) {
    if (tables.marks.mark[index] == 0u) tables.marks.mark[index] = 1u;  // most are: no traffic between caches
    if (level.width == 0u) tables.marks.mark[tables.level_count] = 1u;
  }
  return level;
}

// The texture at st, averaged over the parallelogram of dstdx and dstdy, before scale and bias. Without meaning where
// a level that it wants is not resident.
vec4 sampleTexture(TextureTables tables, TextureTile tile, uint wrap_s, uint wrap_t, vec2 st, vec2 dstdx, vec2 dstdy) {
  const vec2 size = vec2(tile.width, tile.height);
  const vec2 a = dstdx * size, b = dstdy * size;
  const Footprint footprint = makeFootprint(vec2(clampFootprint(a.x), clampFootprint(a.y)),
                                            vec2(clampFootprint(b.x), clampFootprint(b.y)));

  // The level's texels follow from the minor axis, unless that would take too many of them along the major one.
  const float width = max(footprint.minor_length, footprint.major_length / kMaxAnisotropy);
  const float texel = max(width / TEXELS_PER_FOOTPRINT, 1.0);
  const float lod = clamp(log2(texel), 0.0, float(tile.level_count - 1u));
  const uint level0 = uint(lod), level1 = min(level0 + 1u, tile.level_count - 1u);
  const float blend = lod - float(level0);
  // A tap per texel; the small slack keeps whole ratios from rounding upwards.
  const float along = clamp(ceil(footprint.major_length / texel - 1e-3), 1.0, kMaxTapsAlong);
  const float across = clamp(ceil(footprint.minor_length / texel - 1e-3), 1.0, TAPS_ACROSS);

  MipLevel fine = wantedLevel(tables, tile.first_level + level0), coarse = fine;
  if (blend > 0.0) coarse = wantedLevel(tables, tile.first_level + level1);
  if (fine.width == 0u || coarse.width == 0u) return vec4(0.0);
  const vec2 major = footprint.major / size;
  const float ratio = footprint.major_length > 0.0 ? footprint.minor_length / footprint.major_length : 0.0;
  const vec2 minor = vec2(-footprint.major.y, footprint.major.x) * ratio / size;
  // One place that reads texels, for the taps from both levels: it is most of a shader's size.
  const float taps = along * across, all_taps = blend > 0.0 ? 2.0 * taps : taps;
  vec4 sum = vec4(0.0);
  for (float tap = 0.0; tap < all_taps; tap += 1.0) {
    const bool second = tap >= taps;
    const float index = second ? tap - taps : tap;
    const float row = floor((index + 0.5) / along), column = index - row * along;
    const vec2 at = st + major * ((column + 0.5) / along - 0.5) + minor * ((row + 0.5) / across - 0.5);
    const vec2 folded = vec2(foldCoordinate(at.x, wrap_s), foldCoordinate(at.y, wrap_t));
    MipLevel level = fine;
    if (second) level = coarse;
    sum += sampleLevel(level, folded, wrap_s, wrap_t) * (second ? blend : 1.0 - blend);
  }
  return sum / taps;
}

// Tile of a UDIM at (column, row), or one without levels.
TextureTile tileAt(TextureTables tables, TextureNode node, vec2 at) {
  const float index = at.x + 10.0 * at.y;
  if (at.x < 0.0 || at.x > 9.0 || at.y < 0.0 || index >= float(node.tile_count)) return TextureTile(0u, 0u, 0u, 0u);
  return tables.tiles.tile[node.first_tile + uint(index)];
}

// The tile of a UDIM that st lies in; st becomes relative to it. On a border that has no tile beyond it, the one
// before: the right edge of the last tile belongs to it.
TextureTile udimTile(TextureTables tables, TextureNode node, inout vec2 st) {
  vec2 corner = floor(st);
  TextureTile tile = tileAt(tables, node, corner);
  if (tile.level_count == 0u) {
    const vec2 inner = vec2(st.x == corner.x ? corner.x - 1.0 : corner.x, st.y == corner.y ? corner.y - 1.0 : corner.y);
    vec2 before = vec2(inner.x, corner.y);
    tile = tileAt(tables, node, before);
    if (tile.level_count == 0u) tile = tileAt(tables, node, before = vec2(corner.x, inner.y));
    if (tile.level_count == 0u) tile = tileAt(tables, node, before = inner);
    corner = before;
  }
  st -= corner;
  return tile;
}

// A UsdUVTexture: the fallback, as it is, where there is no texture or no finite coordinate. first: of the point's
// floats.
vec4 evaluateTexture(TextureTables tables, TextureNode node, Floats data, uint first) {
  const vec2 at = read2(data, first + node.texcoord);
  vec2 st = vec2(dot(node.row_s, vec3(at, 1.0)), dot(node.row_t, vec3(at, 1.0)));
  if (!finite(st.x) || !finite(st.y)) return node.fallback;
  TextureTile tile;
  uint wrap_s = node.wrap_s, wrap_t = node.wrap_t;
  if (node.udim != 0u) {  // filtered within the tile
    tile = udimTile(tables, node, st);
    wrap_s = wrap_t = kWrapClamp;
  } else {
    tile = tables.tiles.tile[node.first_tile];
  }
  if (tile.level_count == 0u) return node.fallback;
  const vec2 dx = read2(data, first + node.texcoord + 2u), dy = read2(data, first + node.texcoord + 4u);
  const vec2 dstdx = vec2(dot(node.row_s.xy, dx), dot(node.row_t.xy, dx));
  const vec2 dstdy = vec2(dot(node.row_s.xy, dy), dot(node.row_t.xy, dy));
  return sampleTexture(tables, tile, wrap_s, wrap_t, st, dstdx, dstdy) * node.scale + node.bias;
}
