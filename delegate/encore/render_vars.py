"""RenderVars → channels: where each gets its numbers from, what they are called, and how they are kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Sdf

from encore.channels import Part, Pixels, finite_depth
from encore.errors import SettingError
from encore.lpe import EXPRESSIONS, LAYERS, LpeError, layers_of
from encore.render_settings import Product, RenderVar, last_report
from encore.report import Reports

# What (height, width, 3) radiance becomes before it is written.
ColorMap = Callable[[Pixels], Pixels]

_COLORS = ("color", "ci", "c", "rgb", "rgba", "beauty", "combined")
_ALPHAS = ("a", "alpha")
_DEPTHS = ("z", "depth", "cameradepth", "lineardepth")
_NORMALS = ("n", "normal", "normals")
# Kinds of encore._core's AOVs by the names that other renderers and Hydra have for them.
_AOVS = {
    "p": "position",
    "position": "position",
    "peye": "eyePosition",
    "eyeposition": "eyePosition",
    "neye": "eyeNormal",
    "eyenormal": "eyeNormal",
    "primid": "primId",
    "instanceid": "instanceId",
    "elementid": "elementId",
}
_IDS = ("primId", "instanceId", "elementId")
_SUFFIXES = {"Color": "RGBA", "TextureCoordinate": "UVW", "": "XYZW"}
_HALF_MAX, _UINT_MAX = np.float32(65504), np.float32(2**32 - 1)
KNOWN_NAMES = (
    "color, alpha, depth, N, Neye, P, Peye, primId, instanceId, elementId, direct, reflection, refraction"
)


@dataclass(frozen=True)
class Aov:
    """What core is asked for: encore._core's settings["aovs"]."""

    kind: str
    primvar: str = ""
    components: int = 3

    @property
    def name(self) -> str:
        """Its name among images["aovs"], the same for the same thing."""
        return f"{self.kind}:{self.primvar}:{self.components}" if self.primvar else self.kind

    def arguments(self) -> dict[str, Any]:
        found: dict[str, Any] = {"kind": self.kind, "name": self.name}
        return found | ({"primvar": self.primvar, "components": self.components} if self.primvar else {})


@dataclass(frozen=True)
class Source:
    """Where a variable's numbers are. layers: their sum, of these; with_alpha: and alpha behind it."""

    kind: str  # layers, alpha, depth, normal or aov
    components: int
    layers: tuple[str, ...] = ()
    with_alpha: bool = False
    aov: Aov | None = None

    @property
    def is_id(self) -> bool:
        return self.aov is not None and self.aov.kind in _IDS

    def pixels(self, images: Mapping[str, Any], color_map: ColorMap) -> Pixels:
        """(height, width, components), from what encore._core.render() hands to its tile callback."""
        height, width = images["alpha"].shape
        shape = (height, width, self.components)
        if self.kind == "layers":
            color = color_map(_sum(images, self.layers))
            return np.dstack((color, images["alpha"])) if self.with_alpha else color
        if self.kind == "alpha":
            return np.asarray(images["alpha"]).reshape(shape)
        if self.kind == "depth":
            return finite_depth(images).reshape(shape)
        if self.kind == "normal":
            return np.asarray(images["normal"])
        assert self.aov is not None
        found: Pixels = np.asarray(images["aovs"][self.aov.name], np.float32).reshape(shape)
        return found


@dataclass(frozen=True)
class Channel:
    """The channels of a variable. names: one for each component."""

    var: str
    names: tuple[str, ...]
    source: Source
    pixel_type: str

    def part(self, images: Mapping[str, Any], color_map: ColorMap) -> Part:
        pixels = self.source.pixels(images, color_map)
        if self.pixel_type == "half":
            pixels = np.clip(pixels, -_HALF_MAX, _HALF_MAX)
        elif self.pixel_type == "uint":
            # As unsigned 32-bit numbers: -1 is the largest.
            pixels = np.where(pixels < 0, np.float32(1), pixels / _UINT_MAX)
        return Part(self.names, pixels, self.pixel_type)


@dataclass(frozen=True)
class Selection:
    """What of a render a file holds, instead of everything."""

    channels: tuple[Channel, ...]

    def parts(self, images: Mapping[str, Any], color_map: ColorMap) -> list[Part]:
        return [channel.part(images, color_map) for channel in self.channels]

    @property
    def aovs(self) -> tuple[Aov, ...]:
        return tuple(c.source.aov for c in self.channels if c.source.aov is not None)

    def picture(self) -> Selection | None:
        """Colour and alpha of the first variable that is radiance, for files with no room; None: none."""
        for channel in self.channels:
            if channel.source.kind == "layers":
                color = Source("layers", 3, channel.source.layers)
                return Selection(
                    (
                        Channel(channel.var, ("R", "G", "B"), color, "float"),
                        Channel(channel.var, ("A",), Source("alpha", 1), "float"),
                    )
                )
        return None


@dataclass
class _Names:
    """Names that are taken, and by which variable."""

    taken: dict[str, str] = field(default_factory=dict)

    def are_free(self, names: Sequence[str]) -> bool:
        return not any(name in self.taken for name in names)

    def take(self, names: Sequence[str], var: RenderVar, product: Product) -> None:
        for name in names:
            if name in self.taken:
                raise SettingError(
                    f"{var.path} and {self.taken[name]} both write a channel {name}",
                    f"{product.path}.orderedVars",
                    "Give one of the two prims another name",
                )
            self.taken[name] = var.path


def select(product: Product, reports: Reports) -> Selection | None:
    """The channels of a product; None: it names no variables, and holds everything.

    Variables that do not exist here are reported. Raises SettingError where nothing is left.
    """
    if not product.vars:
        return None
    names, found = _Names(), []
    for var in product.vars:
        data_type = _DataType.of(var, reports)
        source = _source(var, data_type, reports)
        if source is not None:
            channel = _channel(var, source, data_type, names, reports)
            names.take(channel.names, var, product)
            found.append(channel)
    if not found:
        raise SettingError(
            "none of its variables can be rendered",
            f"{product.path}.orderedVars",
            last_report(reports),
        )
    return Selection(tuple(found))


@dataclass(frozen=True)
class _DataType:
    """A RenderVar's dataType. components: 0 where it is not authored, or no type of numbers."""

    name: str
    components: int
    role: str
    pixel_type: str

    @staticmethod
    def of(var: RenderVar, reports: Reports) -> _DataType:
        nothing = _DataType(var.data_type, 0, "", "float")
        if not var.data_type:
            return nothing
        kind = Sdf.ValueTypeNames.Find(var.data_type)
        value = kind.defaultValue if kind and not kind.isArray else None
        dimension = 1 if isinstance(value, (bool, int, float)) else getattr(value, "dimension", 0)
        if not isinstance(dimension, int) or not 1 <= dimension <= 4:
            reports.error(
                "bad dataType", f"dataType {var.data_type} is no number of channels: 32-bit floats", var.path
            )
            return nothing
        letters = kind.cppTypeName.lower()
        pixel_type = "half" if "half" in letters or letters.endswith("h") else "float"
        if "int" in letters or letters.endswith("i") or letters in ("bool", "unsigned char"):
            pixel_type = "uint"
        if "double" in letters or letters.endswith("d"):
            reports.note("double dataType", f"dataType {var.data_type} is written as 32-bit floats", var.path)
        return _DataType(var.data_type, dimension, kind.role, pixel_type)


def _source(var: RenderVar, data_type: _DataType, reports: Reports) -> Source | None:
    """Where the numbers come from; None, and a report, where there is no such thing."""
    name = var.source_name
    if var.source_type == "lpe":
        return _of_lpe(var, data_type, reports)
    if var.source_type == "primvar" or name.startswith("primvars:"):
        primvar = name.removeprefix("primvars:")
        if not primvar:
            reports.error("unnamed primvar", f"'{name}' names no primvar: it is left out", var.path)
            return None
        return Source(
            "aov", data_type.components or 3, aov=Aov("primvar", primvar, data_type.components or 3)
        )
    if var.source_type not in ("raw", "intrinsic"):
        reports.error(
            f"unknown sourceType {var.source_type}",
            f"sourceType {var.source_type} is none of raw, primvar, lpe and intrinsic: it is left out",
            var.path,
        )
        return None
    known = name.lower()
    layer = known.removesuffix(".color").removesuffix(":color").removeprefix("color:").removeprefix("color.")
    if known in _COLORS:
        return _radiance(LAYERS, data_type.components == 4 or (not data_type.components and known == "rgba"))
    if layer in LAYERS:
        return _radiance((layer,), False)
    if known in _ALPHAS:
        return Source("alpha", 1)
    if known in _DEPTHS:
        return Source("depth", 1)
    if known in _NORMALS:
        return Source("normal", 3)
    kind = _AOVS.get(known)
    if kind is not None:
        components = 1 if kind in _IDS else 3
        return Source("aov", components, aov=Aov(kind))
    reports.error(
        "unknown render var", f"'{name}' is nothing that Encore has ({KNOWN_NAMES}): it is left out", var.path
    )
    return None


def _of_lpe(var: RenderVar, data_type: _DataType, reports: Reports) -> Source | None:
    try:
        layers = layers_of(var.source_name)
    except LpeError as error:
        possible = "; ".join(f"{layer}: {text}" for layer, text in EXPRESSIONS.items())
        reports.error(
            f"light path expression {var.source_name}",
            f"'{var.source_name}' is left out: {error}. There are the layers ({possible}) and their unions",
            var.path,
        )
        return None
    return _radiance(layers, layers == LAYERS and data_type.components == 4)


def _radiance(layers: tuple[str, ...], with_alpha: bool) -> Source:
    return Source("layers", 4 if with_alpha else 3, layers, with_alpha)


def _channel(
    var: RenderVar, source: Source, data_type: _DataType, names: _Names, reports: Reports
) -> Channel:
    components = source.components
    if data_type.components and data_type.components != components:
        reports.note(
            "components of a render var",
            f"dataType {data_type.name} is not what '{var.source_name}' is: it has {components} "
            f"channel{'s' if components > 1 else ''}",
            var.path,
        )
    pixel_type = data_type.pixel_type
    if pixel_type == ("half" if source.is_id else "uint"):
        reports.note("type of a render var", f"'{var.source_name}' is written as 32-bit floats", var.path)
        pixel_type = "float"
    return Channel(var.path, _channel_names(var, source, data_type, names), source, pixel_type)


def _channel_names(var: RenderVar, source: Source, data_type: _DataType, names: _Names) -> tuple[str, ...]:
    """`R G B A`, `A`, `Z` for what every image has; else the variable's name, and a letter per component."""
    if source.kind == "layers":
        letters = "RGBA"
    elif data_type.role or source.aov is None or not source.aov.primvar:
        letters = _SUFFIXES.get(data_type.role if data_type.components == source.components else "", "XYZW")
    else:
        letters = _SUFFIXES["" if data_type.components else "Color"]
    letters = letters[: source.components]
    is_plain = not var.channel and var.source_type in ("raw", "intrinsic")
    if is_plain or (source.kind == "layers" and var.channel.lower() in _COLORS):
        bare = {"alpha": "A", "depth": "Z"}.get(source.kind, letters if source.layers == LAYERS else "")
        if bare and names.are_free(bare):
            return tuple(bare)
    prefix = var.channel or var.name
    return (prefix,) if source.components == 1 else tuple(f"{prefix}.{letter}" for letter in letters)


def _sum(images: Mapping[str, Any], layers: tuple[str, ...]) -> Pixels:
    """The sum of layers; those that nothing feeds are black."""
    if layers == LAYERS:
        return np.asarray(images["composite"])
    total: Pixels = np.zeros((*images["alpha"].shape, 3), np.float32)
    for layer in layers:
        if layer in images["layers"]:
            total = total + images["layers"][layer]
    return total
