// What both kernels of pixel groups share: the grids and their refinement, and which part of a grid can hold what
// is near.
#include "key_table.glsl"
#include "nearest_neighbour.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives primitives;
  Words slots;
  Primitives subgrids;
  Words children;
  Words cell_starts;
  FloatPairs points;
  Words ids;
  FloatPairs keys;  // as two words each
  FloatPairs uv;
  Words shade;
  uint count;
  uint capacity;
  uint samples_per_pixel;
  uint max_cell;  // cells of more samples than this have a child
};

SurfaceKey keyAt(uint slot) {
  const uvec2 words = unpackUint2x32(keys.at[slot]);
  return SurfaceKey(words.x, words.y);
}

// Whether fl(|a - c|²) > fl(|a - t|²) is certain, whatever the rounding, from squared distances c and t. It is
// then certain between points where it is: c (1 - e) - t (1 + e) is a concave function of a.
bool isCertainlyFarther(float c, float t) { return c > t * 1.00001 + 1e-36; }

// What is as near as this squared distance, or nearer, has coordinates that differ by no more than this.
float reachOf(float squared) { return sqrt(squared * 1.0001 + 1e-36) * 1.0001; }

// The smallest grid that holds all of the primitive's samples between two corners.
GridPrimitive gridAround(GridPrimitive grid, vec2 low, vec2 high) {
  if (max_cell == 0xffffffffu) return grid;
  for (;;) {
    const uvec2 cell = cellOf(grid, low);
    if (cell != cellOf(grid, high)) return grid;
    const uint number = cellNumber(grid, cell);
    if (cell_starts.at[number + 1] - cell_starts.at[number] <= max_cell) return grid;
    const uint child = children.at[number];
    if (child >= kOnePlace) return grid;
    grid = subgrids.at[child];
  }
}
