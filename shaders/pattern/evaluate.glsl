// main() of every generated pattern shader. core/pattern/generate.cpp defines before it:
//   OUTPUTS            ShadingInputs or PathInputs
//   TEXTURE_SLOTS      most textures that a material looks up
//   textureOf()        the constants of a material's n-th texture
//   evaluateMaterial() a material's outputs from its textures' values

layout(local_size_x = 64) in;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Points { PatternPoint point[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Values { OUTPUTS value[]; };

layout(push_constant, scalar) uniform Arguments {
  Points points;
  Values values;
  MipLevels levels;
  uint count;  // of points
};

void main() {
  const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
  const uint i = group * gl_WorkGroupSize.x + gl_LocalInvocationIndex;
  if (i >= count) return;
  const PatternPoint point = points.point[i];
  vec4 texel[max(TEXTURE_SLOTS, 1)];
  for (uint slot = 0u; slot < TEXTURE_SLOTS; ++slot)
    texel[slot] = evaluateTexture(levels, textureOf(point.material, slot), point);
  values.value[i] = evaluateMaterial(point.material, point, texel);
}
