// Makes the children of the nodes of one level. Their counts of samples start as 0.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "cell_lists.glsl"

layout(push_constant, scalar) uniform Arguments {
  CellPlaces places;
  LongWords nodes;
  Words counts;
  Words child_starts;  // of the level's nodes, from 0
  uint first;          // the level's nodes are first .. end; their children start at end
  uint end;
};

void main() {
  const uint node = first + invocation();
  if (node >= end) return;
  const uvec2 record = unpackUint2x32(nodes.at[node]);
  if ((record.y & kInner) == 0) return;
  const uvec2 bits = uvec2(record.y & 0xff, (record.y >> 8) & 0xff);
  const CellPlace place = places.at[node];
  const uvec2 total = uvec2(place.bits & 0xffff, place.bits >> 16) + bits;
  const vec2 size = uintBitsToFloat((uvec2(127) - total) << 23);
  const uint child = end + child_starts.at[node - first];
  nodes.at[node] = packUint2x32(uvec2(child, record.y));
  for (uint i = 0; i < 1u << (bits.x + bits.y); ++i) {
    const uvec2 cell = uvec2(i & ((1u << bits.x) - 1), i >> bits.x);
    places.at[child + i] = CellPlace(place.corner + vec2(cell) * size, place.primitive, total.x | (total.y << 16));
    nodes.at[child + i] = packUint2x32(uvec2(0, kHardLeaf));
    counts.at[child + i] = 0;
  }
}
