// Radiance of a pair of samples: throughput * radiance[shade], or throughput alone.

layout(buffer_reference, scalar) readonly buffer Words { uint at[]; };

struct RadianceArguments {
  Pairs throughput;  // per slot
  Pairs shade;       // per slot
  uint64_t radiance;
  uint radiance_count;
};

// radiance[index], read as 64 aligned bits and the 32 before or after them.
vec3 loadRadiance(uint64_t radiance, uint index) {
  const uint word = 3 * index, odd = index & 1u;
  const vec2 two = floatPair(Pairs(radiance), (word + odd) / 2);
  const float one = uintBitsToFloat(Words(radiance).at[word + 2 - 2 * odd]);
  return odd == 0 ? vec3(two, one) : vec3(one, two);
}

// Counts and zeroes what is not finite, and what names no shading sample.
void loadRadiancePair(RadianceArguments a, uint pair, bvec2 valid, out vec3 color[2], inout uint non_finite,
                      inout uint bad_shade) {
  vec3Pair(a.throughput, pair, color);
  const uvec2 shades = unpack32(a.shade.at[pair]);
  [[unroll]] for (uint s = 0; s < 2; ++s) {
    const bool none = shades[s] == kShadeNone;
    const bool bad = !none && shades[s] >= a.radiance_count;
    // Always read, so that all invocations do the same.
    const vec3 radiance = a.radiance_count == 0 ? vec3(1) : loadRadiance(a.radiance, none || bad ? 0 : shades[s]);
    precise vec3 product = color[s] * radiance;
    const vec3 value = none ? color[s] : product;
    const bool finite = isFiniteValue(value) || bad;
    non_finite += valid[s] && !finite ? 1 : 0;
    bad_shade += valid[s] && bad ? 1 : 0;
    color[s] = finite && !bad ? value : vec3(0);
  }
}
