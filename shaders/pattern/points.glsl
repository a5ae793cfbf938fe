// The floats of a batch's points: what each of them reads, in the order of its material's PointLayout.

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Floats { float f[]; };

vec2 read2(Floats data, uint i) { return vec2(data.f[i], data.f[i + 1u]); }
vec3 read3(Floats data, uint i) { return vec3(data.f[i], data.f[i + 1u], data.f[i + 2u]); }
vec4 read4(Floats data, uint i) { return vec4(data.f[i], data.f[i + 1u], data.f[i + 2u], data.f[i + 3u]); }
