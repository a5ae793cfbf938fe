"""Shaders whose source is GLSL: their source, and their inputs as parameters (docs/glsl.md)."""

from __future__ import annotations

import re
from typing import Any

from pxr import Ar, Sdf, UsdShade

from encore.adapters.context import SyncContext, floats
from encore.adapters.network import Network

SOURCE_TYPE = "glsl"
# Inputs that say how a GLSL surface is used; they are no parameters of it.
SURFACE_OPTIONS = ("opacityMode", "opacityThreshold", "useSpecularWorkflow")

_IDENTIFIER = re.compile(r"(?!gl_)[A-Za-z_][A-Za-z0-9_]*")
_EXTENSIONS = (".glsl", ".frag", ".comp")
_VECTORS = {2: "vec2", 3: "vec3", 4: "vec4"}


def is_glsl(shader: UsdShade.Shader) -> bool:
    """Whether the shader names GLSL code, by info:sourceAsset, info:sourceCode or their glsl: forms."""
    source = shader.GetImplementationSource()
    if source == "sourceAsset":
        asset = shader.GetSourceAsset(SOURCE_TYPE)
        own = shader.GetPrim().GetAttribute("info:glsl:sourceAsset")
        # The universal form may be of any language.
        return bool(asset) and (
            bool(own and own.HasAuthoredValue()) or asset.path.lower().endswith(_EXTENSIONS)
        )
    return source == "sourceCode" and bool(shader.GetSourceCode(SOURCE_TYPE))


def read_glsl(
    shader: UsdShade.Shader, network: Network, context: SyncContext, options: tuple[str, ...] = ()
) -> dict[str, Any] | None:
    """The shader as _core.Scene.add_material takes it; None, and a report, where there is no source.

    options: inputs that are not parameters.
    """
    found = _source(shader, network, context)
    if found is None:
        return None
    file, source = found
    parameters: list[dict[str, Any]] = []
    for shader_input in shader.GetInputs():
        name = shader_input.GetBaseName()
        if name not in options:
            parameter = _parameter(shader, shader_input, network, context)
            if parameter is not None and all(p["name"] != parameter["name"] for p in parameters):
                parameters.append(parameter)
            elif parameter is not None:
                network.report(
                    "GLSL parameter",
                    f"{shader.GetPath()}.inputs:{name} has the name of another one in GLSL: it is ignored",
                )
    return {"path": str(shader.GetPath()), "file": file, "source": source, "parameters": parameters}


def _source(shader: UsdShade.Shader, network: Network, context: SyncContext) -> tuple[str, str] | None:
    """What lines are counted in, and the code."""
    if shader.GetImplementationSource() == "sourceCode":
        name = "info:glsl:sourceCode"
        if not shader.GetPrim().GetAttribute(name):
            name = "info:sourceCode"
        return f"{shader.GetPath()}.{name}", str(shader.GetSourceCode(SOURCE_TYPE))
    asset: Sdf.AssetPath = shader.GetSourceAsset(SOURCE_TYPE)
    resolved = asset.resolvedPath
    opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved)) if resolved else None
    if not opened:
        network.error("missing GLSL", f"{asset.path}, the source of {shader.GetPath()}, does not exist")
        return None
    try:
        with opened:
            source = bytes(opened.GetBuffer()).decode("utf-8")
    except UnicodeDecodeError:
        network.error("unreadable GLSL", f"{resolved}, the source of {shader.GetPath()}, is no UTF-8 text")
        return None
    if not source.strip():
        network.error("empty GLSL", f"{resolved}, the source of {shader.GetPath()}, is empty")
        return None
    return resolved, source


def _parameter(
    shader: UsdShade.Shader, shader_input: UsdShade.Input, network: Network, context: SyncContext
) -> dict[str, Any] | None:
    """One input as a parameter: name, GLSL type, and value or connection."""
    where = f"{shader.GetPath()}.inputs:{shader_input.GetBaseName()}"
    name = shader_input.GetBaseName().replace(":", "_")
    type_name = shader_input.GetTypeName()
    kind = glsl_type(type_name)
    if kind is None:
        network.report("GLSL parameter", f"{where} is of type {type_name}, which GLSL has not: it is ignored")
        return None
    if not _IDENTIFIER.fullmatch(name) or "__" in name:
        network.report("GLSL parameter", f"{where} has a name that GLSL does not allow: it is ignored")
        return None
    width = {"float": 1, "int": 1, "vec2": 2, "vec3": 3, "vec4": 4}[kind]
    default = floats(type_name.defaultValue, width) or (0.0,) * width
    if width == 1:
        return {
            "name": name,
            "type": kind,
            "input": network.number(shader, shader_input.GetBaseName(), default[0]),
        }
    return {"name": name, "type": kind, "input": network.vector(shader, shader_input.GetBaseName(), default)}


def glsl_type(type_name: Sdf.ValueTypeName) -> str | None:
    """float, int, vec2, vec3 or vec4, for a USD type that has such a counterpart."""
    if type_name.isArray:
        return None
    value = type_name.defaultValue
    if isinstance(value, (bool, int)):
        return "int"
    if isinstance(value, float):
        return "float"
    dimension = getattr(value, "dimension", None)
    return _VECTORS.get(dimension) if isinstance(dimension, int) else None
