// Exponent bits tell infinities and NaNs whatever the device makes of comparisons with them.
bool finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u; }

float finiteOr(float x, float instead) { return finite(x) ? x : instead; }
vec3 finiteOr(vec3 v, vec3 instead) {
  return vec3(finiteOr(v.x, instead.x), finiteOr(v.y, instead.y), finiteOr(v.z, instead.z));
}
