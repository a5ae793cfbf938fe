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
    if isinstance(name, str) and name.startswith(PRIMVAR_PREFIX) and name != PRIMVAR_PREFIX:
        return _FILTERED
    known = ", ".join(NAMES)
    raise UsageError("there is no such AOV", f"aovs: {name!r}", f"There are {known}, and primvars:NAME")


def descriptor(binding: AovBinding) -> AovDescriptor:
    """The format and clear value of what a binding asks for. Throws UsageError."""
    name, settings = binding.aov_name, binding.settings
    found = default_descriptor(name)
    format, clear = found.format, found.clear_value
    where, only = f"aovs: {name!r}", "Only components may be asked for: 1 to 4, of primvars"
    if not isinstance(settings, Mapping) or any(key != "components" for key in settings):
        raise UsageError(f"{settings!r} cannot be had", where, only)
    if "components" in settings:
        count = settings["components"]
        if not name.startswith(PRIMVAR_PREFIX) or type(count) is not int or not 1 <= count <= 4:
            raise UsageError(f"components {count!r} cannot be had", where, only)
        format = _PRIMVAR_FORMATS[count - 1]
    if binding.clear_value is not None:
        clear = binding.clear_value
        if not _fits(clear, format):
            remedy = "Give a number" + (f", or {format.components} of them" if format.components > 1 else "")
            raise UsageError(f"clear value {clear!r} does not fit", where, remedy)
    return AovDescriptor(format, found.multi_sampled, clear)


def _fits(clear_value: Any, format: Format) -> bool:
    """Whether a pixel can be it: a number for all components, or one for each."""
    try:
        return np.asarray(clear_value, format.dtype).shape in ((), (format.components,))
    except (TypeError, ValueError, OverflowError):
        return False


def requests(bindings: Sequence[AovBinding]) -> list[dict[str, Any]]:
    """The setting `aovs` of core for these bindings. Throws UsageError where a name or buffer comes twice."""
    asked: list[dict[str, Any]] = []
    bound: dict[int, str] = {}
    names = [binding.aov_name for binding in bindings]
    for binding in bindings:
        name = binding.aov_name
        if names.count(name) > 1:
            raise UsageError("it is asked for twice", f"aovs: {name!r}", "Name every AOV once")
        other = bound.setdefault(id(binding.render_buffer), name)
        if other != name:
            raise UsageError(f"{other!r} has the same buffer", f"aovs: {name!r}", "Give each AOV its own")
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
