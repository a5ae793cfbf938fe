// The slab of each sample, by its rank in the order of u: slabs of all trees are numbered through.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "trees.glsl"

layout(push_constant, scalar) uniform Arguments {
  Words order;
  Words heads;  // as in trees_primitives
  Primitives primitives;
  Words slab_starts;
  Words slab_of;  // by sample id
  uint count;
};

void main() {
  const uint i = invocation();
  if (i >= count) return;
  const uint primitive = heads.at[i + 1] - 1;
  const TreePrimitive p = primitives.at[primitive];
  slab_of.at[order.at[i]] = slab_starts.at[primitive] + nodeOfRank(p.count, i - p.first, uLevelsOf(p));
}
