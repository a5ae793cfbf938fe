#include "core/python/scene_reading.h"

#include "core/python/arrays.h"
#include "core/python/fields.h"
#include "core/python/names.h"

namespace encore::python {
namespace {

template <class T>
nb::object triple(Vec3<T> v) {
  return nb::make_tuple(v.x, v.y, v.z);
}
nb::object pair(Vec2f v) { return nb::make_tuple(v.x, v.y); }

// A field as Python sees it: vectors as tuples, enumerations by name.
template <class T>
nb::object readField(const T& field) {
  if constexpr (std::is_enum_v<T>)
    return nb::cast(toName(namesOf(field), field));
  else if constexpr (std::is_same_v<T, Vec3f> || std::is_same_v<T, Vec3d>)
    return triple(field);
  else if constexpr (std::is_same_v<T, Vec2f>)
    return pair(field);
  else if constexpr (std::is_same_v<T, std::vector<uint8_t>>)
    return nb::cast(std::vector<int>(field.begin(), field.end()));
  else
    return nb::cast(field);
}

// USD's row-vector convention, (4, 4).
nb::object matrix(const Affine3d& m) {
  const std::vector<Vec3d> rows{m.ex, m.ey, m.ez, m.origin};
  std::vector<double> values;
  for (size_t i = 0; i < rows.size(); ++i)
    values.insert(values.end(), {rows[i].x, rows[i].y, rows[i].z, i == 3 ? 1. : 0.});
  return toNumpy(std::move(values), {4, 4});
}

template <class T>
nb::object readPrimvar(const Primvar<T>& primvar) {
  if (primvar.empty()) return nb::none();
  nb::dict d;
  d["name"] = primvar.name;
  d["interpolation"] = toName(kInterpolations, primvar.interpolation);
  d["values"] = copyToNumpy(primvar.values);
  d["indices"] = copyToNumpy(primvar.indices);
  return d;
}

nb::object matrices(const std::vector<Affine3d>& keys) {
  nb::list list;
  for (const Affine3d& key : keys) list.append(matrix(key));
  return list;
}

nb::object readKeys(const std::vector<std::vector<Vec3f>>& keys) {
  nb::list list;
  for (const auto& key : keys) list.append(copyToNumpy(key));
  return list;
}

template <class T>
nb::object readInput(const Input<T>& input) {
  nb::dict d;
  if constexpr (std::is_same_v<T, float>)
    d["value"] = input.value;
  else if constexpr (std::is_same_v<T, Vec4f>)
    d["value"] = nb::make_tuple(input.value.x, input.value.y, input.value.z, input.value.w);
  else
    d["value"] = triple(input.value);
  d["node"] = input.node;
  d["channel"] = input.channel;
  return d;
}

nb::object readShader(const std::optional<GlslShader>& shader) {
  if (!shader) return nb::none();
  nb::dict d;
  nb::list parameters;
  for (const GlslParameter& parameter : shader->parameters) {
    nb::dict p;
    p["name"] = parameter.name;
    p["type"] = parameter.type;
    p["input"] = readInput(parameter.input);
    parameters.append(p);
  }
  d["path"] = shader->path;
  d["file"] = shader->file;
  d["source"] = shader->source;
  d["parameters"] = parameters;
  return d;
}

nb::dict readNode(const PatternNode& node) {
  nb::dict d;
  d["kind"] = toName(kNodeKinds, node.kind);
  d["path"] = node.path;
  forEachNodeField(node, [&](const char* key, const auto& field) { d[key] = readField(field); });
  return d;
}

}  // namespace

nb::dict readMesh(const Mesh& mesh) {
  nb::dict d;
  d["path"] = mesh.path;
  d["shape"] = toName(kShapes, mesh.shape);
  d["basis"] = toName(kCurveBases, mesh.basis);
  d["wrap"] = toName(kCurveWraps, mesh.wrap);
  d["widths"] = readPrimvar(mesh.widths);
  d["scheme"] = toName(kSchemes, mesh.scheme);
  d["interpolate_boundary"] = toName(kBoundaries, mesh.boundary);
  d["face_varying"] = toName(kFaceVarying, mesh.face_varying);
  d["triangle_subdivision"] = toName(kTriangleSubdivisions, mesh.triangle_subdivision);
  d["left_handed"] = mesh.left_handed;
  d["double_sided"] = mesh.double_sided;
  d["points"] = copyToNumpy(mesh.points);
  d["face_vertex_counts"] = copyToNumpy(mesh.face_vertex_counts);
  d["face_vertex_indices"] = copyToNumpy(mesh.face_vertex_indices);
  d["hole_indices"] = copyToNumpy(mesh.hole_indices);
  d["corner_indices"] = copyToNumpy(mesh.corner_indices);
  d["corner_sharpnesses"] = copyToNumpy(mesh.corner_sharpnesses);
  d["crease_indices"] = copyToNumpy(mesh.crease_indices);
  d["crease_lengths"] = copyToNumpy(mesh.crease_lengths);
  d["crease_sharpnesses"] = copyToNumpy(mesh.crease_sharpnesses);
  d["normals"] = readPrimvar(mesh.normals);
  d["display_color"] = readPrimvar(mesh.display_color);
  nb::list texcoords;
  for (const auto& texcoord : mesh.texcoords) texcoords.append(readPrimvar(texcoord));
  d["texcoords"] = texcoords;
  nb::list primvars;
  for (const auto& primvar : mesh.primvars) primvars.append(readPrimvar(primvar));
  d["primvars"] = primvars;
  d["motion_points"] = readKeys(mesh.motion_points);
  d["motion_normals"] = readKeys(mesh.motion_normals);
  d["thin_walled"] = mesh.thin_walled;
  d["link_group"] = mesh.link_group;
  d["face_materials"] = copyToNumpy(mesh.face_materials);
  d["material"] = mesh.material;
  d["target_edge_length_world"] = mesh.target_edge_length_world;
  d["shading_rate"] = nb::make_tuple(mesh.shading_rate[0], mesh.shading_rate[1], mesh.shading_rate[2]);
  return d;
}

nb::dict readInstance(const Scene& scene, const Instance& instance) {
  nb::dict d;
  d["path"] = instance.path;
  d["prototype"] = instance.prototype;
  d["to_world"] = matrix(instance.to_world);
  d["motion"] = matrices(instance.motion);
  d["material"] = instance.material;
  d["link_group"] = instance.link_group;
  d["shading_rate"] = nb::make_tuple(instance.shading_rate[0], instance.shading_rate[1], instance.shading_rate[2]);
  nb::list primvars;
  for (const InstancePrimvar& primvar : instance.primvars) {
    nb::dict p;
    p["name"] = scene.instance_primvars.at(primvar.name);
    p["wins"] = primvar.wins;
    p["value"] = nb::make_tuple(primvar.value.x, primvar.value.y, primvar.value.z, primvar.value.w);
    primvars.append(p);
  }
  d["primvars"] = primvars;
  return d;
}

nb::dict readTexture(const Texture& texture) {
  nb::dict d;
  d["path"] = texture.path;
  d["width"] = texture.width;
  d["height"] = texture.height;
  if (texture.rgba.empty())
    d["pixels"] = nb::none();
  else
    d["pixels"] = toNumpy(std::vector<float>(texture.rgba), {texture.height, texture.width, 4});
  return d;
}

nb::dict readMaterial(const Material& material) {
  nb::dict d, inputs;
  forEachMaterialInput(material, [&](const char* key, const auto& input) { inputs[key] = readInput(input); });
  nb::list nodes;
  for (const PatternNode& node : material.nodes) nodes.append(readNode(node));
  d["path"] = material.path;
  d["inputs"] = inputs;
  d["nodes"] = nodes;
  d["use_specular_workflow"] = material.use_specular_workflow;
  d["opacity_threshold"] = material.opacity_threshold;
  d["opacity_mode"] = toName(kOpacityModes, material.opacity_mode);
  d["dielectric_priority"] = material.dielectric_priority;
  d["surface_shader"] = readShader(material.surface_shader);
  d["displacement_shader"] = readShader(material.displacement_shader);
  return d;
}

nb::dict readLight(const Light& light) {
  nb::dict d;
  d["kind"] = toName(kLightKinds, light.kind);
  d["path"] = light.path;
  d["radiance"] = triple(light.radiance);
  forEachLightField(light, [&](const char* key, const auto& field) { d[key] = readField(field); });
  return d;
}

nb::dict readCamera(const Camera& camera) {
  nb::dict d;
  d["path"] = camera.path;
  d["to_world"] = matrix(camera.to_world);
  d["half_tangent"] = pair(camera.half_tangent);
  forEachCameraField(camera, [&](const char* key, const auto& field) { d[key] = readField(field); });
  d["motion"] = matrices(camera.motion);
  nb::list planes;
  for (const ClippingPlane& plane : camera.clipping_planes)
    planes.append(nb::make_tuple(plane.normal.x, plane.normal.y, plane.normal.z, plane.offset));
  d["clipping_planes"] = planes;
  return d;
}

}  // namespace encore::python
