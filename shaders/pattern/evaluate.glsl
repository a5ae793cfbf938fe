// main() of every generated pattern shader. core/pattern/generate.cpp defines before it:
//   OUTPUTS            ShadingInputs, PathInputs, OpacityInputs or DisplacementInputs
//   TEXTURE_SLOTS      most textures that a material looks up
//   evaluateMaterial() a material's outputs from its textures' values

layout(local_size_x = 64) in;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Points { PatternPoint point[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Order { uint index[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Values { OUTPUTS value[]; };
// Of every material: its first in TextureNodes, and how many there are.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer MaterialTextures { uvec2 range[]; };

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Floats data;
  Values values;
  Order order;  // the points to evaluate, where `ordered`; else all of them
  MaterialTextures textures;
  TextureNodes nodes;
  TextureTables tables;
  uint count;  // of points to evaluate
  uint ordered;
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint n = group * gl_WorkGroupSize.x + gl_LocalInvocationIndex;
  if (n >= count) return;
  const uint i = ordered != 0u ? order.index[n] : n;
  const PatternPoint point = points.point[i];
  vec4 texel[max(TEXTURE_SLOTS, 1)];
#if TEXTURE_SLOTS > 0
  const uvec2 range = textures.range[point.material];
  for (uint slot = 0u; slot < TEXTURE_SLOTS; ++slot)
    texel[slot] = slot < range.y ? evaluateTexture(tables, nodes.node[range.x + slot], data, point.first) : vec4(0.0);
#endif
  values.value[i] = evaluateMaterial(point.material, data, point.first, texel);
}
