// Walks of a primitive's tree in the order of its nodes, for what has no list of candidates or needs one.

// The leaf (from 0) that this point lies in.
uint leafAround(TreePrimitive p, vec2 at) {
  const uint depth = depthOf(p);
  uint node = 1;
  for (uint level = 0; level < depth; ++level) {
    const bool in_u = level < uLevelsOf(p);
    const uint right = 2 * node + 1;
    const vec2 border = pairAt(corners, 2 * (p.first_node + right));
    node = (in_u ? at.x >= border.x : at.y >= border.y) ? right : right - 1;
  }
  return node - (1u << depth);
}

// First sample and end of a leaf (from 0).
uvec2 samplesOfLeaf(TreePrimitive p, uint leaf) {
  const uint depth = depthOf(p);
  return p.first + uvec2(firstRank(p.count, leaf, depth), firstRank(p.count, leaf + 1, depth));
}

// The node that follows in the order of the walk when nothing below this one is wanted; 0: none.
uint nodeAfter(uint node) {
  node >>= findLSB(~node);
  return node == 0 ? 0 : node + 1;
}
