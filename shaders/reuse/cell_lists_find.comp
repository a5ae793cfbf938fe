// The nearest shading sample of the same primitive for each antialiasing sample (§2.2), exactly, in any order: the
// list of the leaf that it lies in is looked through. Leaves without a list are left, as kShadePending, to the trees.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "unit_square.glsl"
#include "cell_lists.glsl"
#define Primitives CellPrimitives
#include "key_table.glsl"

layout(push_constant, scalar) uniform Arguments {
  LongWords primitives;  // five words each: CellPrimitive
  Words slots;
  LongWords nodes;
  FloatPairs entry_points;
  Words entry_ids;
  LongWords keys;
  FloatPairs uv;
  Words shade;
  uint count;
  uint capacity;
};

uint primitiveOf(uint64_t key) {
  const uvec2 words = unpackUint2x32(key);
  if (capacity == 0) return kNoPrimitive;
  for (uint slot = hashOf(SurfaceKey(words.x, words.y));; ++slot) {
    const uint primitive = slots.at[slot & (capacity - 1)];
    if (primitive == kEmptySlot || primitives.at[5 * primitive] == key) return primitive;
  }
}

uint findNearest(uint primitive, vec2 q) {
  const vec2 origin = uintBitsToFloat(unpackUint2x32(primitives.at[5 * primitive + 1]));
  const vec2 cells_per_unit = uintBitsToFloat(unpackUint2x32(primitives.at[5 * primitive + 2]));
  const uvec2 size = unpackUint2x32(primitives.at[5 * primitive + 3]);
  const uint first_node = unpackUint2x32(primitives.at[5 * primitive + 4]).x;
  uint node;
  const uvec2 leaf = leafOf(nodes, origin, cells_per_unit, size, first_node, q, node);
  if (leaf.y >= kHardLeaf) return kShadePending;
  float best = kFar;
  uint best_at = leaf.x;
  for (uint at = leaf.x; at < leaf.x + leaf.y; ++at) {
    const float squared = squaredDistance(q, pairAt(entry_points, at));
    best_at = squared < best ? at : best_at;
    best = min(squared, best);
  }
  return entry_ids.at[best_at];
}

void main() {
  const uint slot = invocation();
  if (slot >= count) return;
  const uint64_t key = keys.at[slot];
  uint found = kShadeNone;
  if (unpackUint2x32(key).x != kNoInstance) {
    const uint primitive = primitiveOf(key);
    found = kShadeNotFound;
    if (primitive != kNoPrimitive) found = findNearest(primitive, normalInUnitSquare(pairAt(uv, slot)));
  }
  shade.at[slot] = found;
}
