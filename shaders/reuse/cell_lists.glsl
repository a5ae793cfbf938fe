// Layout and arithmetic of the cell lists (core/reuse/cell_lists.h explains both).
#include "nearest_neighbour.glsl"

// Five words of 64 bits, so that five loads read it all (core/reuse/cell_lists.h declares the same).
struct CellPrimitive {
  SurfaceKey key;
  vec2 origin;          // lower corner of the root cells
  vec2 cells_per_unit;  // 0 along both axes where there is one cell
  uint columns;
  uint rows;
  uint first_node;  // root cell (i, j) is node first_node + j * columns + i
  uint unused;
};
layout(buffer_reference, scalar, buffer_reference_align = 8) buffer CellPrimitives {
  CellPrimitive at[];
};
layout(buffer_reference, scalar, buffer_reference_align = 8) buffer LongWords {
  uint64_t at[];
};

// Where a node is, only while lists are built.
struct CellPlace {
  vec2 corner;  // lower corner, in root cells from the origin
  uint primitive;
  uint bits;  // its size is 2^-bits of a root cell: u in the low, v in the high half
};
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer CellPlaces {
  CellPlace at[];
};

// A node is two words. Leaf: first entry of its list, and how many. Inner: first child, and kInner | bits of the
// children's columns | bits of their rows << 8; child (i, j) is first + (j << column bits) + i.
const uint kInner = 0x80000000u;
const uint kTreeLeaf = 0x40000000u;  // no list: searched by tree
const uint kHardLeaf = 0x20000000u;  // only while lists are built: too much around it for the grid

// The leaf that a point lies in: both words of it. All steps are monotone in the coordinates; below the root
// cells they are exact, so that the leaves are what CellPlace says up to the rounding of `t`.
uvec2 leafOf(LongWords nodes, vec2 origin, vec2 cells_per_unit, uvec2 size, uint first_node, vec2 at, out uint node) {
  precise vec2 t = (at - origin) * cells_per_unit;
  t = clamp(t, vec2(0.0), vec2(size));
  uvec2 cell = min(uvec2(t), size - 1);
  node = first_node + cell.y * size.x + cell.x;
  uvec2 record = unpackUint2x32(nodes.at[node]);
  while ((record.y & kInner) != 0) {
    t -= vec2(cell);
    const uvec2 bits = uvec2(record.y & 0xff, (record.y >> 8) & 0xff);
    const uvec2 sides = uvec2(1) << bits;
    t *= vec2(sides);
    cell = min(uvec2(t), sides - 1);
    node = record.x + (cell.y << bits.x) + cell.x;
    record = unpackUint2x32(nodes.at[node]);
  }
  return record;
}
