#include "core/python/scene_reading.h"

#include "core/python/arrays.h"
#include "core/python/names.h"

namespace encore::python {
namespace {

template <class T>
nb::object triple(Vec3<T> v) {
  return nb::make_tuple(v.x, v.y, v.z);
}
nb::object pair(Vec2f v) { return nb::make_tuple(v.x, v.y); }

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

template <class T>
nb::object readInput(const Input<T>& input) {
  nb::dict d;
  if constexpr (std::is_same_v<T, float>)
    d["value"] = input.value;
  else
    d["value"] = triple(input.value);
  d["node"] = input.node;
  d["channel"] = input.channel;
  return d;
}

nb::dict readNode(const PatternNode& node) {
  nb::dict d;
  d["kind"] = toName(kNodeKinds, node.kind);
  d["path"] = node.path;
  d["texture"] = node.texture;
  d["texcoord"] = node.texcoord;
  d["st_transform"] = node.st_transform;
  d["wrap_s"] = toName(kWrapModes, node.wrap_s);
  d["wrap_t"] = toName(kWrapModes, node.wrap_t);
  d["scale"] = node.scale;
  d["bias"] = node.bias;
  d["fallback"] = node.fallback;
  return d;
}

}  // namespace

nb::dict readMesh(const Mesh& mesh) {
  nb::dict d;
  d["path"] = mesh.path;
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
  d["face_materials"] = copyToNumpy(mesh.face_materials);
  d["material"] = mesh.material;
  d["target_edge_length_world"] = mesh.target_edge_length_world;
  d["shading_rate"] = nb::make_tuple(mesh.shading_rate[0], mesh.shading_rate[1], mesh.shading_rate[2]);
  return d;
}

nb::dict readInstance(const Instance& instance) {
  nb::dict d;
  d["path"] = instance.path;
  d["prototype"] = instance.prototype;
  d["to_world"] = matrix(instance.to_world);
  d["material"] = instance.material;
  d["shading_rate"] = nb::make_tuple(instance.shading_rate[0], instance.shading_rate[1], instance.shading_rate[2]);
  return d;
}

nb::dict readTexture(const Texture& texture) {
  nb::dict d;
  d["path"] = texture.path;
  d["pixels"] = toNumpy(std::vector<float>(texture.rgba), {texture.height, texture.width, 4});
  return d;
}

nb::dict readMaterial(const Material& material) {
  nb::dict d, inputs;
  inputs["diffuse_color"] = readInput(material.diffuse_color);
  inputs["emissive_color"] = readInput(material.emissive_color);
  inputs["specular_color"] = readInput(material.specular_color);
  inputs["metallic"] = readInput(material.metallic);
  inputs["roughness"] = readInput(material.roughness);
  inputs["clearcoat"] = readInput(material.clearcoat);
  inputs["clearcoat_roughness"] = readInput(material.clearcoat_roughness);
  inputs["opacity"] = readInput(material.opacity);
  inputs["ior"] = readInput(material.ior);
  nb::list nodes;
  for (const PatternNode& node : material.nodes) nodes.append(readNode(node));
  d["path"] = material.path;
  d["inputs"] = inputs;
  d["nodes"] = nodes;
  d["use_specular_workflow"] = material.use_specular_workflow;
  d["opacity_threshold"] = material.opacity_threshold;
  return d;
}

nb::dict readLight(const Light& light) {
  nb::dict d;
  d["kind"] = toName(kLightKinds, light.kind);
  d["path"] = light.path;
  d["radiance"] = triple(light.radiance);
  d["diffuse"] = light.diffuse;
  d["specular"] = light.specular;
  d["direction"] = triple(light.direction);
  d["angle_radians"] = light.angle_radians;
  d["centre"] = triple(light.centre);
  d["half_u"] = triple(light.half_u);
  d["half_v"] = triple(light.half_v);
  d["radius"] = light.radius;
  return d;
}

nb::dict readCamera(const Camera& camera) {
  nb::dict d;
  d["path"] = camera.path;
  d["to_world"] = matrix(camera.to_world);
  d["half_tangent"] = pair(camera.half_tangent);
  d["centre_tangent"] = pair(camera.centre_tangent);
  d["near_clip"] = camera.near_clip;
  d["far_clip"] = camera.far_clip;
  return d;
}

}  // namespace encore::python
