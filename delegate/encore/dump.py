"""The translated scene as canonical text: the same for equal scenes, readable, and stable between runs."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from encore.render_index import Translation

_SHOWN = 24  # numbers of an array that are written out; of longer ones, bounds and a checksum


def dump(translation: Translation) -> str:
    """Every part of the scene, in the scene's order, by path where it has one. Numbers have six digits."""
    scene = translation.scene
    lines = [f"image {translation.width} x {translation.height}"]
    lines += _section("camera", scene.camera)
    materials = [scene.material(i) for i in range(scene.material_count)]
    names = [m["path"] for m in materials]
    for i in range(scene.light_count):
        lines += _section("light", scene.light(i))
    for i in range(scene.texture_count):
        lines += _section("texture", scene.texture(i))
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
        if any(instance["shading_rate"]):
            lines.append(f"  shading_rate: {_text(instance['shading_rate'])}")
    lines += [f"report {line}" for line in translation.reports.lines()]
    return "\n".join(lines) + "\n"


def _section(kind: str, values: Mapping[str, Any]) -> list[str]:
    lines = [f"{kind} {values['path']}"]
    return lines + [f"  {name}: {_text(value)}" for name, value in values.items() if name != "path"]


def _mesh(mesh: Mapping[str, Any], materials: list[str]) -> list[str]:
    lines = [f"mesh {mesh['path']}"]
    for name, value in mesh.items():
        if name in ("path", "material", "face_materials", "texcoords", "normals", "display_color"):
            continue
        if isinstance(value, np.ndarray) and value.size == 0:
            continue
        lines.append(f"  {name}: {_text(value)}")
    for primvar in (mesh["normals"], mesh["display_color"], *mesh["texcoords"]):
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
        text = _text(source["value"])
        if source["node"] >= 0:
            text = f"node {material['nodes'][source['node']]['path']} channel {source['channel']}"
        lines.append(f"  {name}: {text}")
    for name in ("use_specular_workflow", "opacity_threshold"):
        lines.append(f"  {name}: {_text(material[name])}")
    for node in material["nodes"]:
        lines.append(f"  node {node['path']} {node['kind']}")
        if node["kind"] == "texture":
            texture = scene.texture(node["texture"])["path"] if node["texture"] >= 0 else "none"
            values = {**node, "texture": texture}
            lines += [f"    {k}: {_text(v)}" for k, v in values.items() if k not in ("kind", "path")]
    return lines


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
    return "(" + ", ".join(_number(v) if isinstance(v, float) else str(v) for v in values) + ")"


def _number(value: float) -> str:
    text = f"{value:.6g}"
    return "0" if text == "-0" else text
