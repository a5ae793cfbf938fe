// The fields that core's structures and their Python dictionaries share by name, listed once: the delegate's calls
// are read through them (dictionaries.h), and what is read back is written through them (scene_reading.cpp).
#pragma once

#include "core/scene/camera.h"
#include "core/scene/light.h"
#include "core/scene/material.h"

namespace encore::python {

// Each calls visit(name, field) in the order of the dictionaries. Not listed: what a call takes as an argument of its
// own, and what has a form of its own in Python.
template <class L, class Visit>
void forEachLightField(L& light, const Visit& visit) {
  visit("diffuse", light.diffuse);
  visit("specular", light.specular);
  visit("direction", light.direction);
  visit("angle_radians", light.angle_radians);
  visit("centre", light.centre);
  visit("half_u", light.half_u);
  visit("half_v", light.half_v);
  visit("radius", light.radius);
  visit("samples", light.samples);
  visit("instance", light.instance);
  visit("texture", light.texture);
  visit("format", light.format);
  visit("axis_x", light.axis_x);
  visit("axis_y", light.axis_y);
  visit("axis_z", light.axis_z);
  visit("shaped", light.shaped);
  visit("shaping_axis", light.shaping_axis);
  visit("focus", light.focus);
  visit("focus_tint", light.focus_tint);
  visit("cone_angle_radians", light.cone_angle_radians);
  visit("cone_softness", light.cone_softness);
  visit("shadow_enable", light.shadow_enable);
  visit("shadow_color", light.shadow_color);
  visit("shadow_distance", light.shadow_distance);
  visit("shadow_falloff", light.shadow_falloff);
  visit("shadow_falloff_gamma", light.shadow_falloff_gamma);
  visit("lit_groups", light.lit_groups);
  visit("shadow_groups", light.shadow_groups);
}

template <class C, class Visit>
void forEachCameraField(C& camera, const Visit& visit) {
  visit("centre_tangent", camera.centre_tangent);
  visit("near_clip", camera.near_clip);
  visit("far_clip", camera.far_clip);
  visit("projection", camera.projection);
  visit("lens_radius", camera.lens_radius);
  visit("focus_distance", camera.focus_distance);
  visit("aperture_blades", camera.aperture_blades);
  visit("aperture_rotation_radians", camera.aperture_rotation_radians);
  visit("exposure_scale", camera.exposure_scale);
}

template <class N, class Visit>
void forEachNodeField(N& node, const Visit& visit) {
  visit("texture", node.texture);
  visit("udim", node.udim);
  visit("texcoord", node.texcoord);
  visit("texcoord_fallback", node.texcoord_fallback);
  visit("st_transform", node.st_transform);
  visit("wrap_s", node.wrap_s);
  visit("wrap_t", node.wrap_t);
  visit("scale", node.scale);
  visit("bias", node.bias);
  visit("fallback", node.fallback);
  visit("primvar", node.primvar);
}

template <class M, class Visit>
void forEachMaterialInput(M& material, const Visit& visit) {
  visit("diffuse_color", material.diffuse_color);
  visit("emissive_color", material.emissive_color);
  visit("specular_color", material.specular_color);
  visit("metallic", material.metallic);
  visit("roughness", material.roughness);
  visit("clearcoat", material.clearcoat);
  visit("clearcoat_roughness", material.clearcoat_roughness);
  visit("opacity", material.opacity);
  visit("ior", material.ior);
  visit("normal", material.normal);
  visit("displacement", material.displacement);
}

}  // namespace encore::python
