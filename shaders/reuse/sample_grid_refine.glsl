// What the kernels that refine grids share. A level is made from the crowded cells of the one before, of which each
// becomes a grid of its own; their samples are numbered through, as items.

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Grids {
  GridPrimitive at[];
};

// The number of the owner of item i, where starts[owner] is its first item, ascending.
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
