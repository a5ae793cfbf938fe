"""The AOVs of a frame: their names and formats, what core is asked for, and where it hands them out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from encore.errors import UsageError
from encore.lpe import LAYERS
from encore.render_buffer import AovBinding, Array, Format

PRIMVAR_PREFIX = "primvars:"

_Images = Mapping[str, Any]


@dataclass(frozen=True)
class AovDescriptor:
    """Of an AOV, as HdAovDescriptor. multi_sampled: filtered, as colour is, and not one sample's value."""

    format: Format
    multi_sampled: bool
    clear_value: Any


def _color(images: _Images) -> Array:
    return np.dstack((images["composite"], images["alpha"]))


def _of(name: str) -> Callable[[_Images], Array]:
    return lambda images: images[name]


_FILTERED = AovDescriptor(Format.FLOAT32_VEC3, True, 0.0)
_PLACE = AovDescriptor(Format.FLOAT32_VEC3, False, 0.0)
_ID = AovDescriptor(Format.INT32, False, -1)
_DEPTH = AovDescriptor(Format.FLOAT32, False, float("inf"))

# What every frame makes. `normal` is what USD's examples call N.
_ALWAYS: dict[str, tuple[AovDescriptor, Callable[[_Images], Array]]] = {
    "color": (AovDescriptor(Format.FLOAT32_VEC4, True, 0.0), _color),
    "alpha": (AovDescriptor(Format.FLOAT32, True, 0.0), _of("alpha")),
    "depth": (_DEPTH, _of("depth")),
    "cameraDepth": (_DEPTH, _of("depth")),
    "normal": (_FILTERED, _of("normal")),
    "N": (_FILTERED, _of("normal")),
}
# What is made where it is asked for: kinds of core/scene/aov.h.
_ASKED: dict[str, tuple[AovDescriptor, str]] = {
    "Neye": (_FILTERED, "eyeNormal"),
    "P": (_PLACE, "position"),
    "Peye": (_PLACE, "eyePosition"),
    "primId": (_ID, "primId"),
    "instanceId": (_ID, "instanceId"),
    "elementId": (_ID, "elementId"),
}
_PRIMVAR_FORMATS = (Format.FLOAT32, Format.FLOAT32_VEC2, Format.FLOAT32_VEC3, Format.FLOAT32_VEC4)
NAMES = (*_ALWAYS, *LAYERS, *_ASKED)


def default_descriptor(name: str) -> AovDescriptor:
    """The format and clear value of an AOV. Throws UsageError for a name that is none.

    Of `primvars:NAME` it is three numbers, as hdEmbree has it; bindings may say another number.
    """
    if name in _ALWAYS:
        return _ALWAYS[name][0]
    if name in LAYERS:
        return _FILTERED
    if name in _ASKED:
        return _ASKED[name][0]
    if name.startswith(PRIMVAR_PREFIX) and name != PRIMVAR_PREFIX:
        return _FILTERED
    known = ", ".join(NAMES)
    raise UsageError("there is no such AOV", f"aovs: {name!r}", f"There are {known}, and primvars:NAME")


def descriptor(binding: AovBinding) -> AovDescriptor:
    """The format and clear value of what a binding asks for. Throws UsageError."""
    found = default_descriptor(binding.aov_name)
    format, clear = found.format, found.clear_value
    if "components" in binding.settings:
        count = binding.settings["components"]
        if not binding.aov_name.startswith(PRIMVAR_PREFIX) or count not in (1, 2, 3, 4):
            raise UsageError(
                f"components {count!r} cannot be had",
                f"aovs: {binding.aov_name!r}",
                "Only primvars may have 1 to 4",
            )
        format = _PRIMVAR_FORMATS[count - 1]
    if binding.clear_value is not None:
        clear = binding.clear_value
    return AovDescriptor(format, found.multi_sampled, clear)


def requests(bindings: Sequence[AovBinding]) -> list[dict[str, Any]]:
    """The setting `aovs` of core for these bindings. Throws UsageError where a name comes twice."""
    asked: list[dict[str, Any]] = []
    names = [binding.aov_name for binding in bindings]
    for binding in bindings:
        name = binding.aov_name
        if names.count(name) > 1:
            raise UsageError("it is asked for twice", f"aovs: {name!r}", "Name every AOV once")
        if name in _ASKED:
            asked.append({"kind": _ASKED[name][1], "name": name})
        elif name.startswith(PRIMVAR_PREFIX):
            primvar = name.removeprefix(PRIMVAR_PREFIX)
            count = descriptor(binding).format.components
            asked.append({"kind": "primvar", "name": name, "primvar": primvar, "components": count})
    return asked


def pixels(name: str, images: _Images) -> Array:
    """An AOV of a rectangle, (height, width[, components]). images: what core hands to its tile callback.

    A layer that nothing in the scene can feed is black.
    """
    if name in _ALWAYS:
        return _ALWAYS[name][1](images)
    if name in LAYERS:
        found = images["layers"].get(name)
        return np.zeros_like(images["composite"]) if found is None else found
    return images["aovs"][name]
