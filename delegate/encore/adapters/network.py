"""UsdShade networks → pattern nodes: textures, primvars, and the transforms between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Sdf, Usd, UsdShade

from encore.adapters.context import SyncContext, floats
from encore.adapters.texture import Textures

# A constant (a number, or as many as there are channels), or {"value", "node", "channel"}.
Input = Any

# Outputs of UsdUVTexture: first channel, and how many.
_TEXTURE_OUTPUTS = {"r": (0, 1), "g": (1, 1), "b": (2, 1), "a": (3, 1), "rgb": (0, 3), "rgba": (0, 4)}
# Floats of what UsdPrimvarReader_… gives; None: no pattern can be made of it.
_READER = "UsdPrimvarReader_"
_READER_WIDTHS: dict[str, int | None] = {
    "float": 1,
    "int": 1,
    "float2": 2,
    "float3": 3,
    "point": 3,
    "normal": 3,
    "vector": 3,
    "float4": 4,
    "string": None,
    "matrix": None,
}
_WRAP_MODES = ("black", "clamp", "repeat", "mirror")


@dataclass(frozen=True)
class _Source:
    """What an input gets: a value (None: nothing is authored) of an attribute, or a shader's output."""

    value: Any = None
    attribute: Usd.Attribute | None = None
    shader: UsdShade.Shader | None = None
    output: str = ""


class Network:
    """The nodes of one material. What it cannot represent is reported under the material's path.

    primvars: floats that are read of each one by name. optional: texture coordinates and primvars whose
    readers say what is there where a mesh has none.
    """

    def __init__(self, path: str, textures: Textures, context: SyncContext) -> None:
        self.nodes: list[dict[str, Any]] = []
        self.primvars: dict[str, int] = {}
        self.optional: set[str] = set()
        self._path = path
        self._textures = textures
        self._context = context
        self._indices: dict[Sdf.Path, int] = {}

    def report(self, kind: str, message: str) -> None:
        self._context.reports.add(kind, message, self._path)

    def error(self, kind: str, message: str) -> None:
        self._context.reports.error(kind, message, self._path)

    def is_8_bit(self, node: dict[str, Any]) -> bool:
        """Whether a texture node's file has eight bits to a channel."""
        header = self._textures.header(node["texture"])
        return header is not None and header.is_8_bit

    # Inputs

    def number(self, shader: UsdShade.Shader, name: str, default: float) -> Input:
        """A float, or a connection to a channel."""
        found = self._input(shader, name, (default,))
        return found if isinstance(found, dict) else found[0]

    def vector(self, shader: UsdShade.Shader, name: str, default: tuple[float, ...]) -> Input:
        """As many floats as the default has, or a connection to as many channels."""
        return self._input(shader, name, default)

    def constant(self, shader: UsdShade.Shader, name: str, default: Any) -> Any:
        """The value of an input that has to be one; connections to nodes are reported."""
        source = self._source(shader, name)
        value = source.value
        if source.shader:
            self.report(
                f"connected {name}",
                f"{shader.GetPath()}.inputs:{name} cannot be connected to {source.shader.GetPath()}: "
                "its own value is used",
            )
            value = self._own_value(shader, name)
        return default if value is None else value

    def constant_number(self, shader: UsdShade.Shader, name: str, default: float) -> float:
        return self._finite(self.constant(shader, name, default), shader, name, (default,))[0]

    def _constants(self, shader: UsdShade.Shader, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        return self._finite(self.constant(shader, name, default), shader, name, default)

    def _input(self, shader: UsdShade.Shader, name: str, default: tuple[float, ...]) -> Input:
        source = self._source(shader, name)
        value = source.value
        if source.shader:
            found = self._output(source, len(default), f"{shader.GetPath()}.inputs:{name}", name)
            if isinstance(found, dict):
                node = {"value": default if len(default) > 1 else default[0]}
                return node | found
            value = self._own_value(shader, name) if found is None else found
        return default if value is None else self._finite(value, shader, name, default)

    def _finite(
        self, value: Any, shader: UsdShade.Shader, name: str, default: tuple[float, ...]
    ) -> tuple[float, ...]:
        found = floats(value, len(default))
        if found is None:
            what = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
            used = " ".join(f"{d:g}" for d in default)
            self.report(
                f"bad {name}",
                f"{shader.GetPath()}.inputs:{name} is not {what}: {used} is used",
            )
            return default
        return found

    def _own_value(self, shader: UsdShade.Shader, name: str) -> Any:
        """The value authored on an input beside its connection."""
        return shader.GetInput(name).GetAttr().Get(self._context.time)

    def _source(self, shader: UsdShade.Shader, name: str) -> _Source:
        """Follows connections through interfaces of materials and node graphs."""
        current = shader.GetInput(name)
        if not current:
            return _Source()
        own = current
        seen: set[Sdf.Path] = set()
        while True:
            path = current.GetAttr().GetPath()
            connected, invalid = current.GetConnectedSources()
            if path in seen or (invalid and not connected):
                what = "is connected in a circle" if path in seen else f"is connected to {invalid[0]}"
                self.error(
                    "cyclic network" if path in seen else "broken connection",
                    f"{own.GetAttr().GetPath()} {what}, which gives no value: its own is used",
                )
                return _Source(own.GetAttr().Get(self._context.time), own.GetAttr())
            if not connected:
                return _Source(current.GetAttr().Get(self._context.time), current.GetAttr())
            seen.add(path)
            if len(connected) > 1:
                self.report("several connections", f"{path} has {len(connected)}: the first one is used")
            prim, base = connected[0].source.GetPrim(), connected[0].sourceName
            if connected[0].sourceType == UsdShade.AttributeType.Output:
                if not prim.IsA(UsdShade.NodeGraph):
                    return _Source(shader=UsdShade.Shader(prim), output=str(base))
                current = UsdShade.NodeGraph(prim).GetOutput(base)
            else:
                current = UsdShade.ConnectableAPI(prim).GetInput(base)

    # Outputs

    def _output(self, source: _Source, width: int, where: str, name: str) -> Any:
        """{"node", "channel"} of a shader's output; a constant that it comes to; or None, and a report."""
        shader = source.shader
        assert shader is not None
        identifier = str(shader.GetShaderId() or "")
        if identifier == "UsdUVTexture":
            first, channels = _TEXTURE_OUTPUTS.get(source.output, (0, 0))
            index = self._node(shader, self._texture_node) if channels == width else -1
        elif identifier.removeprefix(_READER) in _READER_WIDTHS and identifier.startswith(_READER):
            first, channels = 0, _READER_WIDTHS[identifier.removeprefix(_READER)] or 0
            if channels == width and not self._varname(shader):
                return self._nameless(shader, width)
            index = self._node(shader, self._primvar_node) if channels == width else -1
        elif identifier == "UsdTransform2d":
            first, channels, index = 0, 0, -1
        else:
            self.report(
                f"shader {identifier or 'without id'}",
                f"{shader.GetPath()} ({identifier or 'without info:id'}) is not supported: "
                f"what {where} says itself is used",
            )
            return None
        if index >= 0:
            return {"node": index, "channel": first}
        what = "a number" if width == 1 else f"{width} numbers"
        self.report(
            f"connected {name}",
            f"{where} takes {what}, which output {source.output} of {shader.GetPath()} "
            f"({identifier}) does not give: its own value is used",
        )
        return None

    def _node(self, shader: UsdShade.Shader, make: Any) -> int:
        path = shader.GetPath()
        if path not in self._indices:
            node = make(shader)
            self._indices[path] = len(self.nodes)
            self.nodes.append(node)
        return self._indices[path]

    # Primvars

    def _varname(self, shader: UsdShade.Shader) -> str:
        return str(self.constant(shader, "varname", ""))

    def _nameless(self, shader: UsdShade.Shader, width: int) -> tuple[float, ...]:
        self.report("no varname", f"{shader.GetPath()} names no primvar: it gives its fallback")
        return self._constants(shader, "fallback", (0.0,) * width)

    def _has_fallback(self, shader: UsdShade.Shader) -> bool:
        return self._source(shader, "fallback").value is not None

    def _primvar_node(self, shader: UsdShade.Shader) -> dict[str, Any]:
        name = self._varname(shader)
        width = _READER_WIDTHS[str(shader.GetShaderId()).removeprefix(_READER)] or 0
        has_fallback = self._has_fallback(shader)
        if name == "displayColor" and width == 3 and not has_fallback:
            return {"kind": "displayColor", "path": str(shader.GetPath())}
        self.primvars[name] = max(width, self.primvars.get(name, 0))
        if has_fallback:
            self.optional.add(name)
        fallback = self._constants(shader, "fallback", (0.0,) * width)
        return {
            "kind": "primvar",
            "path": str(shader.GetPath()),
            "primvar": name,
            "fallback": fallback + (0.0,) * (4 - width),
        }

    # Textures

    def _texture_node(self, shader: UsdShade.Shader) -> dict[str, Any]:
        node = {"kind": "texture", "path": str(shader.GetPath()), **self._coordinates(shader)}
        modes = [str(self.constant(shader, name, "useMetadata")) for name in ("wrapS", "wrapT")]
        textures = self._textures
        file = self._source(shader, "file")
        space = textures.color_space(
            str(self.constant(shader, "sourceColorSpace", "auto")),
            str(file.attribute.GetColorSpace()) if file.attribute else "",
            shader.GetPath(),
        )
        udim = textures.udim(file.attribute, space, shader.GetPath()) if file.attribute else None
        if udim is None:
            asset = self.constant(shader, "file", None)
            node["texture"] = textures.index(asset, space, shader.GetPath())
        else:
            node["texture"] = next((i for i in udim if i >= 0), -1)
            if node["texture"] >= 0:
                node["udim"] = udim
        if "useMetadata" in modes:
            header = textures.header(node["texture"])
            found = header.wrap if header else ("black", "black")
            modes = [f if m == "useMetadata" else m for m, f in zip(modes, found, strict=True)]
        node["wrap_s"], node["wrap_t"] = map(self._wrap, modes)
        for name, default in (("scale", 1.0), ("bias", 0.0)):
            node[name] = self._constants(shader, name, (default,) * 4)
        node["fallback"] = self._constants(shader, "fallback", (0.0, 0.0, 0.0, 1.0))
        return node

    def _wrap(self, mode: str) -> str:
        if mode in _WRAP_MODES:
            return mode
        self.report("wrap mode", f"wrap mode {mode} is unknown: black is used")
        return "black"

    def _coordinates(self, shader: UsdShade.Shader) -> dict[str, Any]:
        """The primvar that a texture reads ("": none), and st' = rows · (s, t, 1) on the way to it."""
        matrix = np.eye(3)
        name = "st"
        seen: set[Sdf.Path] = set()
        while True:
            seen.add(shader.GetPath())
            source = self._source(shader, name)
            if source.shader is None:
                s, t = (
                    (0.0, 0.0)
                    if source.value is None
                    else self._finite(source.value, shader, name, (0.0, 0.0))
                )
                # The same point of the texture everywhere: no primvar is read.
                constant = np.array([[0, 0, s], [0, 0, t], [0, 0, 1]])
                return {"texcoord": "", "st_transform": _rows(matrix @ constant)}
            shader, name = source.shader, "in"
            identifier = str(shader.GetShaderId() or "")
            if identifier == "UsdPrimvarReader_float2":
                return self._reader_coordinates(shader, matrix)
            if shader.GetPath() in seen:
                self.report("cyclic network", f"{shader.GetPath()} is connected in a circle: st is used")
                return {"texcoord": "st", "st_transform": _rows(matrix)}
            if identifier != "UsdTransform2d":
                self.report(
                    "texture coordinates",
                    f"{shader.GetPath()} ({identifier or 'without info:id'}) gives no texture coordinates: "
                    "st is used",
                )
                return {"texcoord": "st", "st_transform": _rows(matrix)}
            matrix = matrix @ self._transform_2d(shader)

    def _reader_coordinates(self, shader: UsdShade.Shader, matrix: npt.NDArray[np.float64]) -> dict[str, Any]:
        name = self._varname(shader) or "st"
        found: dict[str, Any] = {"texcoord": name, "st_transform": _rows(matrix)}
        if self._has_fallback(shader):
            found["texcoord_fallback"] = self._constants(shader, "fallback", (0.0, 0.0))
            self.optional.add(name)
        return found

    def _transform_2d(self, shader: UsdShade.Shader) -> npt.NDArray[np.float64]:
        """UsdTransform2d: in · scale, turned anticlockwise, plus translation."""
        rotation = self.constant_number(shader, "rotation", 0.0)
        scale = self._constants(shader, "scale", (1.0, 1.0))
        translation = self._constants(shader, "translation", (0.0, 0.0))
        c, s = np.cos(np.radians(rotation)), np.sin(np.radians(rotation))
        return np.array(
            [
                [c * scale[0], -s * scale[1], translation[0]],
                [s * scale[0], c * scale[1], translation[1]],
                [0, 0, 1],
            ]
        )


def _rows(matrix: npt.NDArray[np.float64]) -> list[float]:
    return [float(x) for x in matrix[:2].ravel()]
