// Coordinates as everything that searches takes them: the nearest point of the unit square, and 0 for what is not
// a number. Comparisons on bits, because a compiler may assume that floats are numbers.

// Numbers below the smallest normal one count as 0 too: no distance to anything changes by that, and it does not
// matter then whether the device takes them for 0.
float normalInUnitInterval(float x) {
  const uint bits = floatBitsToUint(x);
  if (bits > 0x7f800000u || bits < 0x00800000u) return 0.0;  // negative (-0 too), not a number, or not normal
  return bits > floatBitsToUint(1.0) ? 1.0 : x;
}
vec2 normalInUnitSquare(vec2 p) { return vec2(normalInUnitInterval(p.x), normalInUnitInterval(p.y)); }
