// Which bits differ between any two 64-bit keys, found as their difference from the first key.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(push_constant, scalar) uniform Arguments {
  Pairs keys;
  Words varying_bits;  // two words, which must start as 0
  uint count;
  uint run_length;
};

void main() {
  const uint first = invocation() * run_length;
  if (first >= count) return;
  const uint end = min(first + run_length, count);
  const uvec2 reference = keys.at[0];
  uvec2 bits = uvec2(0);
  for (uint i = first; i < end; ++i) bits |= keys.at[i] ^ reference;
  if (bits.x != 0) atomicOr(varying_bits.at[0], bits.x);
  if (bits.y != 0) atomicOr(varying_bits.at[1], bits.y);
}
