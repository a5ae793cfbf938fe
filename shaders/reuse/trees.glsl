// Layout and arithmetic of the trees (core/reuse/trees.h explains both).

// Written by trees_primitives, trees_shape and trees_layout; read by everything after them.
struct TreePrimitive {
  SurfaceKey key;
  uint first;       // its samples are first .. first + count
  uint count;       // at least 1
  uint first_node;  // its node number j is at first_node + j; 1 is the root
  uint levels;      // depth | u_levels << 8
};

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Primitives {
  TreePrimitive at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Boxes {
  vec4 at[];  // low u, low v, high u, high v
};

uint depthOf(TreePrimitive primitive) { return primitive.levels & 0xff; }
uint uLevelsOf(TreePrimitive primitive) { return primitive.levels >> 8; }

// First sample of node j (from 0) of 2^level, counted from the primitive's first.
uint firstRank(uint count, uint j, uint level) { return uint((uint64_t(count) * j) >> level); }

// The node (from 0) of 2^level that holds the sample of this rank.
uint nodeOfRank(uint count, uint rank, uint level) {
  uint node = 0;
  for (uint l = 1; l <= level; ++l) {
    node *= 2;
    if (rank >= firstRank(count, node + 1, l)) ++node;
  }
  return node;
}

// The number of the owner of item i, where starts[owner] is its first item, ascending, and owners without
// items have the start of the next.
uint ownerOf(Words starts, uint owners, uint i) {
  uint low = 0;
  uint high = owners;
  while (high - low > 1) {
    const uint middle = (low + high) / 2;
    if (starts.at[middle] <= i) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

// The nearest point of the unit square; what is not a number counts as 0. Comparisons on bits, because
// a compiler may assume that floats are numbers.
float inUnitInterval(float x) {
  const uint bits = floatBitsToUint(x);
  if (bits > 0x7f800000u) return 0.0;  // negative (-0 too), or not a number
  return bits > floatBitsToUint(1.0) ? 1.0 : x;
}
vec2 inUnitSquare(vec2 p) { return vec2(inUnitInterval(p.x), inUnitInterval(p.y)); }
