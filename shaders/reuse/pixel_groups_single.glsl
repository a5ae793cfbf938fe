// The search of samples that do not go with a group. A sample near q is found in the cells around it; then all cells
// are looked through that can hold a nearer one.

// Refined cells that wait to be looked through. Those that find no room are looked through whole.
const uint kStackSize = 24;

struct Nearest {
  float squared;
  uint id;
};

void offerOne(uint i, vec2 q, inout Nearest nearest) {
  const float squared = squaredDistance(q, pairAt(points, i));
  if (squared > nearest.squared) return;
  const uint id = ids.at[i];
  if (squared < nearest.squared || id < nearest.id) nearest = Nearest(squared, id);
}

// The best of the cells around q, of the least block of them that holds any sample.
void searchAround(GridPrimitive grid, vec2 q, inout Nearest nearest) {
  const ivec2 cell = ivec2(cellOf(grid, q));
  const ivec2 last = ivec2(grid.columns, grid.rows) - 1;
  for (int half_width = 1;; half_width *= 2) {
    uvec2 from = uvec2(max(cell - half_width, 0));
    uvec2 to = uvec2(min(cell + half_width, last));
    const uint width = to.x - from.x;
    // Full rows are consecutive.
    const bool full = width + 1 == grid.columns;
    const uint rows = full ? 1 : to.y - from.y + 1;
    for (uint row = 0; row < rows; ++row) {
      const uint first_cell = grid.first_cell + (from.y + row) * grid.columns + from.x;
      const uint last_cell = full ? grid.first_cell + to.y * grid.columns + to.x : first_cell + width;
      const uint first = cell_starts.at[first_cell];
      const uint end = min(cell_starts.at[last_cell + 1], first + 32);  // some of a crowd are enough
      for (uint i = first; i < end; ++i) offerOne(i, q, nearest);
    }
    if (nearest.squared < kFar || (full && to.y - from.y + 1 == grid.rows)) return;
    half_width = min(half_width, 0x20000000);
  }
}

uint findAlone(GridPrimitive primitive, vec2 q) {
  Nearest nearest = Nearest(kFar, 0xffffffffu);
  searchAround(gridAround(primitive, q, q), q, nearest);
  float reach = reachOf(nearest.squared);
  GridPrimitive grid = gridAround(primitive, q - reach, q + reach);
  uint waiting[kStackSize];
  uint depth = 0;
  for (;;) {
    reach = reachOf(nearest.squared);
    const uvec2 from = cellOf(grid, q - reach);
    const uvec2 to = cellOf(grid, q + reach);
    for (uint row = from.y; row <= to.y; ++row) {
      const uint first_cell = cellNumber(grid, uvec2(from.x, row));
      uint start = cell_starts.at[first_cell];
      for (uint cell = first_cell; cell <= first_cell + (to.x - from.x); ++cell) {
        uint end = cell_starts.at[cell + 1];
        const uint next = end;
        if (end - start > max_cell) {
          const uint child = children.at[cell];
          if (child == kOnePlace) {
            end = start + 1;
          } else if (child != kNoChild && depth < kStackSize) {
            waiting[depth++] = child;
            end = start;
          }
        }
        for (uint i = start; i < end; ++i) offerOne(i, q, nearest);
        start = next;
      }
    }
    if (depth == 0) return nearest.id;
    grid = subgrids.at[waiting[--depth]];
  }
}
