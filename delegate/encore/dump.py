"""The translated scene as canonical text: the same for equal scenes, readable, and stable between runs."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from encore.render_index import Translation

_SHOWN = 24  # numbers of an array that are written out; of longer ones, bounds and a checksum


def dump(translation: Translation) -> str:
    """Every part of the scene, in the scene's order, by path where it has one. Numbers have six digits."""
    scene = translation.scene
    lines = [f"image {translation.width} x {translation.height}"]
    opens, closes = translation.shutter
    if closes > opens:
        lines.append(f"shutter {_number(opens)} to {_number(closes)}")
    lines += _camera(scene.camera)
    materials = [scene.material(i) for i in range(scene.material_count)]
    names = [m["path"] for m in materials]
    for i in range(scene.light_count):
        lines += _light(scene.light(i), scene)
    for i in range(scene.texture_count):
        lines += _texture(scene.texture(i))
    for material in materials:
        lines += _material(material, scene)
    for i in range(scene.mesh_count):
        lines += _mesh(scene.mesh(i), names)
    for i in range(scene.prototype_count):
        prototype = scene.prototype(i)
        meshes = " ".join(scene.mesh(m)["path"] for m in prototype["meshes"])
        lines += [f"prototype {prototype['path']}", f"  meshes: {meshes}"]
    for i in range(scene.instance_count):
        instance = scene.instance(i)
        lines += [
            f"instance {instance['path']}",
            f"  prototype: {scene.prototype(instance['prototype'])['path']}",
            f"  to_world: {_array(instance['to_world'][:, :3])}",
        ]
        if instance["material"] >= 0:
            lines.append(f"  material: {names[instance['material']]}")
        if len(instance["motion"]):
            lines.append(f"  motion: {_array(_stacked(instance['motion'])[..., :3])}")
        if instance["link_group"] >= 0:
            lines.append(f"  link_group: {instance['link_group']}")
        if any(instance["shading_rate"]):
            lines.append(f"  shading_rate: {_text(instance['shading_rate'])}")
        for primvar in instance["primvars"]:
            wins = " over the meshes' own" if primvar["wins"] else ""
            lines.append(f"  primvar {primvar['name']}: {_text(primvar['value'])}{wins}")
    lines += [f"report {line}" for line in translation.reports.lines()]
    return "\n".join(lines) + "\n"


# What is printed of a light of each kind, besides what all have and what differs from the schema's fallbacks.
_SHAPES = {
    "distant": ("direction", "angle_radians"),
    "rect": ("centre", "half_u", "half_v"),
    "disk": ("centre", "half_u", "half_v"),
    "sphere": ("centre", "radius"),
    "cylinder": ("centre", "half_u", "radius"),
    "dome": ("axis_x", "axis_y", "axis_z"),
    "mesh": (),
}
_SHAPING = ("shaping_axis", "focus", "focus_tint", "cone_angle_radians", "cone_softness")
_SHADOW = {
    "shadow_enable": True,
    "shadow_color": (0.0, 0.0, 0.0),
    "shadow_distance": -1.0,
    "shadow_falloff": -1.0,
    "shadow_falloff_gamma": 1.0,
}
_LENS = ("lens_radius", "focus_distance", "aperture_blades", "aperture_rotation_radians")


def _camera(camera: Mapping[str, Any]) -> list[str]:
    names = ["projection", "to_world", "motion", "half_tangent", "centre_tangent", "near_clip", "far_clip"]
    names += ["clipping_planes", *(_LENS if camera["lens_radius"] > 0 else ()), "exposure_scale"]
    shown = {name: _stacked(camera[name]) for name in names}
    lines = [f"  {name}: {_text(value)}" for name, value in shown.items() if np.size(value)]
    return [f"camera {camera['path']}", *lines]


def _stacked(value: Any) -> Any:
    """Lists (keys of motion, planes) as one array."""
    return np.array(value) if isinstance(value, list) else value


def _light(light: Mapping[str, Any], scene: Any) -> list[str]:
    lines = [f"light {light['path']}"]
    names = ["kind", "radiance", "diffuse", "specular", *_SHAPES[light["kind"]]]
    names += [name for name in ("samples", "lit_groups", "shadow_groups") if light[name]]
    names += _SHAPING if light["shaped"] else ()
    names += [name for name, neutral in _SHADOW.items() if light[name] != neutral]
    lines += [f"  {name}: {_text(light[name])}" for name in names]
    if light["texture"] >= 0:
        form = f" {light['format']}" if light["kind"] == "dome" else ""
        lines.append(f"  texture: {scene.texture(light['texture'])['path']}{form}")
    if light["instance"] >= 0:
        lines.append(f"  instance: {scene.instance(light['instance'])['path']}")
    return lines


def _texture(texture: Mapping[str, Any]) -> list[str]:
    lines = [f"texture {texture['path']}", f"  size: {texture['width']} x {texture['height']}"]
    pixels = texture["pixels"]
    return lines if pixels is None else [*lines, f"  pixels: {_text(pixels)}"]


# Of meshes: what has lines of its own, and what is only said where it is not so.
_APART = ("path", "material", "face_materials", "texcoords", "primvars", "normals", "display_color", "widths")
_MESH_NEUTRAL = {"thin_walled": False, "link_group": 0, "shape": "faces"}
# Of meshes: what is only said of other shapes than faces, and what is said of faces alone.
_OF_CURVES = ("basis", "wrap")
_OF_FACES = (
    "scheme",
    "interpolate_boundary",
    "face_varying",
    "triangle_subdivision",
    "left_handed",
)
# Of materials: what is only said where it does something.
_INPUT_NEUTRAL = {"normal": (0.0, 0.0, 1.0), "displacement": 0.0}


def _mesh(mesh: Mapping[str, Any], materials: list[str]) -> list[str]:
    lines = [f"mesh {mesh['path']}"]
    shape = mesh["shape"]
    unsaid = {*_APART, *(() if shape == "curves" else _OF_CURVES), *(() if shape == "faces" else _OF_FACES)}
    for name, value in ((n, _stacked(v)) for n, v in mesh.items() if n not in unsaid):
        if isinstance(value, np.ndarray) and value.size == 0:
            continue
        if name in _MESH_NEUTRAL and value == _MESH_NEUTRAL[name]:
            continue
        lines.append(f"  {name}: {_text(value)}")
    for primvar in (
        mesh["widths"],
        mesh["normals"],
        mesh["display_color"],
        *mesh["texcoords"],
        *mesh["primvars"],
    ):
        if primvar:
            indices = f" indices {_array(primvar['indices'])}" if primvar["indices"].size else ""
            lines.append(
                f"  {primvar['name']}: {primvar['interpolation']} {_array(primvar['values'])}{indices}"
            )
    lines.append(f"  material: {materials[mesh['material']]}")
    if mesh["face_materials"].size:
        per_face = ["-" if i < 0 else materials[i] for i in mesh["face_materials"][:_SHOWN]]
        rest = f" … {_array(mesh['face_materials'])}" if mesh["face_materials"].size > _SHOWN else ""
        lines.append(f"  face_materials: {' '.join(per_face)}{rest}")
    return lines


def _material(material: Mapping[str, Any], scene: Any) -> list[str]:
    lines = [f"material {material['path']}"]
    for name, source in material["inputs"].items():
        if source["node"] < 0 and source["value"] == _INPUT_NEUTRAL.get(name):
            continue
        lines.append(f"  {name}: {_source(source, material['nodes'])}")
    for name in ("use_specular_workflow", "opacity_threshold"):
        lines.append(f"  {name}: {_text(material[name])}")
    for name, neutral in (("opacity_mode", "transparent"), ("dielectric_priority", 0)):
        if material[name] != neutral:
            lines.append(f"  {name}: {_text(material[name])}")
    for name in ("surface_shader", "displacement_shader"):
        if material[name]:
            lines += _shader(name, material[name], material["nodes"])
    for node in material["nodes"]:
        lines.append(f"  node {node['path']} {node['kind']}")
        lines += [f"    {name}: {text}" for name, text in _node(node, scene).items()]
    return lines


def _source(source: Mapping[str, Any], nodes: Sequence[Mapping[str, Any]]) -> str:
    """An input: its constant, or the node that it comes from."""
    if source["node"] < 0:
        return _text(source["value"])
    return f"node {nodes[source['node']]['path']} channel {source['channel']}"


def _shader(name: str, shader: Mapping[str, Any], nodes: Sequence[Mapping[str, Any]]) -> list[str]:
    checksum = zlib.crc32(shader["source"].encode())
    lines = [f"  {name} {shader['path']}", f"    source: {shader['file']} crc {checksum:08x}"]
    return lines + [
        f"    {p['type']} {p['name']}: {_source(p['input'], nodes)}" for p in shader["parameters"]
    ]


def _node(node: Mapping[str, Any], scene: Any) -> dict[str, str]:
    def path(texture: int) -> str:
        return scene.texture(texture)["path"] if texture >= 0 else "none"

    if node["kind"] == "primvar":
        return {name: _text(node[name]) for name in ("primvar", "fallback")}
    if node["kind"] != "texture":
        return {}
    left_out = {"kind", "path", "primvar", "udim", "texture"}
    shown = {name: _text(value) for name, value in node.items() if name not in left_out}
    if node["udim"]:
        tiles = (f"{1001 + i} {path(t)}" for i, t in enumerate(node["udim"]) if t >= 0)
        return {"udim": ", ".join(tiles), **shown}
    return {"texture": path(node["texture"]), **shown}


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, (tuple, list)):
        return _numbers(value)
    return str(value)


def _array(array: npt.NDArray[Any]) -> str:
    flat = array.ravel()
    if flat.size <= _SHOWN:
        return _numbers(flat.tolist())
    shape = " x ".join(str(n) for n in array.shape)
    checksum = zlib.crc32(np.ascontiguousarray(flat).tobytes())
    return f"[{shape}] {_number(float(flat.min()))} to {_number(float(flat.max()))}, crc {checksum:08x}"


def _numbers(values: Iterable[Any]) -> str:
    return "(" + ", ".join(_text(v) for v in values) + ")"


def _number(value: float) -> str:
    text = f"{value:.6g}"
    return "0" if text == "-0" else text
