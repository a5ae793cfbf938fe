// Lists of the leaves that cell_lists_near left, found in the primitive's tree: for very uneven densities, and far from
// all samples.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"
#include "cell_lists.glsl"
#include "cell_lists_leaf.glsl"
#include "key_table.glsl"

layout(push_constant, scalar) uniform Arguments {
  Primitives tree_primitives;
  Words slots;
  FloatPairs corners;  // two per node: low, high
  Words lowest_ids;
  FloatPairs tree_points;
  Words tree_ids;
  CellPrimitives primitives;
  CellPlaces places;
  LongWords nodes;
  Words lists;   // kListLimit words per leaf of this dispatch
  Words counts;  // per leaf, and one more for the scan
  uint first;    // leaves first .. end
  uint end;
  uint capacity;
};
#include "cell_lists_tree.glsl"

// Nodes that are looked at for one leaf; a leaf that needs more gets no list.
const uint kMaxNodes = 256;

bool isOut(vec2 low, vec2 high) {
  for (uint i = 0; i < 4; ++i) {
    const vec2 corner = cornerOf(i);
    if (squaredDistanceOfBoxes(corner, corner, low, high) <= limits[i]) return false;
  }
  return true;
}

// Of samples that are all at one point the one with the lowest id.
uint lowestBelow(TreePrimitive p, uint node) {
  const uint depth = depthOf(p);
  while (node < (1u << depth)) {
    node *= 2;
    if (lowest_ids.at[p.first_node + node + 1] < lowest_ids.at[p.first_node + node]) ++node;
  }
  return samplesOfLeaf(p, node - (1u << depth)).x;
}

bool findCandidates(TreePrimitive p) {
  const uint leaves = 1u << depthOf(p);
  const uvec2 home = samplesOfLeaf(p, leafAround(p, centre));
  for (uint at = home.x; at < home.y; ++at) limitBy(pairAt(tree_points, at));
  uint visited = 0;
  for (uint node = 1; node != 0;) {
    if (++visited > kMaxNodes) return false;
    bool enter = true;
    if (leaves > 1) {
      const vec2 low = pairAt(corners, 2 * (p.first_node + node));
      const vec2 high = pairAt(corners, 2 * (p.first_node + node) + 1);
      enter = !isOut(low, high);
      if (enter && low == high) {
        offer(lowestBelow(p, node), low);
        enter = false;
      }
    }
    if (enter && node >= leaves) {
      const uvec2 range = samplesOfLeaf(p, node - leaves);
      for (uint at = range.x; at < range.y; ++at) {
        const vec2 point = pairAt(tree_points, at);
        limitBy(point);
        offer(at, point);
      }
    }
    if (list_count > kListLimit) return false;
    node = enter && node < leaves ? 2 * node : nodeAfter(node);
  }
  return true;
}

bool findList(CellPlace place) {
  const CellPrimitive cells = primitives.at[place.primitive];
  placeLeaf(place, cells);
  list_count = 0;
  near_squared = 8.0;
  limits = vec4(8.0);
  if (!findCandidates(tree_primitives.at[findPrimitive(slots, capacity, tree_primitives, cells.key)])) return false;
  thinList(tree_points, tree_ids);
  return true;
}

void main() {
  const uint i = invocation();
  if (first + i > end) return;
  if (first + i == end) {
    counts.at[i] = 0;
    return;
  }
  uint count = 0;
  const uint node = first + i;
  if (unpackUint2x32(nodes.at[node]).y == kHardLeaf && findList(places.at[node])) {
    count = list_count;
    writeList(tree_ids, lists, i * kListLimit);
  }
  counts.at[i] = count;
}
