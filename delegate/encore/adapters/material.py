"""UsdShade materials → UsdPreviewSurface with constant inputs and colour textures."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdShade

from encore.adapters.context import SyncContext, floats
from encore.adapters.texture import Textures

# Input of UsdPreviewSurface → key of _core.Scene.add_material, and default (UsdPreviewSurface 2.6).
_COLOURS = {
    "diffuseColor": ("diffuse_color", (0.18, 0.18, 0.18)),
    "emissiveColor": ("emissive_color", (0.0, 0.0, 0.0)),
    "specularColor": ("specular_color", (0.0, 0.0, 0.0)),
}
_NUMBERS = {
    "metallic": ("metallic", 0.0),
    "roughness": ("roughness", 0.5),
    "clearcoat": ("clearcoat", 0.0),
    "clearcoatRoughness": ("clearcoat_roughness", 0.01),
    "opacity": ("opacity", 1.0),
    "ior": ("ior", 1.5),
}
_TEXTURED = ("diffuseColor", "emissiveColor")
# Have no effect yet, with the value at which they would have none anyway.
_WITHOUT_EFFECT: dict[str, tuple[float, ...]] = {
    "normal": (0.0, 0.0, 1.0),
    "displacement": (0.0,),
    "occlusion": (1.0,),
}


@dataclass(frozen=True)
class MaterialData:
    """One material as _core.Scene.add_material takes it. cut_out: nothing that it is bound to is visible."""

    path: str
    inputs: dict[str, Any] = field(default_factory=dict)
    nodes: list[dict[str, Any]] = field(default_factory=list)
    use_specular_workflow: bool = False
    opacity_threshold: float = 0.0
    cut_out: bool = False

    @property
    def texcoords(self) -> frozenset[str]:
        """Names of the texture coordinates that it reads."""
        textures = (n for n in self.nodes if n["kind"] == "texture" and n["texture"] >= 0)
        return frozenset(n["texcoord"] for n in textures if n["texcoord"])

    @property
    def reads_color(self) -> bool:
        """True where it reads displayColor per element."""
        return any(n["kind"] == "displayColor" for n in self.nodes)

    def arguments(self) -> dict[str, Any]:
        return {
            "path": self.path,
            "inputs": self.inputs,
            "nodes": self.nodes,
            "use_specular_workflow": self.use_specular_workflow,
            "opacity_threshold": self.opacity_threshold,
        }


# Of meshes without a material: matte, and without an interface that reflects.
_MATTE = {"ior": 1.0, "roughness": 1.0}


def default_material() -> MaterialData:
    """For what has neither material nor displayColor."""
    return MaterialData("default", {"diffuse_color": (0.18, 0.18, 0.18), **_MATTE})


def color_material(color: tuple[float, float, float]) -> MaterialData:
    """For what has a constant displayColor and no material."""
    name = ", ".join(f"{c:.6g}" for c in color)
    return MaterialData(f"displayColor({name})", {"diffuse_color": color, **_MATTE})


def display_color_material() -> MaterialData:
    """For what has a displayColor that varies, and no material."""
    node = {"kind": "displayColor", "path": "displayColor"}
    diffuse = {"value": (0.18, 0.18, 0.18), "node": 0, "channel": 0}
    return MaterialData("displayColor", {"diffuse_color": diffuse, **_MATTE}, [node])


def read_material(
    material: UsdShade.Material, textures: Textures, context: SyncContext
) -> MaterialData | None:
    """The material; None, and a report, where it has no surface that is supported."""
    shader = material.ComputeSurfaceSource()[0]
    path = material.GetPath()
    if not shader:
        contexts = sorted({o.GetBaseName() for o in material.GetOutputs()}) or ["none"]
        context.reports.add(
            "no UsdPreviewSurface",
            f"has no universal surface (outputs: {', '.join(contexts)}): displayColor is used instead",
            path,
        )
        return None
    identifier = shader.GetShaderId()
    if identifier != "UsdPreviewSurface":
        context.reports.add(
            f"shader {identifier or 'without id'}",
            f"surface {identifier or 'without info:id'} is not supported: displayColor is used instead",
            path,
        )
        return None
    return _PreviewSurface(shader, str(path), textures, context).read()


@dataclass(frozen=True)
class _Source:
    """What a shader input gets: a constant, or an output of a shader."""

    value: Any = None
    shader: UsdShade.Shader | None = None
    output: str = ""


def _source(shader: UsdShade.Shader, name: str, context: SyncContext) -> _Source:
    """The value of an input, or what it is connected to, through interfaces of materials and node graphs."""
    shader_input = shader.GetInput(name)
    if not shader_input:
        return _Source()
    attributes = UsdShade.Utils.GetValueProducingAttributes(shader_input)
    for attribute in attributes:
        base, kind = UsdShade.Utils.GetBaseNameAndType(attribute.GetName())
        if kind == UsdShade.AttributeType.Output:
            return _Source(shader=UsdShade.Shader(attribute.GetPrim()), output=base)
        return _Source(value=attribute.Get(context.time))
    return _Source()


def _fallback(shader: UsdShade.Shader, name: str, context: SyncContext) -> Any:
    """The value authored on an input beside its connection."""
    return shader.GetInput(name).GetAttr().Get(context.time)


class _PreviewSurface:
    """Reads one UsdPreviewSurface; what it does not support is reported under the material's path."""

    def __init__(self, shader: UsdShade.Shader, path: str, textures: Textures, context: SyncContext) -> None:
        self._shader = shader
        self._path = path
        self._textures = textures
        self._context = context
        self._nodes: list[dict[str, Any]] = []
        self._node_indices: dict[Sdf.Path, int] = {}

    def read(self) -> MaterialData:
        inputs: dict[str, Any] = {}
        for name, (key, default) in _COLOURS.items():
            inputs[key] = self._color(name, default)
        for name, (key, number) in _NUMBERS.items():
            inputs[key] = self._number(name, number)
        if inputs["ior"] <= 0:
            self._report("bad ior", f"ior {inputs['ior']:g} is not above 0: 1.5 is used")
            inputs["ior"] = 1.5
        self._report_without_effect()
        threshold = self._number("opacityThreshold", 0.0)
        if inputs["opacity"] < 1 and self._constant("opacityMode", "transparent") == "presence":
            self._report("opacityMode", "opacityMode presence is not supported yet: transparent is used")
        cut_out = threshold > 0 and inputs["opacity"] < threshold
        if threshold > 0 and not cut_out:
            inputs["opacity"] = 1.0  # a mask: what is not cut out is opaque
        specular = bool(self._constant("useSpecularWorkflow", 0))
        return MaterialData(self._path, inputs, self._nodes, specular, max(threshold, 0.0), cut_out)

    def _constant(self, name: str, default: Any) -> Any:
        source = _source(self._shader, name, self._context)
        if source.shader:
            self._report(
                f"connected {name}",
                f"{name} is connected to {source.shader.GetPath()}, which is not supported yet",
            )
            value = _fallback(self._shader, name, self._context)
        else:
            value = source.value
        return default if value is None else value

    def _number(self, name: str, default: float) -> float:
        value = floats(self._constant(name, default), 1)
        if value is None:
            self._report(f"bad {name}", f"{name} is not a finite number: {default:g} is used")
            return default
        return value[0]

    def _color(self, name: str, default: tuple[float, float, float]) -> Any:
        if name in _TEXTURED:
            source = _source(self._shader, name, self._context)
            node = self._node(source) if source.shader else None
            if node is not None:
                return {"value": default, "node": node, "channel": 0}
        value = floats(self._constant(name, default), 3)
        if value is None:
            self._report(f"bad {name}", f"{name} is not a finite colour: the default is used")
            return default
        return value

    def _report_without_effect(self) -> None:
        for name, neutral in _WITHOUT_EFFECT.items():
            source = _source(self._shader, name, self._context)
            authored = source.value is not None and floats(source.value, len(neutral)) != neutral
            if source.shader or authored:
                self._report(f"input {name}", f"input {name} is not supported yet, and has no effect")

    def _report(self, kind: str, message: str) -> None:
        self._context.reports.add(kind, message, self._path)

    # Nodes

    def _node(self, source: _Source) -> int | None:
        """Index of the node for a connected colour; None where there is none for it."""
        assert source.shader is not None
        identifier = source.shader.GetShaderId()
        if identifier == "UsdUVTexture" and source.output == "rgb":
            make = self._texture_node
        elif identifier == "UsdPrimvarReader_float3" and self._varname(source.shader) == "displayColor":
            make = self._display_color_node
        else:
            return None
        path = source.shader.GetPath()
        if path not in self._node_indices:
            node = make(source.shader)
            if node is None:
                return None
            self._node_indices[path] = len(self._nodes)
            self._nodes.append(node)
        return self._node_indices[path]

    def _display_color_node(self, shader: UsdShade.Shader) -> dict[str, Any]:
        return {"kind": "displayColor", "path": str(shader.GetPath())}

    def _texture_node(self, shader: UsdShade.Shader) -> dict[str, Any] | None:
        texcoord, transform = self._coordinates(shader)
        used = {n["texcoord"] for n in self._nodes if n["kind"] == "texture"}
        if used and texcoord not in used:
            self._report(
                "several texcoords",
                f"reads {texcoord} beside {used.pop()}: one set per material is supported yet",
            )
            return None
        asset = self._value(shader, "file", None)
        space = self._value(shader, "sourceColorSpace", "auto")
        modes = [str(self._value(shader, name, "useMetadata")) for name in ("wrapS", "wrapT")]
        texture = self._textures.index(asset, str(space), shader.GetPath())
        if "useMetadata" in modes:
            found = self._textures.wrap_modes(asset) if texture >= 0 else ("black", "black")
            modes = [f if m == "useMetadata" else m for m, f in zip(modes, found, strict=True)]
        return {
            "kind": "texture",
            "path": str(shader.GetPath()),
            "texture": texture,
            "texcoord": texcoord,
            "st_transform": transform,
            "wrap_s": self._wrap(modes[0]),
            "wrap_t": self._wrap(modes[1]),
            "scale": self._four(shader, "scale", (1.0, 1.0, 1.0, 1.0)),
            "bias": self._four(shader, "bias", (0.0, 0.0, 0.0, 0.0)),
            "fallback": self._four(shader, "fallback", (0.0, 0.0, 0.0, 1.0)),
        }

    def _wrap(self, mode: str) -> str:
        if mode in ("black", "clamp", "repeat", "mirror"):
            return mode
        self._report("wrap mode", f"wrap mode {mode} is unknown: black is used")
        return "black"

    def _value(self, shader: UsdShade.Shader, name: str, default: Any) -> Any:
        """The constant of a node's input; connections to other nodes are reported."""
        source = _source(shader, name, self._context)
        if source.shader:
            self._report(
                f"connected texture {name}", f"{shader.GetPath()}.inputs:{name} cannot be connected yet"
            )
            return default
        return default if source.value is None else source.value

    def _four(self, shader: UsdShade.Shader, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        value = floats(self._value(shader, name, default), 4)
        if value is None:
            self._report(
                f"bad texture {name}", f"{shader.GetPath()}.inputs:{name} is not four finite numbers"
            )
            return default
        return value

    def _varname(self, shader: UsdShade.Shader) -> str:
        return str(self._value(shader, "varname", ""))

    def _coordinates(self, shader: UsdShade.Shader) -> tuple[str, list[float]]:
        """The primvar that a texture reads ("": none), and st' = rows · (s, t, 1) on the way to it."""
        matrix = np.eye(3)
        name = "st"
        seen: set[Sdf.Path] = set()
        while shader.GetPath() not in seen:
            seen.add(shader.GetPath())
            source = _source(shader, name, self._context)
            if source.shader is None:
                constant = floats(source.value, 2) or (0.0, 0.0)
                # The same point of the texture everywhere: no primvar is read.
                return "", _rows(matrix @ np.array([[0, 0, constant[0]], [0, 0, constant[1]], [0, 0, 1]]))
            shader, name = source.shader, "in"
            identifier = shader.GetShaderId()
            if identifier == "UsdPrimvarReader_float2":
                return self._varname(shader) or "st", _rows(matrix)
            if identifier != "UsdTransform2d":
                self._report(
                    "texture coordinates", f"{identifier} cannot give texture coordinates yet: st is used"
                )
                return "st", _rows(matrix)
            matrix = matrix @ self._transform_2d(shader)
        return "st", _rows(matrix)  # a cycle, which USD has warned of

    def _transform_2d(self, shader: UsdShade.Shader) -> np.ndarray[Any, np.dtype[np.float64]]:
        """UsdTransform2d: in · scale, turned anticlockwise, plus translation."""
        rotation = floats(self._value(shader, "rotation", 0.0), 1) or (0.0,)
        scale = floats(self._value(shader, "scale", (1.0, 1.0)), 2) or (1.0, 1.0)
        translation = floats(self._value(shader, "translation", (0.0, 0.0)), 2) or (0.0, 0.0)
        c, s = np.cos(np.radians(rotation[0])), np.sin(np.radians(rotation[0]))
        return np.array(
            [
                [c * scale[0], -s * scale[1], translation[0]],
                [s * scale[0], c * scale[1], translation[1]],
                [0, 0, 1],
            ]
        )


def _rows(matrix: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    return [float(x) for x in matrix[:2].ravel()]


def bound_materials(prims: list[Usd.Prim], purposes: tuple[str, ...]) -> list[UsdShade.Material | None]:
    """The material bound to each prim, for the first purpose that has one (allPurpose counts for all)."""
    found: list[UsdShade.Material | None] = [None] * len(prims)
    for purpose in purposes:
        missing = [i for i, material in enumerate(found) if material is None]
        if not missing:
            break
        materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials([prims[i] for i in missing], purpose)
        for i, material in zip(missing, materials, strict=True):
            found[i] = material if material else None
    return found
