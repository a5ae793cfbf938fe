// How nodes of one level are split: about as many children as samples, as square as halving allows.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "cell_lists.glsl"

layout(push_constant, scalar) uniform Arguments {
  CellPrimitives primitives;
  CellPlaces places;
  LongWords nodes;
  Words counts;
  Words child_counts;  // of the level's nodes, and one more for the scan
  Words totals;        // [0]: nodes with more than `dense` samples
  uint first;          // the level's nodes are first .. end
  uint end;
  uint least;  // samples below which a node is not split
  uint dense;
  float children_per_sample;
};

const uint kMaxBits = 16;        // of one split
const uint kMaxTotalBits = 100;  // below a root cell, so that sizes stay far above the smallest float

float powerOfTwo(int exponent) { return uintBitsToFloat(uint(127 + exponent) << 23); }

void main() {
  const uint node = first + invocation();
  if (node > end) return;
  if (node == end) {
    child_counts.at[node - first] = 0;
    return;
  }
  const uint count = counts.at[node];
  if (count > dense) atomicAdd(totals.at[0], 1);
  uvec2 bits = uvec2(0);
  const CellPlace place = places.at[node];
  const uvec2 above = uvec2(place.bits & 0xffff, place.bits >> 16);
  if (count >= least && max(above.x, above.y) < kMaxTotalBits) {
    const uint wanted = min(uint(findMSB(max(uint(float(count) * children_per_sample), 1))), kMaxBits);
    const vec2 size = vec2(powerOfTwo(-int(above.x)), powerOfTwo(-int(above.y))) / primitives.at[place.primitive].cells_per_unit;
    while (bits.x + bits.y < wanted) {
      if (size.x * powerOfTwo(int(bits.y)) > size.y * powerOfTwo(int(bits.x))) {
        ++bits.x;
      } else {
        ++bits.y;
      }
    }
  }
  const uint together = bits.x + bits.y;
  nodes.at[node] = packUint2x32(uvec2(0, together == 0 ? kHardLeaf : (kInner | bits.x | (bits.y << 8))));
  child_counts.at[node - first] = together == 0 ? 0 : 1u << together;
}
